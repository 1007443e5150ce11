"""The files of a run: status, figures, config, and the code that trained it."""

import json
import math
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from tests.zoo.command_runs import ROOT
from tests.zoo.sweeps import write_run
from zoo.base.errors import InputError
from zoo.base.process_ranks import RANKS, is_first_process
from zoo.runs.code_fingerprint import code_fingerprint, commit_of, hash_of_code
from zoo.runs.metrics_file import VERSION, read_metrics_file, write_metrics_file
from zoo.runs.run_record import Run, load_config
from zoo.runs.status import is_alive, read_status, run_status
from zoo.scoring.write_up import write_report


@pytest.mark.parametrize(
    ("ranks", "first"),
    [
        ({}, True),
        # Processes of Lightning: the second on this node; the first and second on another node.
        ({"LOCAL_RANK": 1}, False),
        ({"NODE_RANK": 1}, False),
        ({"NODE_RANK": 1, "LOCAL_RANK": 1}, False),
        ({"NODE_RANK": 0, "LOCAL_RANK": 0}, True),
        # torchrun: the first on the second node has the local rank 0.
        ({"RANK": 2, "LOCAL_RANK": 0, "GROUP_RANK": 1}, False),
        ({"RANK": 0, "LOCAL_RANK": 0, "GROUP_RANK": 0}, True),
        # srun, and a batch script in which Lightning starts the second process.
        ({"SLURM_PROCID": 1}, False),
        ({"SLURM_PROCID": 0}, True),
        ({"SLURM_PROCID": 0, "LOCAL_RANK": 1}, False),
    ],
)
def test_the_first_process_is_recognized_by_its_environment(
    ranks: dict, first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in RANKS:
        monkeypatch.delenv(name, raising=False)
    for name, value in ranks.items():
        monkeypatch.setenv(name, str(value))
    assert is_first_process() is first
    assert is_first_process(several=False), "on one device, each process is its own run"


def test_only_the_first_process_writes_the_status(tmp_path: Path) -> None:
    with run_status(tmp_path, first=False):
        assert not list(tmp_path.iterdir())
    with run_status(tmp_path):
        assert read_status(tmp_path)["status"] == "running"
    assert read_status(tmp_path)["status"] == "finished"


def test_a_status_that_names_no_process_is_not_of_a_live_run(tmp_path: Path) -> None:
    (tmp_path / "status.json").write_text('{"status": "running", "pid": null}')
    assert not is_alive(tmp_path)


def test_written_metrics_are_read(tmp_path: Path) -> None:
    tracks = {"lake": {"drives": 2, "autonomy": (0.9, 0.1), "lap_s": None}}
    metrics = {"model": "tiny", "drive": {"tracks": tracks}, "wall_s": math.nan}
    path = write_metrics_file(tmp_path, metrics)
    assert json.loads(path.read_text())["version"] == VERSION
    metrics = read_metrics_file(tmp_path)
    assert (metrics["version"], metrics["wall_s"]) == (VERSION, None)
    assert metrics["drive"]["tracks"]["lake"]["autonomy"] == (0.9, 0.1)


@pytest.mark.parametrize("version", [{}, {"version": 2}, {"version": "1"}])
def test_a_file_of_an_unknown_version_is_refused(version: dict, tmp_path: Path) -> None:
    (tmp_path / "metrics.json").write_text(json.dumps(version | {"model": "tiny"}))
    with pytest.raises(InputError, match=r"metrics\.json: .*version"):
        read_metrics_file(tmp_path)


ODD = os.fsdecode(b"/laps\xff\xe4/lake")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Write a run whose recording and current folder have names of bytes that are not UTF-8."""
    folder = write_run(tmp_path / "run", overrides=(f"data.root='{ODD}'",))
    for name in ("config", "hydra", "overrides"):  # again, as Hydra writes them
        path = folder / ".hydra" / f"{name}.yaml"
        content = json.loads(path.read_text())
        if name == "config":
            content = {"data": {"root": ODD}, "model": {"name": "tiny"}}
        if name == "hydra":
            content["hydra"]["runtime"]["cwd"] = ODD
        OmegaConf.save(OmegaConf.create(content), path)
        assert r"\uDCFF" in path.read_text()
    return folder


def test_a_run_with_paths_that_are_not_utf_8_is_read_and_gets_its_report(run: Path) -> None:
    assert load_config(run).data.root == ODD
    assert Run.open(run).started_in == Path(ODD)
    assert Run.open(run).overrides[0] == f"data.root='{ODD}'"
    assert write_report(run).is_file()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (r'a: "\uD800"', "half"),  # no byte of a path
        (r'a: "\0"', "NUL"),
        ("a: !!python/object/apply:os.system ['touch ran']", "os.system"),
        ("a: &a [1]\nb: *a", "alias"),
        ("a: " + "[" * 5000, "64"),
    ],
)
def test_a_path_that_is_not_utf_8_allows_nothing_else(
    line: str, words: str, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(run)
    config = run / ".hydra" / "config.yaml"
    config.write_text(f"{config.read_text()}\n{line}\n")
    with pytest.raises(InputError, match=words) as raised:
        load_config(run)
    assert str(config) in str(raised.value)
    assert not (run / "ran").exists()


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """Copy our code without the other files of the checkout."""
    ignored = shutil.ignore_patterns("__pycache__")
    for name in ("conf", "zoo", "datamodules", "hydra_plugins"):
        shutil.copytree(ROOT / name, tmp_path / "copy" / name, ignore=ignored)
    return tmp_path / "copy"


def test_a_copy_has_the_same_hash_and_any_change_another(copy: Path) -> None:
    def digest() -> str:
        return hash_of_code(copy, copy / "conf")

    hashes = [code_fingerprint()["hash"]]
    assert digest() == hashes[0]
    (copy / "zoo" / "notes.txt").write_text("no code")
    lenet = copy / "zoo" / "models" / "lenet.py"
    lenet.write_bytes(lenet.read_bytes().replace(b"\n", b"\r\n"))  # as git does on Windows
    other = copy / "hydra_plugins" / "hydra_other" / "plugin.py"
    other.parent.mkdir()
    other.write_text("# another package's")
    assert digest() == hashes[0]
    for name in ("zoo/models/lenet.py", "conf/optim/adam.yaml"):
        with (copy / name).open("a") as file:
            file.write("# changed\n")
        hashes.append(digest())
    (copy / "zoo" / "new.py").touch()
    hashes.append(digest())
    (copy / "zoo" / "new.py").rename(copy / "zoo" / "renamed.py")
    hashes.append(digest())
    assert len(set(hashes)) == 5


def test_the_commit_is_only_that_of_our_own_checkout(tmp_path: Path) -> None:
    def git(*arguments: str) -> str:
        author = ("-c", "user.name=a", "-c", "user.email=a@b")
        command = ["git", "-C", str(tmp_path), *author, *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    inner = tmp_path / "site-packages"
    inner.mkdir()
    (tmp_path / "file").write_text("1")
    assert commit_of(tmp_path) is None
    git("init", "-q")
    git("add", "file")
    git("commit", "-q", "-m", "one")
    commit = git("rev-parse", "HEAD")[:12]
    assert commit_of(tmp_path) == commit
    assert commit_of(inner) is None, "a folder in another project's checkout"
    (tmp_path / "file").write_text("2")
    assert commit_of(tmp_path) == f"{commit}-dirty"
