"""The files of `.hydra`, with paths that are not UTF-8."""

import json
import os
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from tests.zoo.sweeps import write_run
from zoo.base.errors import InputError
from zoo.report.write_up import write_report
from zoo.runs.run import Run, load_config

ROOT = os.fsdecode(b"/laps\xff\xe4/lake")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Write a run whose recording and current folder have names of bytes that are not UTF-8."""
    folder = write_run(tmp_path / "run", overrides=(f"data.root='{ROOT}'",))
    for name in ("config", "hydra", "overrides"):  # again, as Hydra writes them
        path = folder / ".hydra" / f"{name}.yaml"
        content = json.loads(path.read_text())
        if name == "config":
            content = {"data": {"root": ROOT}, "model": {"name": "tiny"}}
        if name == "hydra":
            content["hydra"]["runtime"]["cwd"] = ROOT
        OmegaConf.save(OmegaConf.create(content), path)
        assert r"\uDCFF" in path.read_text()
    return folder


def test_paths_that_are_not_utf_8_are_read(run: Path) -> None:
    assert load_config(run).data.root == ROOT
    assert Run.open(run).started_in == Path(ROOT)
    assert Run.open(run).overrides[0] == f"data.root='{ROOT}'"


def test_a_run_with_such_paths_gets_its_report(run: Path) -> None:
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
