"""A run: the files of its folder, each read and checked by one function."""

import csv
import itertools
import os
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zoo.base.bounded_files import MOST_YAML_BYTES, open_text, read_text
from zoo.base.errors import InputError
from zoo.base.plain_files import check_text, parse_yaml, read_yaml
from zoo.runs import metrics_file
from zoo.runs.allowed_classes import with_present_names
from zoo.runs.metrics_file import read_metrics_file
from zoo.runs.record_fields import Fields, Texts, Whole, check_fields
from zoo.runs.status import is_alive, read_status_file

if TYPE_CHECKING:
    from omegaconf import DictConfig
    from typing_extensions import Self

HYDRA = ".hydra"
CHECKPOINTS, BEST, LAST = "checkpoints", "best.ckpt", "last.ckpt"
MOST_CSV_BYTES = 64_000_000


class Recorded(Fields):
    """The folder of the recording that `data=lake` makes."""

    out: str | None = None


class Data(Fields):
    """The recordings that a config names."""

    root: Texts | None = None
    images: str | None = None
    record: Recorded | None = None


class Config(Fields):
    """A run's config; networks and trainers check their own keys."""

    seed: Whole | None = None
    data: Data | None = None


class Choices(Fields):
    """The option of each config group."""

    experiment: str | None = None


class Runtime(Fields):
    """The command, as Hydra saved it."""

    choices: Choices = Choices()
    cwd: str | None = None


class Hydra(Fields):
    """Hydra's own settings."""

    runtime: Runtime = Runtime()


class HydraFile(Fields):
    """The contents of `hydra.yaml`."""

    hydra: Hydra


@dataclass(frozen=True)
class TrainedOn:
    """The recordings that a run was trained on.

    Attributes:
        roots: folders of the recordings, absolute.
        fingerprint: fingerprint of the rows; empty in runs of earlier versions.
    """

    roots: tuple[str, ...] = ()
    fingerprint: str = ""

    @property
    def name(self) -> str:
        """Return the names of the folders, with the first digits of the fingerprint.

        >>> TrainedOn(("/a/lake",), "0123456789").name
        'lake (012345)'
        """
        names = ", ".join(Path(root).name for root in self.roots) or "-"
        return f"{names} ({self.fingerprint[:6]})" if self.fingerprint else names


