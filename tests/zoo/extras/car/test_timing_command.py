"""`drivezoo timing`: the search for the highest speed, and what it writes."""

import json
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from tests.zoo.command_runs import only_line, run_here, succeed
from tests.zoo.written_checkpoints import write_constant
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.extras.car import highest_speed
from zoo.extras.car.highest_speed import MEASURED, Timing, highest_speeds
from zoo.extras.car.loop_times import LoopTimes
from zoo.extras.car.timing_options import TimingOptions


def timing_of(speeds: dict[str, list[int]], delay_s: float = 0.0) -> Timing:
    times = LoopTimes("times.csv", np.full(9, 100.0), np.full(9, 90.0), np.zeros(9, bool))
    return Timing("lenet", TimingOptions(delay_s=delay_s), dict.fromkeys(speeds, times), speeds)


def test_the_highest_clean_speed_is_found_by_bisection(monkeypatch: pytest.MonkeyPatch) -> None:
    limits, driven = {0: 4, 1: 5, 2: 17, 3: 29, 4: 99}, []

    def drives(checkpoint: str, scenarios: Sequence[Scenario], **_: object) -> list:
        driven.extend(scenarios)
        failed = [np.array([scenario.speed > limits[scenario.seed]]) for scenario in scenarios]
        return [SimpleNamespace(intervention=intervention) for intervention in failed]

    monkeypatch.setattr(highest_speed, "all_drives", drives)
    scenarios = [Scenario(seed=seed) for seed in limits]
    assert highest_speeds("lenet", scenarios, 5, 30) == [4, 5, 17, 29, 30]
    assert len(driven) <= 5 * len(limits)


def test_only_a_sure_improvement_is_advised() -> None:
    measured = [10, 11, 12, 13, 14, 15, 16, 17]
    better = [speed + 4 for speed in measured]
    unsure = [30, 11, 12, 13, 14, 15, 16, 16]
    improved = {"half the delay": better, "no jitter": unsure, "both": better}
    timing = timing_of({MEASURED: measured} | improved)
    assert "half the delay, +4 (+4 to +4) mph" in timing.advice
    assert "13.5 (10 to 17) mph on the median of 8 lakeside roads, and up to 10" in timing.lines[0]
    unsurely = timing_of({MEASURED: measured, "no jitter": unsure, "both": better})
    assert "no single improvement" in unsurely.advice
    assert "on 1 of 8 roads a speed is only known to be below 5 or at least 30" in timing.lines[2]
    assert "nothing to improve" in timing_of({MEASURED: [30] * 8, "both": [30] * 8}).lines[-1]
    bounded = timing_of({MEASURED: [4, 4, 20, 20, 20, 20, 20, 20], "both": better})
    assert "up to 20 (below 5 to 20) mph on the median" in bounded.lines[0]
    assert bounded.result_table().columns[3].cells[0] == "20 (below 5 to 20)"
    slow = timing_of({MEASURED: [4] * 8, "both": [4] * 8}, delay_s=0.1)
    assert "up to less than 5 mph on the median" in slow.lines[0]
    cells = {column.name: column.cells for column in slow.result_table().columns}
    assert cells["speed_mph"] == cells["every_road_mph"] == ["below 5"] * 2
    assert cells["delay_ms"] == ["190"] * 2, "with that of the camera and the servo"


def test_a_search_writes_figures_and_plot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def drives(checkpoint: str, scenarios: Sequence[Scenario], **_: object) -> list:
        """Drive one scenario, of which all others have the intervention."""
        return len(scenarios) * all_drives(checkpoint, scenarios[-1:], first_only=True)

    monkeypatch.setattr(highest_speed, "all_drives", drives)
    checkpoint = write_constant(tmp_path / "best.ckpt", 0.4)
    (tmp_path / "times.csv").write_text("latency_ms\n100\nlost\n")
    settings = ("length=60", "quality=simple", "least=29", "roads=6", "workers=1", "out=found")
    words = (str(checkpoint), "times.csv", *settings)
    printed = succeed(run_here(tmp_path, *words, module="zoo.extras.car.timing"))
    assert printed.count("2 times, of which 1 lost") == 1
    assert printed.index("2 times, of which 1 lost") < printed.index("less than 29 mph")
    figures = json.loads((tmp_path / "found" / "timing.json").read_text())
    assert figures["speeds_mph"][MEASURED] == [28] * 6
    assert set(figures["speeds_mph"]) > {"no lost frames", "both"}
    assert "less than 29 mph" in figures["lines"][0]
    with Image.open(tmp_path / "found" / "timing.png") as image:
        assert min(image.size) > 300


@pytest.mark.parametrize("key", ["most=4", "least=5.5", "family=alpin", "roads=5", "part=Pilot"])
def test_a_wrong_key_is_named_before_anything_is_driven(key: str, tmp_path: Path) -> None:
    (tmp_path / "times.csv").write_text("100\n")
    checkpoint = write_constant(tmp_path / "best.ckpt", 0.4)
    result = run_here(tmp_path, str(checkpoint), "times.csv", key, module="zoo.extras.car.timing")
    assert key.partition("=")[2] in only_line(result, 2)
    assert not (tmp_path / "outputs").exists()
