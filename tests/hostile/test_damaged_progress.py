"""Damaged files of a correction, and of a recording in the embedded simulator."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from rich.console import Console

from tests.hostile.conftest import Refusal
from tests.hostile.test_damaged_files import field, huge, pipe, text
from zoo.base.compose import compose_config
from zoo.base.key_values import read_options
from zoo.base.new_folder import RECIPE
from zoo.base.run_command import run_command
from zoo.training.correct_options import CorrectOptions
from zoo.training.correction import open_progress, save
from zoo.training.run_config import with_recording

Damage = Callable[[Path], object]
TRACKS = ("rounds", 0, "tracks", "lake")
FIGURES = {
    "autonomy": [0.5, 0.1],
    "interventions": [1.0, None],
    "cte_mean_m": [0.3, 0.1],
    "cte_max_m": [1.0, 0.1],
    "drives": 2,
    "drives_without_intervention": 1,
}

ANY = {
    "truncated": (lambda path: path.write_text(path.read_text()[:-20]), "JSON"),
    "list": (text("[]"), "keys"),
    "deep": (text("[" * 100_000), "64"),
    "pipe": (pipe, ""),
    "2 GB": (huge, "2,000,000,000"),
}

CORRECT = ANY | {
    "text for rounds": (field("rounds", value="x"), "rounds: "),
    "number for round": (field("rounds", value=[1]), "rounds.0: "),
    "NaN for number": (field("rounds", 0, "number", value=float("nan")), "rounds.0.number"),
    "400 digits": (field("rounds", 0, "corrections", value=10**400), "rounds.0.corrections"),
    "number for path": (field("rounds", 0, "checkpoint", value=3), "rounds.0.checkpoint"),
    "list of tracks": (field("rounds", 0, "tracks", value=[]), "rounds.0.tracks"),
    "no tracks": (field("rounds", 0, "tracks", value={}), "rounds.0.tracks"),
    "text for figure": (field(*TRACKS, "autonomy", value="x"), "rounds.0.tracks.lake.autonomy"),
    "NaN for figure": (
        field(*TRACKS, "cte_mean_m", value=[float("nan"), 0]),
        "rounds.0.tracks.lake.cte_mean_m",
    ),
    "figure missing": (field(*TRACKS, value={}), "rounds.0.tracks.lake.autonomy: "),
    "null for identity": (field("identity", value=None), "identity: "),
    "list of options": (field("options", value=[]), "options: "),
    "numbers for overrides": (field("overrides", value=[1]), "overrides.0: "),
}


@pytest.mark.parametrize("name", CORRECT)
def test_a_damaged_correction_is_named_and_not_changed(
    name: str, tmp_path: Path, refusal: Refusal
) -> None:
    checkpoint = tmp_path / "x.ckpt"
    checkpoint.write_bytes(b"weights")
    out, options = tmp_path / "out", read_options(CorrectOptions)

    def again(_: list[str]) -> None:
        open_progress(out, str(checkpoint), options, [])

    new = open_progress(out, str(checkpoint), options, [])
    first = {"number": 0, "checkpoint": str(checkpoint), "corrections": 0}
    save(new | {"rounds": [first | {"tracks": {"lake": FIGURES}}]}, out)
    assert run_command("zoo.commands.correct", again, []) == 0
    damage, words = CORRECT[name]
    damage(out / "correct.json")
    before = sorted(tmp_path.rglob("*"))

    line = refusal("zoo.commands.correct", again, [])

    assert str(out) in line
    assert "correct.json" in line
    assert words in line
    assert len(line) < 500
    assert sorted(tmp_path.rglob("*")) == before


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
def test_a_damaged_recipe_is_named_and_nothing_is_recorded(
    name: str, tmp_path: Path, refusal: Refusal
) -> None:
    overrides = recorded_lake(tmp_path / "laps")

    def train(_: list[str]) -> None:
        with_recording(OmegaConf.create(compose_config(overrides)), Console(quiet=True))

    assert run_command("zoo", train, []) == 0
    damage, words = RECIPES[name]
    damage(tmp_path / "laps" / RECIPE)

    line = refusal("zoo", train, [])

    assert str(tmp_path / "laps") in line
    assert RECIPE in line
    assert words in line
    assert len(line) < 500
    assert [one.name for one in (tmp_path / "laps").iterdir()] == [RECIPE]
