"""`data=lake`: recorded by the embedded simulator on first use, and never again."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest
from omegaconf import OmegaConf, open_dict
from rich.console import Console

from datamodules.recording import read_recordings
from simulator.record import RecordOptions
from tests.zoo.commands import only_line, run
from zoo.base.errors import InputError
from zoo.cli.compose import compose_config, conf_folder
from zoo.training.run_config import with_recording

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
    """Run `drivezoo train` with a short recording and no other data; return its folder."""
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


def test_a_changed_recording_is_refused(trained: Path, tmp_path: Path) -> None:
    folder = tmp_path / "lake"
    shutil.copytree(trained / "outputs" / "recordings" / "lake", folder)
    right = read_recordings(str(folder)).fingerprint()
    config = OmegaConf.create(compose_config(["data=lake", SHORT[0], f"data.record.out={folder}"]))
    with open_dict(config):
        config.data.record.fingerprint = right
    assert with_recording(config, Console(quiet=True)).data.root == str(folder)
    log = folder / "driving_log.csv"
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:-1]))
    with pytest.raises(InputError, match=r"fingerprint=null") as refused:
        with_recording(config, Console(quiet=True))
    assert str(folder) in str(refused.value)
    assert right in str(refused.value)


def test_no_road_of_the_suite_is_in_its_training_data() -> None:
    suite = OmegaConf.load(conf_folder() / "suite" / "v1.yaml")
    data = compose_config([f"data={suite.data}"])["data"]
    driven = {one["track"] for one in data["record"]["passes"]}
    drives = [drive for group in suite.groups.values() for drive in group]
    kept_apart = {*suite.dev, *suite.laps, *(drive.track for drive in drives)}
    assert len(driven) == len(data["record"]["passes"]) == 40
    assert not driven & kept_apart


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


@pytest.mark.parametrize(
    ("jobs", "laps", "processes"), [("null", 0.5, 1), ("null", 1, 3), ("2", 0.5, 2), ("1", 1, 1)]
)
def test_a_long_recording_is_drawn_on_each_core(
    jobs: str, laps: float, processes: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def recorded(passes: Sequence[RecordOptions], _: Console) -> None:
        assert [one.jobs for one in passes] == [processes]
        assert Path(passes[0].out).is_dir()

    monkeypatch.setattr("simulator.record.record_laps", recorded)
    monkeypatch.setattr("zoo.training.run_config.usable_cores", lambda: 3)
    options = [f"jobs={jobs}", f"out={tmp_path / 'lake'}", f"passes=[{{laps: {laps}}}]"]
    config = compose_config([f"data.record.{one}" for one in options])
    with_recording(OmegaConf.create(config), Console(quiet=True))
    assert (tmp_path / "lake").is_dir()
