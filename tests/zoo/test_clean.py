"""`python -m zoo.clean`: only what drivezoo wrote, only what was chosen, only with remove=true."""

import os
import time
from pathlib import Path

import pytest

from datamodules.errors import InputError, UsageError
from zoo.clean import clean
from zoo.runs.status import write_status

CACHE_FILE = "0123456789abcdef01234567.npy"


@pytest.fixture
def outputs(tmp_path: Path) -> Path:
    folder = tmp_path / "outputs"
    for name in (
        f"cache/{CACHE_FILE}",
        "cache/notes.txt",
        "2026-01-02/10-11-12-000000/checkpoints/best.ckpt",
        "2026-01-02/10-11-13-000000/metrics.json",
        "2026-01-02/my notes/todo.txt",
        "sweeps/2026-01-03/10-11-12-000000/0/metrics.json",
        "evaluations/2026-01-03/10-11-12-000000/metrics.json",
        "recordings/lake/recipe.json",
        "recordings/mine/driving_log.csv",
        "thesis/2026.txt",
    ):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x" * 1000)
    return folder


def left(folder: Path) -> set[str]:
    return {str(one.relative_to(folder)) for one in folder.rglob("*") if one.is_file()}


def test_it_only_lists_without_being_told(outputs: Path, capsys: pytest.CaptureFixture) -> None:
    before = left(outputs)
    clean([str(outputs), "what=all"])
    assert left(outputs) == before
    out = capsys.readouterr().out
    assert "nothing was removed" in out
    assert "remove=true" in out
    for kind in ("cache", "runs", "sweeps", "evaluations", "recordings"):
        assert kind in out


def test_it_removes_the_cache_alone_unless_told_otherwise(outputs: Path) -> None:
    before = left(outputs)
    clean([str(outputs), "remove=true"])
    assert before - left(outputs) == {f"cache/{CACHE_FILE}"}


def test_what_others_wrote_stays(outputs: Path) -> None:
    (outputs / "link").symlink_to(outputs / "thesis")
    clean([str(outputs), "what=all", "remove=true"])
    mine = {"cache/notes.txt", "2026-01-02/my notes/todo.txt", "thesis/2026.txt"}
    assert left(outputs) == {*mine, "recordings/mine/driving_log.csv"}
    assert (outputs / "link").is_symlink()
    assert not (outputs / "sweeps" / "2026-01-03").exists()


def test_a_run_that_trains_and_what_is_new_stay(outputs: Path) -> None:
    first, second = sorted((outputs / "2026-01-02").glob("10-*"))
    write_status(first, "running")
    old = time.time() - 10 * 86_400
    for one in [*outputs.rglob("*"), outputs]:
        os.utime(one, (old, old))
    clean([str(outputs), "what=runs", "older_days=11", "remove=true"])
    assert second.exists()
    clean([str(outputs), "what=runs", "older_days=9", "remove=true"])
    assert first.exists()
    assert not second.exists()


@pytest.mark.parametrize(
    ("arguments", "kind", "words"),
    [
        (["nowhere"], InputError, "nowhere: no such folder"),
        (["all"], InputError, "what=all"),
        (["{}", "what=run"], UsageError, "did you mean runs"),
        (["{}", "older_days=-1"], UsageError, "older_days=-1"),
        (["{}", "{}"], UsageError, "name one folder"),
    ],
)
def test_bad_input_gets_one_line(
    arguments: list[str], kind: type[Exception], words: str, outputs: Path
) -> None:
    before = left(outputs)
    with pytest.raises(kind, match=words):
        clean([one.format(outputs) for one in arguments])
    assert left(outputs) == before
