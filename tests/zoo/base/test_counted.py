"""Numbers with their nouns: one function decides on the plural."""

import re

import numpy as np
import pytest

from tests.zoo.command_runs import ROOT
from zoo.base.terminal import counted
from zoo.driving.scenario import Scenario
from zoo.scoring.track_scores import driving_line
from zoo.training.plan import TrainingPlan

# Of code that decides on a plural by itself.
BY_HAND = re.compile(r"""['"]e?s['"] \* \(|\{['"]{2} if [^}]*== 1 else""")


@pytest.mark.parametrize(
    ("count", "text"),
    [(0, "0 laps"), (1, "1 lap"), (1.0, "1 lap"), (0.03, "0.03 laps"), (np.int64(1), "1 lap")],
)
def test_one_alone_has_no_plural(count: float, text: str) -> None:
    assert counted(count, "lap") == text


def test_lines_of_one_drive_and_one_thread() -> None:
    assert driving_line([Scenario("lake", laps=1)]) == "1 drive of 1 lap"
    assert driving_line([Scenario(world="gymnasium:Lake-v0")]) == "1 drive"
    assert driving_line([Scenario("lake", laps=2)] * 2) == "2 drives of 2 laps each"
    assert "on cpu, 1 thread" in TrainingPlan("cpu", threads=1).line()
    assert "on cpu, 2 threads" in TrainingPlan("cpu", threads=2).line()


def test_no_other_code_decides_on_a_plural() -> None:
    terminal = ROOT / "zoo" / "base" / "terminal.py"
    files = [p for room in ("zoo", "datamodules") for p in (ROOT / room).rglob("*.py")]
    matches = {
        f"{path.relative_to(ROOT)}: {match[0]}"
        for path in files
        for match in BY_HAND.finditer(path.read_text(encoding="utf-8"))
        if path != terminal
    }
    assert matches == set()
