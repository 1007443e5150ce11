"""Values of a config, checked before anything is recorded or read."""

import copy
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from omegaconf import OmegaConf

from tests.zoo.command_runs import only_line, run_here
from tests.zoo.compositions import composed
from zoo.base.compose import choices, config_groups
from zoo.base.errors import InputError, UsageError
from zoo.scoring.track_scores import run_options
from zoo.training.config_values import check_arguments, check_config
from zoo.training.run_config import settle_windows, with_quick


class Number(NamedTuple):
    """A number or list of numbers in a config, its keys and its section's target."""

    keys: tuple[str, ...]
    value: list | int | float
    target: str | None


def check(config: dict) -> None:
    created = OmegaConf.create(config)
    run_options(created.get("score"))
    check_config(with_quick(settle_windows(created)))


def config_of(group: str, name: str) -> dict:
    choice = f"{group}=[{name}]" if group == "augment" else f"{group}={name}"
    network = ["model=nvidia_gaussian"] if name == "gaussian" else []
    return composed(choice, *network, "data.root=laps")


def numbers(node: dict, *keys: str) -> Iterator[Number]:
    """Yield each number and list of numbers."""
    for key, value in node.items():
        listed = value if isinstance(value, list) else [value]
        if isinstance(value, dict):
            yield from numbers(value, *keys, key)
        elif listed and all(type(number) in (int, float) for number in listed):
            yield Number((*keys, key), value, node.get("_target_"))


def refuse_true(config: dict, found: list[Number]) -> None:
    """Check that `true` is refused as each of the numbers."""
    for number in found:
        changed = copy.deepcopy(config)
        section, value = changed, number.value
        *sections, key = number.keys
        for name in sections:
            section = section[name]
        section[key] = [True, *value[1:]] if isinstance(value, list) else True
        with pytest.raises(InputError, match=re.compile(f"{key}=\\[?true", re.IGNORECASE)):
            check(changed)


def test_true_is_no_number_in_any_key() -> None:
    config = composed("data.root=laps")
    found = list(numbers(config))
    assert len(found) > 20
    refuse_true(config, found)


@pytest.mark.parametrize("group", config_groups())
def test_true_is_no_number_in_any_key_of_any_choice(group: str) -> None:
    # An experiment has no keys of its own: those that it changes are checked.
    seen = list(numbers(composed("data.root=laps"))) if group == "experiment" else []
    for name in choices(group):
        if (group, name) == ("model", "keras"):
            continue  # its layers are in a file
        config = config_of(group, name)
        check(config)
        own = [one for one in numbers(config) if group in (*one.keys, "experiment")]
        found = [number for number in own if number not in seen]
        refuse_true(config, found)
        seen += found


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("seed", "one", "seed=one: must be a whole number"),
        ("seed", 1.5, "seed=1.5: must be a whole number"),
        ("optim.lr", 0, "optim.lr=0: must be a number above 0"),
        ("optim.lr", "fast", "optim.lr=fast: must be a number"),
        ("optim.lr", float("nan"), "optim.lr=nan: must be a finite number"),
        ("optim.lr", float("inf"), "optim.lr=inf: must be a finite number"),
        ("optim.eps", "'1'", "optim.eps='1': must be a number"),
        ("data.flip", 2, "data.flip=2: must be a number in 0..1, or both"),
        ("callbacks.best.save_top_k", 1.5, "save_top_k=1.5: must be a whole number"),
        ("trainer.precision", "fp16", "trainer.precision=fp16: must be "),
        ("trainer.max_epochs", -1, "trainer.max_epochs=-1: must be a whole number of 0 or more"),
        ("data.ofset", 1, "data.ofset: no such key; did you mean data.offset"),
        ("optim.momentun", 1, "optim.momentun: no such key"),
        ("model.dropuot", 1, "model.dropuot: no such key; did you mean model.dropout"),
        ("trainer.foo", 1, "trainer.foo: no such key"),
        ("callbacks.best.modus", "min", "did you mean callbacks.best.mode"),
        ("callbacks.none.x", 1, "callbacks.none: has keys, but no _target_"),
        ("loss._target_", "torch.nn.NoLoss", "NoLoss"),
    ],
)
def test_a_wrong_value_or_key_is_named(key: str, value: object, words: str) -> None:
    config = OmegaConf.create(composed("data.root=laps"))
    OmegaConf.update(config, key, value, force_add=True)
    with pytest.raises(InputError, match=re.escape(words)):
        check(OmegaConf.to_container(config))


@pytest.mark.parametrize("key", ["seed=one", "data.flip=true", "optim.lr=true", "+optim.foo=1"])
def test_a_wrong_value_is_named_before_the_lake_is_recorded(key: str, tmp_path: Path) -> None:
    assert key.lstrip("+").partition("=")[0] in only_line(run_here(tmp_path, key), 2)
    assert not (tmp_path / "outputs" / "recordings").exists()


def test_annotations_that_only_type_checkers_resolve_are_left_out() -> None:
    def function(rate: "Unknown", count: "int") -> None:  # noqa: F821
        pass

    check_arguments("loss", function, {"rate": True, "count": 1})
    with pytest.raises(UsageError, match="count=true"):
        check_arguments("loss", function, {"count": True})
