"""Configs that Hydra composes from our files, kept for all tests of a process.

Hydra reads and merges some 30 YAML files at each composition, which takes 0.1 s: a quarter of the
time of the tests that train. Here it does so once for each choice of files (later: 0.02 s); it
parses and applies the values that a test sets every time. The process that forks commands keeps the
files alone, so that commands choose and merge them as users' do.
"""

import pickle
from collections.abc import Callable
from pathlib import Path

from hydra._internal import config_loader_impl
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.config_repository import ConfigRepository, IConfigRepository
from hydra._internal.defaults_list import DefaultsList
from hydra.core.default_element import ResultDefault
from hydra.core.override_parser.types import Override
from hydra.plugins.config_source import ConfigResult, ConfigSource
from omegaconf import DictConfig

ROOT = Path(__file__).parents[1]
# No test changes a file of these folders: ours, and those of the extras.
CONF = {ROOT / "conf", *ROOT.glob("zoo/extras/*/conf")}

choose_files = config_loader_impl.create_defaults_list
load_file = ConfigRepository.load_config
merge_files = ConfigLoaderImpl._compose_config_from_defaults_list

_kept: dict[tuple, bytes] = {}


def keep_compositions() -> None:
    """Let Hydra use the kept configs in this process."""
    keep_files()
    config_loader_impl.create_defaults_list = kept_choice
    ConfigLoaderImpl._compose_config_from_defaults_list = kept_merge


def keep_files() -> None:
    """Let Hydra read each file once in this process."""
    ConfigRepository.load_config = kept_file


def kept_file(self: ConfigRepository, config_path: str) -> ConfigResult | None:
    """Return a file's config, read before if possible."""
    if not only_our_files(self.get_sources()):
        return load_file(self, config_path)
    return copy_of(("file", config_path), lambda: load_file(self, config_path))


def kept_choice(
    repo: IConfigRepository, config_name: str | None, overrides_list: list[Override], **how: bool
) -> DefaultsList:
    """Return Hydra's list of files for the overrides, chosen before if possible."""
    if not only_our_files(repo.get_sources()):
        return choose_files(repo, config_name, overrides_list, **how)
    typed = [override for override in overrides_list if not override.is_sweep_override()]
    values = [
        override
        for override in typed
        if isinstance(override.value(), dict) or not repo.group_exists(override.key_or_group)
    ]
    groups = [override for override in typed if override not in values]
    key = "choice", config_name, *sorted(how.items()), *(override.input_line for override in groups)
    files = copy_of(key, lambda: choose_files(repo, config_name, groups, **how))
    files.config_overrides.extend(values)
    return files


def kept_merge(
    self: ConfigLoaderImpl, defaults: list[ResultDefault], repo: IConfigRepository
) -> DictConfig:
    """Return the merged files of a list, merged before if possible."""
    if not only_our_files(repo.get_sources()):
        return merge_files(self, defaults, repo)
    return copy_of(("merge", *map(repr, defaults)), lambda: merge_files(self, defaults, repo))


def copy_of(key: tuple, make: Callable[[], object]) -> object:
    """Return a new copy of what `make` returned for this key; Hydra changes what it is given."""
    if key not in _kept:
        _kept[key] = pickle.dumps(make())
    return pickle.loads(_kept[key])


def only_our_files(sources: list[ConfigSource]) -> bool:
    """Return whether all files come from the project, and none from a user's folder."""
    return {Path(source.path) for source in sources if source.scheme() == "file"} == CONF
