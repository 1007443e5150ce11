"""The defaults in `docs/settings.md` are those of the config."""

import re
from pathlib import Path

import pytest
import yaml
from omegaconf import OmegaConf

from zoo.cli.compose import choices, compose_config

PAGE = (Path(__file__).parents[1] / "docs" / "settings.md").read_text()
ROWS = re.findall(r"^\| `([\w.]+)` \| `([^`]+)` \|", PAGE, re.M)


@pytest.fixture(scope="module")
def config() -> dict:
    return compose_config([])


@pytest.mark.parametrize(("key", "default"), ROWS)
def test_a_default_is_the_configs(key: str, default: str, config: dict) -> None:
    known = OmegaConf.create(config)
    place, _, last = key.rpartition(".")
    if key != "experiment":  # it names the recipe and is no key of the composed config
        assert last in (OmegaConf.select(known, place) if place else known)
    assert OmegaConf.select(known, key) == yaml.safe_load(default)


def test_no_key_of_the_data_is_missing(config: dict) -> None:
    keys = {f"data.{key}" for key in config["data"] if key not in ("_target_", "augment", "record")}
    assert keys == {key for key, _ in ROWS if key.startswith("data.")}


@pytest.mark.parametrize("group", ["augment", "loss", "model", "schedule"])
def test_every_choice_is_named(group: str) -> None:
    for name in choices(group):
        assert f"`{name}`" in PAGE or f"{name}`" in PAGE, f"docs/settings.md: add {group}={name}"
