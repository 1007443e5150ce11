"""What `docs/settings.md` names exists: keys, their defaults and choices of groups.

A choice without a mention is no failure: a new part needs no page.
"""

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


def named_choices() -> list[tuple[str, str]]:
    """Return the groups and choices that the page names.

    They stand in headings and in lines that begin with `group=NAME`; those of `augment` in a table,
    those of `model` in the line below its heading.
    """
    named = []
    for line in PAGE.splitlines():
        if found := re.match(r"(?:## .*\()?`([a-z]+)=([a-z]\w*)`(.*)", line):
            group, first, rest = found.groups()
            named += [(group, name) for name in (first, *re.findall(r"`(\w+)`", rest))]
    _, _, augment = PAGE.partition("\n## Augmentation")
    names = re.findall(r"^\| `(\w+)` \|", augment.partition("\n## ")[0], re.M)
    named += [("augment", name) for name in names]
    (models,) = re.findall(r"^## Network .*\n\n(.*)\. Each", PAGE, re.M)
    return named + [("model", name) for name in re.findall(r"`(\w+)`", models)]


@pytest.mark.parametrize(("group", "name"), named_choices())
def test_a_named_choice_exists(group: str, name: str) -> None:
    assert name in choices(group), f"docs/settings.md names {group}={name}"


def test_the_choices_are_found_on_the_page() -> None:
    groups = {group for group, _ in named_choices()}
    assert groups >= {"augment", "data", "loss", "model", "schedule", "trainer"}
