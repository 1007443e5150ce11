"""`drivezoo guard` with real drives on a short road, and the guard that it writes."""

import csv
import json
from pathlib import Path

import pytest

from tests.zoo.commands import only_line, run_here
from tests.zoo.guard.roads import write_daylight, write_road
from tests.zoo.written_checkpoints import write_pilotnet
from zoo.base.errors import InputError, UsageError
from zoo.evaluate.__main__ import evaluate_or_replay as evaluate
from zoo.guard.__main__ import guard
from zoo.guard.conditions import Noisy
from zoo.monitor.guarded_policy import read_guard
from zoo.worlds.scenario import Scenario

WORLD = ("quality=simple", "frame_rate=5", "speed=20", "margin=25", "workers=1")


@pytest.fixture(scope="module")
def track(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_road(tmp_path_factory.mktemp("road"))


@pytest.fixture(scope="module")
def checkpoint(track: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_daylight(tmp_path_factory.mktemp("run") / "best.ckpt", track)


@pytest.fixture(scope="module")
def folder(checkpoint: Path, track: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a guard's command: daylight drives pass, and the dark one fails."""
    out = tmp_path_factory.mktemp("out") / "guard"
    small = ("laps=0.6", "nominal=2", "levels=1", "degraded=1", "epochs=15", "samples=2", "slow=12")
    files = ("method=autoencoder", f"table={out.with_suffix('.csv')}")
    guard.main([str(checkpoint), f"track={track}", f"out={out}", *files, *WORLD, *small])
    return out


def test_it_labels_windows_before_the_failures(folder: Path) -> None:
    found = json.loads((folder / "guard.json").read_text())
    failures = {one["kind"]: one["failures"] for one in found["drives"]}
    assert failures["nominal"] == 0
    assert failures["light"] > 0
    for figures in found["warnings"]["weather"]["autoencoder"].values():
        assert figures["recall"]["value"] == 1, "a dark image is like none of the nominal drives"
        assert figures["recall"]["low"] < 1
        assert figures["auc"]["value"] > 0.9
        assert figures["false_positive_rate"]["value"] < 0.5


def test_the_table_has_the_figures_of_each_group_score_and_lead(folder: Path) -> None:
    found = json.loads((folder / "guard.json").read_text())["warnings"]
    with folder.with_suffix(".csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {(one["group"], one["score"]) for one in rows} == {
        (group, score) for group, scores in found.items() for score in scores
    }
    row = next(one for one in rows if (one["group"], one["score"]) == ("weather", "autoencoder"))
    figures = found["weather"]["autoencoder"][row["lead_s"]]
    assert float(row["recall"]) == figures["recall"]["value"]
    assert float(row["recall_low"]) == figures["recall"]["low"]


def test_scores_that_the_network_lacks_are_named(folder: Path) -> None:
    found = json.loads((folder / "guard.json").read_text())
    assert "dropout" not in found["scores"]
    assert any("no dropout" in one for one in found["notes"])
    page = (folder / "guard.html").read_text()
    assert "no dropout" in page
    assert "ThirdEye" in page
    assert (folder / "guard.png").stat().st_size > 10_000


def test_paired_drives_count_interventions_and_alarms(folder: Path) -> None:
    pairs = json.loads((folder / "guard.json").read_text())["paired"]
    by_kind = {one["condition"].split()[0]: one for one in pairs}
    dark = by_kind["light"]
    assert dark["guarded"]["alarms"] > 0
    assert dark["guarded"]["speed_mph"] < dark["without"]["speed_mph"]
    assert dark["slower"]["speed_mph"] == pytest.approx(dark["guarded"]["speed_mph"], abs=2)
    assert dark["slower"]["alarms"] == dark["without"]["alarms"] == 0


def test_evaluate_drives_with_the_guard_and_without(
    folder: Path,
    checkpoint: Path,
    track: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
) -> None:
    out = tmp_path / "scores"
    dark = "weather={brightness: 0.08}"
    guard = f"guard={folder / 'guard.pt'}"
    evaluate([str(checkpoint), f"track={track}", dark, guard, f"out={out}", "laps=0.5", *WORLD])
    effect = json.loads((out / "metrics.json").read_text())["guard"]
    assert effect["alarms"] > 0
    assert effect["speed_mph"] < effect["speed_mph_without"]
    assert effect["interventions_without"] > 0
    assert "prevented per drive" in capsys.readouterr().out
    (drive,) = out.glob("*/drive.json")
    assert json.loads(drive.read_text())["guard_alarms"] == effect["alarms"]


def test_noise_in_the_weights_is_drawn_from_the_seed(checkpoint: Path) -> None:
    path = write_pilotnet(checkpoint.with_name("pilotnet.ckpt"))
    clean, first, again, other = (
        Noisy(str(path), noise).policy(None, Scenario(seed=seed)).network.head[0].weight.detach()
        for noise, seed in ((0.0, 1), (0.3, 1), (0.3, 1), (0.3, 2))
    )
    assert first.equal(again)
    assert not first.equal(other)
    network = Noisy(str(path), 0.3).policy(None, Scenario(seed=1)).network
    assert all(one.isfinite().all() for one in network.parameters())
    ratio = float((first - clean).std() / clean.std())
    assert ratio == pytest.approx(0.3, rel=0.2)


def test_the_guard_file_names_its_checkpoint(folder: Path, checkpoint: Path) -> None:
    guard = read_guard(folder / "guard.pt")
    assert guard.window == 5, "one second of frames"
    assert len(guard.sha256) == 64


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("method=magic", "method=magic"),
        ("method=ensemble", "drivezoo doubt"),
        ("weather=random", "weather=random"),
        ("track=lake,mountain", "name one track"),
        ("track=nowhere", "nowhere"),
        ("slow=1", "slow=1"),
    ],
)
def test_a_wrong_option_is_refused_before_a_drive(
    option: str, words: str, checkpoint: Path, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=words):
        guard.main([str(checkpoint), option, f"out={tmp_path / 'out'}"])
    assert not (tmp_path / "out").exists()


def test_a_method_that_the_network_lacks_is_refused_before_a_drive(
    checkpoint: Path, track: str, tmp_path: Path
) -> None:
    options = ("method=dropout", f"track={track}", f"out={tmp_path / 'out'}")
    with pytest.raises(InputError, match=r"method=dropout: .*no dropout"):
        guard.main([str(checkpoint), *options])
    assert not (tmp_path / "out").exists()


def test_a_guard_that_does_not_fit_is_one_line(checkpoint: Path, tmp_path: Path) -> None:
    result = run_here(tmp_path, str(checkpoint), f"guard={checkpoint}", module="zoo.evaluate")
    assert "is not a guard file" in only_line(result, 1)


def test_too_few_nominal_windows_are_one_line(checkpoint: Path, track: str, tmp_path: Path) -> None:
    small = ("nominal_laps=0.2", "nominal=1", "levels=1", "degraded=0", "epochs=1")
    with pytest.raises(InputError, match="nominal="):
        guard.main([str(checkpoint), f"track={track}", f"out={tmp_path / 'out'}", *WORLD, *small])
