"""Read `.hydra/*.yaml`: a run's config, the overrides that the user typed, Hydra's settings."""

from pathlib import Path
from typing import TYPE_CHECKING

from zoo.base.bounded_files import check_text, read_yaml, read_yaml_text
from zoo.base.errors import InputError
from zoo.runs.record_fields import Fields, Texts, Whole, check_fields, plain

if TYPE_CHECKING:
    from omegaconf import DictConfig

FOLDER = ".hydra"


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


def read_config_file(folder: Path) -> dict:
    """Return a run's config as plain containers; raise InputError for a damaged file."""
    path = folder / FOLDER / "config.yaml"
    return plain(check_fields(Config, read_yaml(path, any_path=True), path))


def read_hydra_file(folder: Path) -> Runtime:
    """Return a run's command, as Hydra saved it; raise InputError for a damaged file."""
    path = folder / FOLDER / "hydra.yaml"
    return check_fields(HydraFile, read_yaml(path, any_path=True), path).hydra.runtime


def read_overrides_file(folder: Path) -> list[str]:
    """Return the arguments of `drivezoo train`; raise InputError for a damaged file."""
    path = folder / FOLDER / "overrides.yaml"
    found = read_yaml(path, any_path=True)
    if not isinstance(found, list) or not all(isinstance(one, str) for one in found):
        raise InputError(f"{path}: should be a list of texts")
    return found


def load_config(folder: Path) -> "DictConfig":
    """Return a run's config as OmegaConf reads it: its syntax of numbers differs from YAML's.

    Raises:
        InputError: the config cannot be read.
    """
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException
    from yaml import YAMLError

    path = folder / FOLDER / "config.yaml"
    try:
        config = OmegaConf.create(read_yaml_text(path, any_path=True))
        # Interpolations of Hydra's settings cannot be resolved outside Hydra.
        found = check_text(OmegaConf.to_container(config, resolve=False), any_path=True)
    except (OmegaConfBaseException, YAMLError, ValueError, TypeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: cannot be read as a config ({reason})") from None
    check_fields(Config, found, path)
    plain_config: DictConfig = OmegaConf.create(found)
    return plain_config
