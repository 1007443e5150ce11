"""The networks that come trained: their files, their names, and that they drive."""

import hashlib
import re
from pathlib import Path

import pytest

import drivezoo
from benchmarks.study_grid import Study
from tests.zoo.commands import run_here, succeed
from zoo.checkpoints.checkpoint import read_checkpoint_file
from zoo.checkpoints.checkpoint_path import (
    PACKAGED,
    find_checkpoint,
    packaged_names,
    read_facts,
    short_name,
)
from zoo.checkpoints.policy import load_policy

MOST_BYTES = 3_000_000  # of the wheel
QUICK = "tiny41"


def test_the_files_are_small_and_each_is_described() -> None:
    assert set(packaged_names()) == {entry.name for entry in Study("pretrained", []).entries()}
    assert {path.stem for path in PACKAGED.glob("*.json")} == set(packaged_names())
    assert sum(path.stat().st_size for path in PACKAGED.iterdir()) < MOST_BYTES


@pytest.mark.parametrize("name", packaged_names())
def test_each_network_loads_and_its_hash_is_recorded(name: str) -> None:
    facts, path = read_facts(name), PACKAGED / f"{name}.ckpt"
    assert hashlib.sha256(path.read_bytes()).hexdigest() == facts["sha256"]
    assert load_policy(path).parameters == facts["parameters"]
    contents = read_checkpoint_file(path)
    assert set(contents) == {"drivezoo", "state_dict"}, "no optimizer"
    card = contents["drivezoo"]
    assert card["data"]["fingerprint"] == card["config"]["data"]["record"]["fingerprint"]
    assert not re.search(r"'(/|~|[A-Z]:)", str(card)), "no folder of the machine that trained it"


@pytest.mark.parametrize(
    "name",
    [
        one if one == QUICK else pytest.param(one, marks=pytest.mark.slow)
        for one in packaged_names()
    ],
)
def test_each_network_drives(name: str, here: Path, capsys: pytest.CaptureFixture) -> None:
    result = drivezoo.evaluate(name, track="lake", laps=0.1, out="out", workers=1)
    (figures,) = result.drives
    assert figures["interventions"] == 0
    assert figures["laps"] > 0.09


def test_a_name_is_a_checkpoint_wherever_one_is_taken(
    here: Path, capsys: pytest.CaptureFixture
) -> None:
    path = find_checkpoint(QUICK)
    assert path == PACKAGED / f"{QUICK}.ckpt"
    assert capsys.readouterr().err == f"{QUICK}: comes with drivezoo, {path}\n"
    assert short_name(path) == QUICK, "as the next command names it"


def test_a_file_of_that_name_goes_first_and_a_line_says_so(
    here: Path, capsys: pytest.CaptureFixture
) -> None:
    Path(QUICK).write_bytes(b"")
    assert find_checkpoint(QUICK) == find_checkpoint(QUICK) == Path(QUICK)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{QUICK}: the file of that name here")
    assert short_name(PACKAGED / f"{QUICK}.ckpt") != QUICK


def test_they_are_listed(tmp_path: Path) -> None:
    printed = succeed(run_here(tmp_path, "checkpoints", module="zoo.list"))
    for name in packaged_names():
        assert re.search(rf"^ +{name} +\w+, [\d,]+ parameters", printed, re.MULTILINE)
