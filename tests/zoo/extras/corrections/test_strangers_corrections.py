"""Corrections of what others left: damaged progress."""

from pathlib import Path

import pytest

from tests.hostile.conftest import Refusal
from tests.hostile.test_damaged_files import field
from tests.hostile.test_damaged_progress import ANY
from zoo.base.key_values import read_options
from zoo.base.run_command import run_command
from zoo.extras.corrections.correct_options import CorrectOptions
from zoo.extras.corrections.correction import open_progress, save

TRACKS = ("rounds", 0, "tracks", "lake")
FIGURES = {"autonomy": [0.5, 0.1], "interventions": [1.0, None], "cte_mean_m": [0.3, 0.1]}
FIGURES |= {"cte_max_m": [1.0, 0.1], "drives": 2, "drives_without_intervention": 1}

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
def test_a_damaged_file_is_named_and_unchanged(name: str, tmp_path: Path, refusal: Refusal) -> None:
    checkpoint = tmp_path / "x.ckpt"
    checkpoint.write_bytes(b"weights")
    out, options = tmp_path / "out", read_options(CorrectOptions)

    def again(_: list[str]) -> None:
        open_progress(out, str(checkpoint), options, [])

    new = open_progress(out, str(checkpoint), options, [])
    first = {"number": 0, "checkpoint": str(checkpoint), "corrections": 0}
    save(new | {"rounds": [first | {"tracks": {"lake": FIGURES}}]}, out)
    assert run_command("drivezoo correct", again, []) == 0
    damage, words = CORRECT[name]
    damage(out / "correct.json")
    before = sorted(tmp_path.rglob("*"))

    line = refusal("drivezoo correct", again, [])

    for text in (str(out), "correct.json", words):
        assert text in line
    assert len(line) < 500
    assert sorted(tmp_path.rglob("*")) == before
