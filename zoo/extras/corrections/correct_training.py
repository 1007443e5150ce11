"""Further training of a checkpoint, on its own recording and all corrections so far."""

import io
import shutil
from collections.abc import Collection
from pathlib import Path

from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from datamodules.driving_log import read_log
from datamodules.format_options import OWN_KEYS, ReadOptions
from datamodules.recording import LOG_NAME, file_name
from datamodules.split import write_split
from datamodules.steering_unit import keys_and_values
from zoo.base.compose import escape_interpolation, plain_dict
from zoo.base.errors import InputError
from zoo.base.file_text import csv_text
from zoo.base.terminal import counted
from zoo.base.whole_file import write_whole
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.checkpoint_path import trained_data
from zoo.extras.corrections.correct_options import CorrectOptions
from zoo.runs.saved_config import check_saved_config, overridden


def own_config(
    checkpoint: Checkpoint, overrides: list[str], path: str, trusted: Collection[str] = ()
) -> DictConfig:
    """Return the config of a checkpoint's training, changed by overrides.

    Args:
        checkpoint: checkpoint to correct.
        overrides: overrides such as `data.root=FOLDER`.
        path: path of the checkpoint, for messages.
        trusted: names of classes and keys that are allowed, see `check_saved_config`.

    Raises:
        InputError: a missing recording, or a config that names what is not allowed; see also
            `overridden`.
    """
    trained = checkpoint.config | {"data": trained_data(checkpoint.config, checkpoint.data)}
    config, typed = overridden(OmegaConf.create(escape_interpolation(trained)), overrides)
    check_saved_config(config, path, trusted, typed)
    if config.data.images is not None:
        raise InputError(
            f"data.images={config.data.images}: corrections need each recording's images in IMG "
            "next to its log; move them there and add data.images=null"
        )
    for root in own_roots(config):
        if not Path(root).expanduser().exists():
            raise InputError(
                f"{root}: the checkpoint's recording is missing; name its new folder with "
                "data.root=FOLDER"
            )
    return config


def own_roots(config: DictConfig) -> list[str]:
    """Return the recording folders of a config.

    Raises:
        InputError: the config names none, as that of an imported network.
    """
    root = config.data.root
    if root is None:
        raise InputError(
            "data.root=null: the checkpoint names no recording, and corrections are added to one; "
            "add data.root=FOLDER"
        )
    return [root] if isinstance(root, str) else list(root)


def write_own_split(
    config: DictConfig, checkpoint: Checkpoint, run_split: Path, path: Path, console: Console
) -> None:
    """Write the split of the checkpoint's own rows, so that rows keep their part.

    Args:
        config: config of the checkpoint.
        checkpoint: checkpoint to correct.
        run_split: path of the `split.csv` of the checkpoint's run, which need not exist.
        path: file to write.
        console: output of a note if the recording has changed.
    """
    from zoo.training.build import load_data

    config = config.copy()
    if run_split.is_file():
        config.data.split = str(run_split)
    data = load_data(config, Console(file=io.StringIO()))
    if data.recording.fingerprint() != checkpoint.data["fingerprint"]:
        console.print(
            f"note: {', '.join(data.recording.names)} is not the recording that the checkpoint was "
            f"trained on ({counted(checkpoint.data['rows'], 'row')}); this training uses it",
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
    """Return the config of a round's training, and write its split file to `split`.

    All corrections are training rows. The round keeps the last epoch's weights, not the best's: no
    correction is in the validation rows, and the drives after each round decide which one is best.
    """
    config = config.copy()
    roots = own_roots(config)
    before = config.data.get("weights") or [1.0] * len(roots)
    config.data.root = [*roots, *map(str, corrections)]
    config.data = for_own_roots(plain_dict(config.data), len(roots))
    config.data.weights = [*before, *[float(options.weight)] * len(corrections)]
    split.parent.mkdir(parents=True, exist_ok=True)
    logs = [row for folder in corrections for row in read_log(folder / LOG_NAME)]
    text = csv_text([(file_name(row.paths[0]), "train") for row in logs], line_end="\r\n")
    write_whole(split, own_split.read_bytes() + text.encode(errors="surrogateescape"))
    config.data.split = str(split)
    config.data.pop("record", None)
    config.model.weights = start
    config.quick = False  # the config already has its limits; epochs are set below
    if "T_max" in (config.get("schedule") or {}):  # of a whole training; a round ends it, too
        config.schedule.T_max = options.epochs
    config.trainer.max_epochs = options.epochs
    config.trainer.pop("min_epochs", None)
    config.callbacks.pop("early_stopping", None)
    config.callbacks.pop("closed_loop", None)
    if config.callbacks.get("best"):
        config.callbacks.best.monitor = None
    config.score = {}
    return config


def for_own_roots(data: dict, roots: int) -> dict:
    """Return `data` with what it says about reading said of its first recordings alone.

    The corrections after them are a log in drivezoo's own units.
    """
    usual = {key: getattr(ReadOptions, key) for key in OWN_KEYS if key in data}
    own = {key: data[key] for key, value in usual.items() if data[key] != value}
    each = keys_and_values("each", data.get("each") or {}) or {}
    each = {str(number): said for number, said in each.items()}
    each = {number: own | each.get(str(number), {}) for number in range(1, roots + 1)}
    return data | usual | {"each": {number: said for number, said in each.items() if said} or None}


def train_round(config: DictConfig, folder: Path, own_run: Path) -> Path:
    """Train in `folder`, or resume a stopped training there, and return the checkpoint.

    Args:
        config: config of the training.
        folder: folder of the round's run.
        own_run: run folder of the checkpoint to correct; its choices of config groups are copied.
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
    run_experiment(config, folder, resume=True, verdict=False)  # the round's drives give one
    return checkpoint
