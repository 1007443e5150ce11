"""Commands that are stopped or killed: no process is left, and a whole checkpoint."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import torch

from tests.recordings import Written
from tests.zoo.command_runs import command, environment, only_line, run, succeed
from tests.zoo.trainings import SMALL
from zoo.base.console_script import place_of
from zoo.base.whole_file import remove_parts
from zoo.checkpoints.checkpoint import load_checkpoint, read_checkpoint_file

pytestmark = [pytest.mark.slow, pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")]
SHM = Path("/dev/shm")

# Saves a checkpoint of 8 MB again and again; each holds its number.
SAVER = """
import sys, torch
from pathlib import Path
from zoo.checkpoints.checkpoint_files import CheckpointFiles
path, files = Path(sys.argv[1]), CheckpointFiles()
for number in range(1, 10_000):
    files.save_checkpoint({"number": number, "weights": torch.full((2_000_000,), number)}, path)
    print(number, flush=True)
"""


def start(cwd: Path, *words: str, stdout: int = subprocess.DEVNULL, **env: str) -> subprocess.Popen:
    """Start a program in a session and an environment of its own."""
    streams = {"stdout": stdout, "stderr": subprocess.PIPE, "text": True}
    env = environment() | env
    return subprocess.Popen(words, cwd=cwd, env=env, start_new_session=True, **streams)


@pytest.fixture(params=["tmp", "shm"])
def disk(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Path]:
    """Return a folder on the disk of temporary files, and one on another disk."""
    if request.param == "tmp":
        yield tmp_path
        return
    if not SHM.is_dir() or SHM.stat().st_dev == tmp_path.stat().st_dev:
        pytest.skip("/dev/shm is no second file system")
    import tempfile

    with tempfile.TemporaryDirectory(dir=SHM) as folder:
        yield Path(folder)


def test_a_kill_while_saving_leaves_the_last_whole_checkpoint(disk: Path, tmp_path: Path) -> None:
    path = disk / "checkpoints" / "last.ckpt"
    moments = random.Random(0)
    for _ in range(4):
        words = (sys.executable, "-c", SAVER, str(path))
        saver = start(tmp_path, *words, stdout=subprocess.PIPE, TMPDIR=str(tmp_path))
        first = int(saver.stdout.readline())
        time.sleep(moments.uniform(0, 0.2))
        saver.kill()
        printed = [first, *map(int, saver.stdout.read().split())]
        saver.wait()
        contents = torch.load(path, weights_only=True)
        assert contents["number"] in (printed[-1], printed[-1] + 1)
        assert bool((contents["weights"] == contents["number"]).all())
        remove_parts(path.parent)
        assert [file.name for file in path.parent.iterdir()] == ["last.ckpt"]
    assert not list(tmp_path.glob("*.part"))


def test_a_training_killed_thrice_resumes(disk: Path, recorded: Written, tmp_path: Path) -> None:
    folder = disk / "run"
    shm = {"TMPDIR": str(SHM)} if SHM.is_dir() else {}
    base = [*SMALL, f"data.root={recorded.folder}", f"data.cache={tmp_path / 'cache'}"]
    begin = command("zoo", *base, "trainer.max_epochs=100000", f"hydra.run.dir={folder}")
    last, epochs = folder / "checkpoints" / "last.ckpt", []
    moments = random.Random(1)
    for number in range(3):
        words = begin if not number else command("zoo", f"resume={folder}")
        training = start(tmp_path, *words, **shm)
        before = last.stat().st_mtime_ns if last.is_file() else 0
        while training.poll() is None and (not last.is_file() or last.stat().st_mtime_ns == before):
            time.sleep(0.02)
        time.sleep(moments.uniform(0, 0.5))
        training.kill()
        assert training.wait() == -9, training.stderr.read()
        epochs.append(read_checkpoint_file(last)["epoch"])
        load_checkpoint(last)
        # A file that a kill in the middle of a write leaves.
        (last.parent / ".last.ckpt.0123456789abcdef.part").write_bytes(bytes(55_000_000))
    assert epochs == sorted(epochs)
    succeed(run(tmp_path, f"resume={folder}", f"trainer.max_epochs={epochs[-1] + 2}"))
    assert {path.name for path in last.parent.iterdir()} == {"best.ckpt", "last.ckpt"}


def test_a_run_killed_between_checkpoints_names_one(recorded: Written, tmp_path: Path) -> None:
    base = [*SMALL, f"data.root={recorded.folder}", "trainer.max_epochs=1", "hydra.run.dir=run"]
    assert run(tmp_path, *base).returncode == 0
    checkpoints = tmp_path / "run" / "checkpoints"
    (checkpoints / "last.ckpt").unlink()
    status = tmp_path / "run" / "status.json"
    status.write_text(json.dumps(json.loads(status.read_text()) | {"status": "running", "pid": 0}))
    printed = succeed(run(tmp_path, "resume=run"))
    assert str(checkpoints / "best.ckpt") in printed
    assert "no last.ckpt" in printed


@pytest.mark.parametrize("small_disk", ["5500k"], indirect=True)
def test_a_run_on_a_full_disk_resumes(recorded: Written, small_disk: Path, tmp_path: Path) -> None:
    """The first checkpoint has 3 MB, the second does not fit; all loggers are on."""
    folder = small_disk / "run"
    base = [*SMALL, "model=nvidia", "data.crop=[40,20]", f"data.root={recorded.folder}"]
    more = [f"data.cache={tmp_path / 'cache'}", "trainer.max_epochs=2", f"hydra.run.dir={folder}"]
    line = only_line(run(tmp_path, *base, *more))
    best = folder / "checkpoints" / "best.ckpt"
    for text in ("No space left on device", f"resume={folder}", str(best)):
        assert text in line
    load_checkpoint(best)
    assert [path.name for path in best.parent.iterdir()] == ["best.ckpt"]
    subprocess.run(["mount", "-o", "remount,size=40m", str(small_disk)], check=True)
    succeed(run(tmp_path, f"resume={folder}"))
    assert json.loads((folder / "metrics.json").read_text())["epochs"] == 2


COMMANDS = {
    "benchmark": ("zoo.commands.benchmark", "lenet", "suite=quick", "workers=2"),
    "evaluate": ("zoo.commands.evaluate", "lenet", "seeds=4", "workers=2"),
    "record": ("zoo.commands.simulator", "record", "track=lake", "laps=3", "jobs=2"),
}
if place_of("search"):  # an extra
    COMMANDS["search"] = ("zoo.extras.research.search", "lenet", "workers=2")
HOW = {
    "Ctrl-C": (os.killpg, signal.SIGINT),
    "SIGINT": (os.kill, signal.SIGINT),
    "SIGHUP": (os.kill, getattr(signal, "SIGHUP", None)),
    "SIGUSR1": (os.kill, getattr(signal, "SIGUSR1", None)),
    "SIGTERM": (os.kill, signal.SIGTERM),
    "SIGKILL": (os.kill, signal.SIGKILL),
}


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_stopped_command_leaves_no_process(name: str, how: str, tmp_path: Path) -> None:
    send, number = HOW[how]
    process = start(tmp_path, *command(*COMMANDS[name], f"out={tmp_path / 'out'}"))
    try:
        time.sleep(random.uniform(2, 15))  # while it imports, starts processes, or drives
        send(process.pid, number)
        # The pipe of errors ends when the last process has ended.
        _, errors = process.communicate(timeout=60)
    finally:
        with suppress(ProcessLookupError):  # all have ended
            os.killpg(process.pid, signal.SIGKILL)
    lines = [line for line in errors.splitlines() if "comes with drivezoo" not in line]
    if process.returncode != -number or number == signal.SIGINT:
        # Python itself ends by SIGINT, which a shell sees as 130, if it came during an import.
        assert process.returncode in (130, -signal.SIGINT)
        assert len(lines) == 1, errors
        assert ": stopped" in lines[0]
    else:
        # SIGTERM ends it in silence before the command begins.
        assert number in (signal.SIGTERM, signal.SIGKILL)
        assert lines == []
