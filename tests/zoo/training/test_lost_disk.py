"""A disk that is full, or a folder that is removed, while a run trains."""

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.recordings import Written
from tests.zoo.trainings import SMALL
from zoo.checkpoints.checkpoint import load_checkpoint

Zoo = Callable[..., int]
posix = pytest.mark.skipif(os.name != "posix", reason="limits the size of files")


def spoiled(name: str, **settings: object) -> list[str]:
    given = [f"+callbacks.spoil.{key}={value}" for key, value in settings.items()]
    return [f"+callbacks.spoil._target_=tests.zoo.spoil.{name}", *given]


@pytest.fixture
def arguments(recorded: Written, tmp_path: Path) -> list[str]:
    cache = f"data.cache={tmp_path / 'cache'}"
    return [*SMALL, f"data.root={recorded.folder}", cache, "trainer.max_epochs=4"]


@pytest.fixture
def unlimited() -> Iterator[None]:
    """Restore the limit on the size of files after the test."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@posix
@pytest.mark.usefixtures("unlimited")
def test_a_checkpoint_that_cannot_be_written_is_named_and_the_last_one_kept(
    arguments: list[str], tmp_path: Path, zoo: Zoo, capsys: pytest.CaptureFixture
) -> None:
    limit = spoiled("LimitFiles", epoch=2, limit=5_000)
    assert zoo(*arguments, *limit, "hydra.run.dir=run") == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    checkpoints = tmp_path / "run" / "checkpoints"
    assert f"{checkpoints}/" in line
    assert "File too large" in line
    assert f"{checkpoints / 'last.ckpt'} is kept" in line
    assert f"resume={tmp_path / 'run'}" in line
    assert {path.name for path in checkpoints.iterdir()} == {"best.ckpt", "last.ckpt"}
    assert load_checkpoint(checkpoints / "last.ckpt").network is not None
    assert json.loads((tmp_path / "run" / "status.json").read_text())["status"] == "failed"


@pytest.mark.parametrize("small_disk", ["8m"], indirect=True)
def test_a_full_disk_is_named_and_the_run_resumed_when_there_is_room(
    arguments: list[str], small_disk: Path, zoo: Zoo, capsys: pytest.CaptureFixture
) -> None:
    run = small_disk / "run"
    more = ("callbacks=checkpoints", "logger=csv", *spoiled("FillDisk", epoch=2))
    assert zoo(*arguments, *more, f"hydra.run.dir={run}") == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert f"{run}/" in line
    assert "No space left on device" in line
    assert f"{run / 'checkpoints' / 'last.ckpt'} is kept" in line
    (run / "filler").unlink()
    assert zoo(f"resume={run}", "callbacks.spoil=null") == 0
    assert json.loads((run / "metrics.json").read_text())["epochs"] == 4


def test_a_folder_removed_in_the_middle_is_named_in_one_line(
    arguments: list[str], tmp_path: Path, zoo: Zoo, capsys: pytest.CaptureFixture
) -> None:
    remove = spoiled("RemoveFolder", epoch=1)
    assert zoo(*arguments, *remove, "hydra.run.dir=run") == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert f"{tmp_path / 'run'} was removed" in line
    assert not (tmp_path / "run").exists()
