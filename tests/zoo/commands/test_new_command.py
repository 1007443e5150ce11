"""New parts from templates: their tests pass, and the printed commands work, outside a checkout."""

import json
import os
import re
import shlex
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.recordings import Written
from tests.zoo.command_runs import ROOT, only_line, run, run_here, succeed
from tests.zoo.notebooks import FOLDER as NOTEBOOKS
from tests.zoo.trainings import SMALL
from zoo.base.conf_files import part_folders
from zoo.base.terminal import command_line
from zoo.commands.new import write_part

PACKAGES = ("drivezoo", "zoo", "datamodules", "hydra_plugins")
KINDS = ("augmentation", "loss", "callback", "format", "track")
PARTS = {"model": "my_net"} | {kind: f"my_{kind}" for kind in KINDS}


def as_checkout(folder: Path) -> Path:
    """Lay out the project in the folder; return the place from which Python imports it."""
    for name in (*PACKAGES, "notebooks"):
        (folder / name).symlink_to(ROOT / name)
    shutil.copytree(ROOT / "conf", folder / "conf")
    return folder


def as_wheel(folder: Path) -> Path:
    """Lay out the project as its wheel does, elsewhere; return that place."""
    site = folder.with_name("site-packages")
    for name in PACKAGES:
        (site / name).mkdir(parents=True)
        for path in (ROOT / name).iterdir():
            (site / name / path.name).symlink_to(path)
    for source, target in (("conf", "zoo/conf"), ("notebooks", "zoo/notebooks")):
        (site / target).symlink_to(ROOT / source)
    return site


@dataclass
class New:
    """A part of each kind: its folder, the project's code, and the printed commands' words."""

    folder: Path
    code: Path
    following: list[list[str]]

    def run(self, module: str, *arguments: str) -> str:
        """Return the output of a command, which succeeds."""
        return succeed(run(self.folder, *arguments, module=module, code=self.code, timeout=400))

    def commands(self, *program: str) -> list[list[str]]:
        """Return the arguments of each printed command of a program."""
        count = len(program)
        return [words[count:] for words in self.following if words[:count] == list(program)]


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(lambda folder: ROOT, id="outside"),
        pytest.param(as_checkout, id="checkout", marks=pytest.mark.slow),
        pytest.param(as_wheel, id="wheel", marks=pytest.mark.slow),
    ],
)
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> New:
    """Write a part of each kind."""
    folder = tmp_path_factory.mktemp("new") / "here"
    folder.mkdir()
    written = New(folder, request.param(folder), [])
    for kind, name in PARTS.items():
        printed = written.run("zoo.commands.new", kind, name)
        for path in re.findall(r"^wrote: (.+)$", printed, re.MULTILINE):
            assert (folder / path).is_file()
        lines = re.findall(r"^next: (.+)$", printed, re.MULTILINE)
        written.following += [shlex.split(line, comments=True) for line in lines]
    return written


def test_the_written_tests_pass(written: New) -> None:
    files = [word for words in written.commands("python", "-m", "pytest") for word in words]
    expected = [f"test_{name}.py" for name in PARTS.values()]
    assert sorted(Path(path).name for path in files) == sorted(expected)
    # In its own folder: from the usual one pytest clears the files of earlier runs, for minutes.
    written.run("pytest", "-q", "-p", "no:cacheprovider", "--basetemp=temporary", *files)


def test_the_printed_commands_train_and_drive_the_parts(written: New, recorded: Written) -> None:
    here = (f"data.root={recorded.folder}", "data.cache=null")
    (preview,) = written.commands("drivezoo", "preview")
    written.run("zoo.commands.preview", *preview, *here)

    # The words of four commands, each of which trains with one of the parts.
    trainings = written.commands("drivezoo", "train")
    assert len(trainings) == 4
    words = list(dict.fromkeys(word for training in trainings for word in training))
    small = [setting for setting in SMALL if not setting.startswith(("model=", "callbacks="))]
    written.run("zoo", *words, *here, *small, "quick_samples=160", "trainer.max_epochs=1")
    (metrics,) = written.folder.glob("outputs/*/*/metrics.json")
    assert json.loads(metrics.read_text())["model"] == "my_net"
    assert "my_callback" in metrics.with_name("metrics.csv").read_text().splitlines()[0]

    drives = written.commands("drivezoo", "evaluate")
    merged = list(dict.fromkeys(word for drive in drives for word in drive))
    assert {"my_track.yaml", "my_net.py"} <= {Path(re.sub(".*=", "", word)).name for word in merged}
    short = ("laps=0.01", "quality=simple", "workers=1", "out=drives")
    written.run("zoo.commands.evaluate", *merged, *short)
    (record,) = written.commands("drivezoo", "simulator", "record")
    written.run("zoo.commands.simulator", "record", *record, "laps=0.01")


