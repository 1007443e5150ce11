"""A default of drivezoo's own classes stands in the class; `conf` repeats it, and this checks it.

`tests/datamodules/test_data_settings.py` and `tests/test_model_pages.py` hold the manual to it.
"""

import inspect
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from zoo.base.command_keys import REQUIRED
from zoo.base.conf_files import conf_folder
from zoo.scoring.track_scores import RunScore

CONF = conf_folder()
OURS = ("datamodules.", "zoo.", "hydra_plugins.drivezoo.")
# Files of keys of a dataclass, without a `_target_`.
CLASSES = {"score/lake.yaml": RunScore, "world/embedded.yaml": RunScore}
# Values with which a choice is another than its class without arguments.
CHOSEN = {
    "augment/shadow.yaml": {"shadow_roi", "num_shadows_limit", "shadow_intensity_range", "p"},
    "augment/shift.yaml": {"rows"},
    "model/ncp.yaml": {"sequence"},
    "model/nvidia_gaussian.yaml": {"spread"},
    "model/nvidia_speed.yaml": {"speed"},
    "score/lake.yaml": {"film", "film_speed"},
    "world/embedded.yaml": {"track"},  # of no track, an evaluation takes the lake, or what is named
}


def parts(node: object) -> Iterator[tuple[Callable, dict]]:
    """Yield the classes of ours that a config names, with their arguments."""
    if isinstance(node, dict):
        if str(node.get("_target_")).startswith(OURS):
            module, _, name = node["_target_"].rpartition(".")
            yield getattr(import_module(module), name), node
        for value in node.values():
            yield from parts(value)


def repeated() -> list[tuple[str, Callable, dict]]:
    """Return the files of `conf` with the class of each part, and its arguments there."""
    rows = []
    for path in sorted(CONF.rglob("*.yaml")):
        name = path.relative_to(CONF).as_posix()
        values = OmegaConf.to_container(OmegaConf.load(path))
        rows += [(name, kind, keys) for kind, keys in parts(values)]
        rows += [(name, CLASSES[name], values)] if name in CLASSES else []
    return rows


@pytest.mark.parametrize(("file", "kind", "keys"), repeated(), ids=lambda value: str(value)[:40])
def test_a_default_in_conf_is_that_of_the_class(file: str, kind: Callable, keys: dict) -> None:
    usual = {name: given.default for name, given in inspect.signature(kind).parameters.items()}
    other = set()
    for key in keys.keys() & usual.keys():
        default = list(usual[key]) if isinstance(usual[key], tuple) else usual[key]
        is_given = default is REQUIRED or "factory" in repr(default)
        other |= {key} if not is_given and default != keys[key] else set()
    assert other == CHOSEN.get(file, set()), f"conf/{file}: not the defaults of {kind.__qualname__}"


def test_all_groups_of_ours_are_compared() -> None:
    groups = {Path(file).parts[0] for file, _, _ in repeated()}
    assert groups >= {"augment", "callbacks", "data", "loss", "model", "module", "score", "world"}
