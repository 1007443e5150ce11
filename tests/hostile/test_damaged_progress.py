"""Damaged files of a recording in the embedded simulator."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from rich.console import Console

from tests.hostile.conftest import Refusal
from tests.hostile.test_damaged_files import field, huge, pipe, text
from zoo.base.compose import compose_config
from zoo.base.new_folder import RECIPE
from zoo.base.run_command import run_command
from zoo.training.run_config import with_recording

Damage = Callable[[Path], object]
ANY = {
    "truncated": (lambda path: path.write_text(path.read_text()[:-20]), "JSON"),
    "list": (text("[]"), "keys"),
    "deep": (text("[" * 100_000), "64"),
    "pipe": (pipe, ""),
    "2 GB": (huge, "2,000,000,000"),
}

OTHER = "other options"
RECIPES = ANY | {
    "list": (text("[]"), OTHER),
    "text for passes": (field("passes", value="x"), OTHER),
    "NaN for laps": (field("passes", value=[{"laps": float("nan")}]), OTHER),
    "400 digits": (field("passes", value=[{"laps": 10**400}]), OTHER),
    "another key": (field("other", value=1), OTHER),
    "no passes": (text("{}"), OTHER),
}


def recorded_lake(folder: Path) -> list[str]:
    """Write an empty recording's folder with its recipe; return the overrides that name it."""
    overrides = ["data=lake", f"data.record.out={folder}"]
    recipe = compose_config(overrides)["data"]["record"]
    del recipe["out"], recipe["jobs"]
    folder.mkdir()
    (folder / RECIPE).write_text(json.dumps(recipe))
    return overrides


@pytest.mark.parametrize("name", RECIPES)
def test_a_damaged_recipe_records_nothing(name: str, tmp_path: Path, refusal: Refusal) -> None:
    overrides = recorded_lake(tmp_path / "laps")

    def train(_: list[str]) -> None:
        with_recording(OmegaConf.create(compose_config(overrides)), Console(quiet=True))

    assert run_command("zoo", train, []) == 0
    damage, words = RECIPES[name]
    damage(tmp_path / "laps" / RECIPE)

    line = refusal("zoo", train, [])

    for part in (str(tmp_path / "laps"), RECIPE, words):
        assert part in line
    assert len(line) < 500
    assert [path.name for path in (tmp_path / "laps").iterdir()] == [RECIPE]
