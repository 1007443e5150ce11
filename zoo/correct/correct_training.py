"""Training on: with a checkpoint's own config, its own recording and all corrections so far."""

import csv
import io
import re
import shutil
from collections.abc import Collection
from pathlib import Path

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from rich.console import Console

from datamodules.driving_log import read_log
from datamodules.errors import InputError
from datamodules.recording import LOG_NAME, file_name
from datamodules.split import write_split
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.cli.compose import escape_interpolation
from zoo.correct.correct_options import CorrectOptions
from zoo.runs.saved_config import Keys, check_saved_config, leaf_keys


def own_config(
    checkpoint: Checkpoint, overrides: list[str], path: str, trusted: Collection[str] = ()
) -> DictConfig:
    """Return the config that a checkpoint was trained with, with such overrides as
    `data.root=FOLDER`.

    Args:
        path: the checkpoint's, for messages.
        trusted: see `check_saved_config`.

    Raises:
        InputError: a key that its config lacks, a value that cannot be read, no such recording, or
            a config that names what it must not.
    """
    config = OmegaConf.create(escape_interpolation(checkpoint.config))
    OmegaConf.set_struct(config, True)
    typed: set[Keys] = set()
    for one in overrides:
        key, _, value = one.partition("=")
        try:
            # A path that exists is taken as it stands, whatever is in it.
            is_path = key == "data.root" and Path(value).expanduser().exists()
            value = value if is_path else OmegaConf.create(f"v: {value}").v
            OmegaConf.update(config, key, value)
            typed |= leaf_keys(value, tuple(re.split(r"[.\[\]]+", key)))
        except OmegaConfBaseException:
            raise InputError(f"{key}: the checkpoint's config has no such key") from None
        except Exception:  # what YAML's parser raises for text that is none
            raise InputError(f"{one}: cannot be read as a value") from None
    OmegaConf.set_struct(config, False)
    check_saved_config(config, path, trusted, typed)
    if config.data.images is not None:
        raise InputError(
            f"data.images={config.data.images}: corrections have pictures of their own; put "
            "those of data.root in IMG beside its log, and say data.images=null"
        )
    for root in own_roots(config):
        if not (Path(root).expanduser() / LOG_NAME).is_file() and not root.endswith(".csv"):
            raise InputError(
                f"{root}: the recording that the checkpoint was trained on is not there; say where "
                "it is now with data.root=FOLDER"
            )
    return config


def own_roots(config: DictConfig) -> list[str]:
    """The recordings of a config."""
    root = config.data.root
    return [root] if isinstance(root, str) else list(root)


def write_own_split(
    config: DictConfig, checkpoint: Checkpoint, beside: Path, path: Path, console: Console
) -> None:
    """Write how the checkpoint's own rows were split, so that none that it was validated on is
    trained on, and none that it was trained on validates.

    Args:
        beside: the `split.csv` that its run has left, if it is still there.
    """
    from zoo.training.build import build_data

    config = config.copy()
    if beside.is_file():
        config.data.split = str(beside)
    data = build_data(config)
    data.load(Console(file=io.StringIO()))
    if data.recording.fingerprint() != checkpoint.data["fingerprint"]:
        console.print(
            f"note: {', '.join(data.recording.names)} is not what the checkpoint was trained on "
            f"({checkpoint.data['rows']} rows); it is trained on now",
            highlight=False,
            markup=False,
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_split(path, data.recording, data.split)


def training_config(
    config: DictConfig,
    options: CorrectOptions,
    corrections: list[Path],
    start: str,
    own_split: Path,
    split: Path,
) -> DictConfig:
    """The config of a round's training, whose split file is written to `split`.

    All corrections are trained on. The last epoch's weights are kept, not those of the best: the
    checkpoint's own validation rows know nothing of the corrections, and the driving decides.
    """
    config = config.copy()
    roots = own_roots(config)
    before = config.data.get("weights") or [1.0] * len(roots)
    config.data.root = [*roots, *map(str, corrections)]
    config.data.weights = [*before, *[float(options.weight)] * len(corrections)]
    split.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(own_split, split)
    with split.open("a", newline="") as file:
        writer = csv.writer(file)
        for folder in corrections:
            for row in read_log(folder / LOG_NAME):
                writer.writerow([file_name(row.paths[0]), "train"])
    config.data.split = str(split)
    config.data.pop("record", None)
    config.model.weights = start
    config.quick = False  # what it capped is capped in the config already, but for the epochs
    config.trainer.max_epochs = options.epochs
    config.callbacks.pop("early_stopping", None)
    config.callbacks.pop("closed_loop", None)
    if config.callbacks.get("best"):
        # Of two alike callbacks Lightning could not tell the states apart; the mode has no effect.
        config.callbacks.best.update(monitor=None, mode="max")
    config.score = {}
    return config


def train_round(config: DictConfig, folder: Path, own_run: Path) -> Path:
    """Train in `folder`, or go on there with what was stopped; the checkpoint.

    Args:
        own_run: of the checkpoint that is corrected, whose choices of config groups still hold.
    """
    from zoo.runs.status import read_status
    from zoo.training.run import run_experiment

    checkpoint = folder / "checkpoints" / "last.ckpt"
    if read_status(folder).get("status") == "finished" and checkpoint.is_file():
        return checkpoint
    (folder / ".hydra").mkdir(parents=True, exist_ok=True)
    OmegaConf.save(config, folder / ".hydra" / "config.yaml")
    choices = own_run / ".hydra" / "hydra.yaml"
    if choices.is_file():
        shutil.copyfile(choices, folder / ".hydra" / "hydra.yaml")
    run_experiment(config, folder, resume=True)
    return checkpoint