@dataclass(frozen=True)
class Run:
    """A finished or unfinished training, by its folder; a file is read when it is first used.

    Every attribute raises InputError, which names the file, if its file is damaged.

    Attributes:
        folder: run's folder.
    """

    folder: Path

    @classmethod
    def open(cls, folder: Path) -> "Self":
        """Return the run of a folder.

        Raises:
            InputError: the folder does not exist or is not a run's.
        """
        if not (folder / HYDRA / "config.yaml").is_file():
            runs = sorted(path.parent.parent for path in folder.glob(f"*/{HYDRA}/config.yaml"))
            neither = (
                f"is no run (no {HYDRA}/config.yaml) and no evaluation (no {metrics_file.NAME})"
            )
            reason = neither if folder.exists() else "no such folder"
            example = runs[0] if runs else "outputs/DATE/TIME"
            raise InputError(f"{folder}: {reason}; name a run's folder, such as {example}")
        return cls(folder)

    @cached_property
    def status(self) -> dict:
        """Return the contents of `status.json`; empty without a file."""
        return read_status_file(self.folder)

    @property
    def state(self) -> str:
        """Return `running`, `stopped`, `finished`, `failed`, `pruned`, or empty if unknown."""
        state = str(self.status.get("status") or "")
        return "stopped" if state == "running" and not is_alive(self.folder) else state

    @cached_property
    def metrics(self) -> dict:
        """Return the contents of `metrics.json`; empty before the run has finished."""
        return read_metrics_file(self.folder) if (self.folder / metrics_file.NAME).exists() else {}

    @cached_property
    def config(self) -> dict:
        """Return the config as Hydra composed it, with its interpolations."""
        from omegaconf import OmegaConf

        container: Any = OmegaConf.to_container(load_config(self.folder), resolve=False)
        return dict(container)

    @cached_property
    def overrides(self) -> list[str]:
        """Return the arguments of `drivezoo train`; empty without a file."""
        path = self.folder / HYDRA / "overrides.yaml"
        words = read_yaml(path, any_path=True) if path.exists() else []
        if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
            raise InputError(f"{path}: should be a list of texts")
        return words

    @cached_property
    def _runtime(self) -> Runtime:
        path = self.folder / HYDRA / "hydra.yaml"
        if not path.exists():
            return Runtime()
        return check_fields(HydraFile, read_yaml(path, any_path=True), path).hydra.runtime

    @property
    def choices(self) -> dict[str, Any]:
        """Return the option of each config group."""
        return self._runtime.choices.model_dump()

    @property
    def started_in(self) -> Path | None:
        """Return the folder to which relative paths are relative; None if it was not saved."""
        return Path(self._runtime.cwd) if self._runtime.cwd else None

    @property
    def checkpoint_path(self) -> Path | None:
        """Return the path of the best checkpoint, or of the last; None if the run kept none."""
        paths = (self.folder / CHECKPOINTS / name for name in (BEST, LAST))
        return next((path for path in paths if path.is_file()), None)

    @property
    def drive_folders(self) -> list[Path]:
        """Return the folders of the scored drives."""
        return sorted(path.parent for path in self.folder.glob("drives/*/drive.csv"))

    @property
    def tracks(self) -> dict[str, dict]:
        """Return the figures of each track that `metrics.json` holds, see `mean_and_spread`."""
        tracks = (self.metrics.get("drive") or {}).get("tracks") or {}
        return {name: figures for name, figures in tracks.items() if figures}

    @property
    def replayed(self) -> str | None:
        """Return which held-out drives of another car's recording were replayed, in words."""
        return (self.metrics.get("drive") or {}).get("replayed")

    @property
    def trained_on(self) -> TrainedOn:
        """Return the recordings of the training."""
        data = self.config.get("data") or {}
        # data=lake names no root: the run records into data.record.out.
        root = data.get("root") or (data.get("record") or {}).get("out") or []
        roots = [root] if isinstance(root, str) else root
        places = (Path(self._runtime.cwd or "") / os.path.expanduser(name) for name in roots)  # noqa: PTH111
        fingerprint = (self.metrics.get("data") or {}).get("fingerprint")
        return TrainedOn(tuple(map(os.path.normpath, places)), str(fingerprint or ""))

    def curves(self, names: Iterable[str]) -> dict[str, dict[int, float]]:
        """Return the named columns of `metrics*.csv` by epoch; 1 is the first epoch.

        A resumed run repeats an interrupted epoch; the later figure counts.

        Raises:
            InputError: a file cannot be read, or a row is damaged.
        """
        curves: dict[str, dict[int, float]] = {}
        numbers = [path.stem.partition(".")[2] for path in self.folder.glob("metrics.*.csv")]
        earlier = sorted(int(number) for number in numbers if number.isdecimal())
        for name in (*(f"metrics.{number}.csv" for number in earlier), "metrics.csv"):
            if (self.folder / name).exists():
                _add_file(self.folder / name, names, curves)
        return curves


def load_config(folder: Path) -> "DictConfig":
    """Return a run's config as OmegaConf reads it: its syntax of numbers differs from YAML's.

    Raises:
        InputError: the config cannot be read.
    """
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException
    from yaml import YAMLError

    path = folder / HYDRA / "config.yaml"
    text = read_text(path, MOST_YAML_BYTES)
    try:
        check_fields(Config, parse_yaml(text, any_path=True), path)
        config = OmegaConf.create(text)
        # Interpolations of Hydra's settings cannot be resolved outside Hydra.
        content = check_text(OmegaConf.to_container(config, resolve=False), any_path=True)
    except (OmegaConfBaseException, YAMLError, ValueError, TypeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: is no config in valid YAML ({reason})") from None
    check_fields(Config, content, path)
    plain_config: DictConfig = OmegaConf.create(with_present_names(content))
    return plain_config


def _add_file(path: Path, names: Iterable[str], curves: dict[str, dict[int, float]]) -> None:
    with open_text(path, MOST_CSV_BYTES) as file:
        rows = csv.DictReader(file)
        for line in itertools.count(2):
            try:
                row = next(rows, None)
                if row is None:
                    return
                for name in names:
                    if row.get(name):
                        epoch = int(row.get("epoch") or "none") + 1
                        curves.setdefault(name, {})[epoch] = float(row[name])
            except (csv.Error, ValueError, TypeError) as error:
                reason = " ".join(str(error).split())[:80]
                raise InputError(f"{path}, row {line}: is damaged, remove it ({reason})") from None