def test_the_printed_commands_write_and_check_a_recording(written: New, recorded: Written) -> None:
    (convert,) = written.commands("drivezoo", "convert")
    (check,) = written.commands("drivezoo", "check")
    given = [str(recorded.folder), *convert[1:], "out=converted"]
    printed = written.run("zoo.commands.convert", *given)
    assert "recording -> folder of my_format: 120 rows" in printed
    assert "next: drivezoo check converted" in printed
    checked = written.run("zoo.commands.check", "converted", *check[1:])
    assert "all images are whole" in checked


def test_an_export_that_is_there_is_not_advised(tmp_path: Path) -> None:
    _, following = write_part("donkeycar", "pilot", tmp_path)
    assert following[0][0] == "drivezoo export latest out=pilot.onnx"
    (tmp_path / "pilot.py").rename(tmp_path / "pilot.onnx")
    assert write_part("donkeycar", "pilot", tmp_path)[1] == following[1:]


@pytest.mark.parametrize(
    ("command", "printed"),
    [
        ("drivezoo drive latest", "drivezoo drive latest parts=my_net.py"),
        ("drivezoo drive model.onnx", "drivezoo drive model.onnx"),
        ("drivezoo check FOLDER", "drivezoo check FOLDER parts=my_net.py"),
        ("drivezoo simulator drive", "drivezoo simulator drive"),
    ],
)
def test_a_command_to_paste_has_the_parts_that_it_needs(
    command: str, printed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.orig_argv", ["drivezoo", "export", "latest", "parts=my_net.py"])
    assert command_line(command.split()) == printed


def test_in_a_checkout_a_part_leaves_the_projects_files_alone(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "conf", tmp_path / "conf")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("zoo.base.conf_files.conf_folder", lambda: tmp_path / "conf")
        written, following = write_part("model", "its_net", tmp_path)
    assert not [path for path in written if tmp_path / "conf" in path.parents]
    assert {path.parents[-1 - len(tmp_path.parts)] for path in written} == {tmp_path / "my_parts"}
    assert "parts=my_parts/its_net.py" in following[1][0]


def test_a_checkouts_part_brings_no_yaml(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_net.py").write_text("")
    (tmp_path / "conf").symlink_to(ROOT / "conf")
    monkeypatch.setenv("DRIVEZOO_PARTS", str(tmp_path / "my_net.py"))
    monkeypatch.setattr("sys.path", sys.path.copy())
    assert tmp_path / "conf" not in part_folders()


@pytest.mark.parametrize(("kind", "source"), [("notebook", "quickstart"), ("study", "study")])
def test_a_notebook_is_the_one_that_the_tests_run(kind: str, source: str, tmp_path: Path) -> None:
    result = run_here(tmp_path, kind, "mine", module="zoo.commands.new")
    assert result.stdout.splitlines()[:3] == [
        "wrote: mine.ipynb",
        "next: jupyter lab mine.ipynb",
        "      open it (pip install jupyterlab)",
    ]
    assert (tmp_path / "mine.ipynb").read_bytes() == (NOTEBOOKS / f"{source}.ipynb").read_bytes()
    assert "exists" in only_line(run_here(tmp_path, kind, "mine", module="zoo.commands.new"))


@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        ("modl", "my_net", "did you mean model"),
        ("model", "My-Net", "my_net"),
        ("model", "class", "my_net"),
        ("model", "lenet", "there is a model"),
        ("track", "zoo_lake", "there is a track"),
        ("rig", "donkey_sim", "there is a rig"),
        ("format", "donkeycar", "there is a format"),
        ("loss", "json", "there is a Python module"),
    ],
)
def test_a_wrong_kind_or_name_is_refused(kind: str, name: str, words: str, tmp_path: Path) -> None:
    assert words in only_line(run_here(tmp_path, kind, name, module="zoo.commands.new"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("my_net.py", "my_net.py: exists"),
        ("test_my_net.py", "test_my_net.py: exists"),
        ("conf", "conf/model/my_net.yaml"),
    ],
)
def test_all_files_are_written_or_none_is(name: str, words: str, tmp_path: Path) -> None:
    if name == "my_net.py" and os.name == "posix":
        (tmp_path / name).symlink_to("nowhere")  # a broken link exists, too
    else:
        (tmp_path / name).write_text("mine")
    assert words in only_line(run_here(tmp_path, "model", "my_net", module="zoo.commands.new"))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert name == "my_net.py" or (tmp_path / name).read_text() == "mine"
