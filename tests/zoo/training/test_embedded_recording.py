"""`data=lake`: recorded by the embedded simulator on first use, and never again."""

from pathlib import Path

import pytest

from tests.zoo.commands import only_line, run

# A few seconds of the lake, there and back.
SHORT = (
    "data.record.passes=[{track: lake, laps: 0.05, direction: both}]",
    "data.block_s=0.5",
    "data.gap_s=0.1",
    "experiment=tiny41",
    "trainer.max_epochs=1",
    "score=none",
)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run `python -m zoo` with a short recording and no other data; return its folder."""
    cwd = tmp_path_factory.mktemp("first_use")
    result = run(cwd, *SHORT, "hydra.run.dir=run")
    assert result.returncode == 0, result.stderr
    assert "recording 1 drives with the embedded simulator" in result.stdout
    return cwd


def test_it_trains_without_any_data(trained: Path) -> None:
    assert (trained / "run" / "checkpoints" / "best.ckpt").is_file()
    assert (trained / "outputs" / "recordings" / "lake" / "driving_log.csv").is_file()


def test_it_never_records_twice(trained: Path) -> None:
    log = trained / "outputs" / "recordings" / "lake" / "driving_log.csv"
    before = log.stat().st_mtime_ns
    result = run(trained, *SHORT, "hydra.run.dir=again")
    assert result.returncode == 0, result.stderr
    assert "embedded simulator" not in result.stdout
    assert log.stat().st_mtime_ns == before


def test_other_drives_under_the_same_name_are_refused(trained: Path) -> None:
    line = only_line(run(trained, "data.record.passes=[{laps: 0.1}]", "experiment=tiny41"))
    assert "recorded with other options" in line
    assert "set data.record.out" in line


def test_a_recording_of_ones_own_records_nothing(tmp_path: Path) -> None:
    line = only_line(run(tmp_path, "data.root=nowhere"))
    assert "nowhere" in line
    assert not (tmp_path / "outputs" / "recordings").exists()


@pytest.mark.parametrize(
    ("passes", "words"),
    [
        ("[{track: lak}]", "there is no track lak"),
        ("[{lapse: 1}]", "lapse"),
        ("[{laps: 0}]", "laps=0"),
    ],
)
def test_an_option_that_cannot_be_is_one_line(tmp_path: Path, passes: str, words: str) -> None:
    line = only_line(run(tmp_path, f"data.record.passes={passes}"))
    assert "data.record" in line
    assert words in line
    assert not (tmp_path / "outputs" / "recordings" / "lake").exists()
