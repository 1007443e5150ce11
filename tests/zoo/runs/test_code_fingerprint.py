"""A run's code fingerprint changes with the code, and with nothing else."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.zoo.commands import ROOT
from zoo.runs.code_fingerprint import code_fingerprint, commit_of, hash_of_code


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """Copy drivezoo's code without other files."""
    ignored = shutil.ignore_patterns("__pycache__")
    for name in ("conf", "zoo", "datamodules", "simulator", "hydra_plugins"):
        shutil.copytree(ROOT / name, tmp_path / "copy" / name, ignore=ignored)
    return tmp_path / "copy"


def test_a_copy_has_the_same_hash_and_any_change_another(copy: Path) -> None:
    def found() -> str:
        return hash_of_code(copy, copy / "conf")

    hashes = [code_fingerprint()["hash"]]
    assert found() == hashes[0]
    (copy / "zoo" / "notes.txt").write_text("no code")
    other = copy / "hydra_plugins" / "hydra_other" / "plugin.py"
    other.parent.mkdir()
    other.write_text("# another package's")
    assert found() == hashes[0]
    for name in ("zoo/models/lenet.py", "conf/optim/adam.yaml"):
        with (copy / name).open("a") as file:
            file.write("# changed\n")
        hashes.append(found())
    (copy / "zoo" / "new.py").touch()
    hashes.append(found())
    (copy / "zoo" / "new.py").rename(copy / "zoo" / "renamed.py")
    hashes.append(found())
    assert len(set(hashes)) == 5


def test_the_commit_is_only_that_of_drivezoos_checkout(tmp_path: Path) -> None:
    def git(*arguments: str) -> str:
        named = ("-c", "user.name=a", "-c", "user.email=a@b")
        command = ["git", "-C", str(tmp_path), *named, *arguments]
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
