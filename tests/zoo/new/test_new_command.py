"""New parts from templates: their tests pass, and the printed commands work, outside a checkout."""

import json
import re
import shlex
from pathlib import Path

import pytest

from tests.recordings import Written
from tests.zoo.commands import only_line, run
from tests.zoo.notebooks import FOLDER as NOTEBOOKS
from tests.zoo.trainings import SMALL

PARTS = {
    "model": "my_net",
    "augmentation": "my_augmentation",
    "loss": "my_loss",
    "callback": "my_callback",
    "track": "my_track",
}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[list[str]]]:
    """Write a part of each kind; return the folder and the words of the printed commands."""
    folder, following = tmp_path_factory.mktemp("outside"), []
    for kind, name in PARTS.items():
        result = run(folder, kind, name, module="zoo.new")
        assert result.returncode == 0, result.stderr
        for path in re.findall(r"^wrote: (.+)$", result.stdout, re.MULTILINE):
            assert (folder / path).is_file()
        lines = re.findall(r"^next: (.+)$", result.stdout, re.MULTILINE)
        following += [shlex.split(line, comments=True) for line in lines]
    return folder, following


def commands_of(following: list[list[str]], *program: str) -> list[list[str]]:
    """Return the arguments of each printed command of a program."""
    count = len(program)
    return [words[count:] for words in following if words[:count] == list(program)]


def test_the_written_tests_pass(written: tuple[Path, list[list[str]]]) -> None:
    folder, following = written
    files = [one for words in commands_of(following, "python", "-m", "pytest") for one in words]
    assert sorted(files) == sorted(f"test_{name}.py" for name in PARTS.values())
    result = run(folder, "-q", "-p", "no:cacheprovider", *files, module="pytest")
    assert result.returncode == 0, result.stdout


def test_the_printed_commands_show_train_and_drive_the_parts(
    written: tuple[Path, list[list[str]]], recorded: Written
) -> None:
    folder, following = written
    here = (f"data.root={recorded.folder}", "data.cache=null")
    (preview,) = commands_of(following, "drivezoo", "preview")
    result = run(folder, *preview, *here, module="zoo.preview")
    assert result.returncode == 0, result.stderr

    # The words of four commands, each of which trains with one of the parts.
    trainings = commands_of(following, "python", "-m", "zoo")
    assert len(trainings) == 4
    words = list(dict.fromkeys(word for one in trainings for word in one))
    small = [one for one in SMALL if not one.startswith(("model=", "callbacks="))]
    result = run(folder, *words, *here, *small, "quick_samples=160", "trainer.max_epochs=1")
    assert result.returncode == 0, result.stderr
    (metrics,) = folder.glob("outputs/*/*/metrics.json")
    assert json.loads(metrics.read_text())["model"] == "my_net"
    assert "my_callback" in metrics.with_name("metrics.csv").read_text().splitlines()[0]

    drives = commands_of(following, "drivezoo", "evaluate")
    merged = list(dict.fromkeys(word for one in drives for word in one))
    assert {"track=my_track.yaml", "parts=my_net.py"} <= set(merged)
    result = run(folder, *merged, "laps=0.02", "workers=1", "out=drives", module="zoo.evaluate")
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(("kind", "source"), [("notebook", "quickstart"), ("study", "study")])
def test_a_notebook_is_the_one_that_the_tests_run(kind: str, source: str, tmp_path: Path) -> None:
    result = run(tmp_path, kind, "mine", module="zoo.new")
    assert result.stdout.splitlines()[:2] == [
        "wrote: mine.ipynb",
        "next: jupyter lab mine.ipynb  # open it (pip install jupyterlab)",
    ]
    assert (tmp_path / "mine.ipynb").read_bytes() == (NOTEBOOKS / f"{source}.ipynb").read_bytes()
    assert "exists" in only_line(run(tmp_path, kind, "mine", module="zoo.new"))


@pytest.mark.parametrize(
    ("kind", "name", "found"),
    [
        ("modl", "my_net", "did you mean model"),
        ("model", "My-Net", "my_net"),
        ("model", "class", "my_net"),
        ("model", "lenet", "there is a model"),
        ("track", "zoo_lake", "there is a track"),
        ("loss", "json", "there is a Python module"),
    ],
)
def test_a_wrong_kind_or_name_is_refused(kind: str, name: str, found: str, tmp_path: Path) -> None:
    assert found in only_line(run(tmp_path, kind, name, module="zoo.new"))
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "test_my_net.py").write_text("mine")
    line = only_line(run(tmp_path, "model", "my_net", module="zoo.new"))
    assert "test_my_net.py: exists" in line
    assert [path.name for path in tmp_path.iterdir()] == ["test_my_net.py"]
    assert (tmp_path / "test_my_net.py").read_text() == "mine"
