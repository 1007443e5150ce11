"""Parts outside drivezoo: named by the user, never by a checkpoint or a run's folder."""

import importlib
import json
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from datamodules.known_formats import formats
from datamodules.view import View
from tests.contracts.outside_package import installed
from tests.recordings import Written
from tests.refusals import refusal
from tests.zoo.base.user_parts import write_network
from tests.zoo.command_runs import only_line, run, succeed
from tests.zoo.trainings import SMALL
from zoo.base.bounded_files import hash_file
from zoo.base.compose import choices, compose_config
from zoo.base.errors import InputError
from zoo.base.parts import _installed, name_parts, take_parts
from zoo.base.run_command import run_command
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.commands.rerun import _report
from zoo.driving.metrics import METRICS
from zoo.models.make_network import make_network
from zoo.runs.saved_config import find_refusals
from zoo.training.sweep_record import SavedSweep, check_overrides

VIEW = View((0, 0), "gray", (16, 32))
NAMED = "parts=my_net.py"
NameFile = Callable[[Path], None]


@pytest.fixture(scope="module")
def trained(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train a network of the user's own for an epoch, and return the folder of file and run."""
    folder = tmp_path_factory.mktemp("outside")
    write_network(folder)
    usual = [setting for setting in SMALL if not setting.startswith("model=")]
    places = (f"data.root={recorded.folder}", "data.cache=null", "hydra.run.dir=run")
    printed = succeed(run(folder, NAMED, "model=my_net", *usual, *places, "trainer.max_epochs=1"))
    assert NAMED in printed.partition("next: ")[2], "the next command names the part"
    return folder


@pytest.fixture
def workspace(trained: Path, tmp_path: Path) -> Path:
    """Return a copy of the folder, which a test may change."""
    return shutil.copytree(trained, tmp_path / "workspace")


@pytest.fixture
def named_here(monkeypatch: pytest.MonkeyPatch) -> Iterator[NameFile]:
    """Return a function that names a file of the user's in this process."""
    monkeypatch.setattr(sys, "path", sys.path.copy())
    yield lambda path: monkeypatch.setenv("DRIVEZOO_PARTS", str(path))
    sys.modules.pop("my_net", None)


@pytest.fixture
def part(tmp_path: Path, named_here: NameFile) -> Path:
    """Return a file with a network, which is named in this process."""
    path = write_network(tmp_path)
    named_here(path)
    return path


def test_the_variable_names_a_folder(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DRIVEZOO_PARTS", str(workspace))  # a folder: all its files
    succeed(run(workspace, "resume=run", "trainer.max_epochs=2"))
    assert json.loads((workspace / "run" / "metrics.json").read_text())["epochs"] == 2


@pytest.mark.parametrize(
    "words", [("zoo.commands.evaluate", "run"), ("zoo", "resume=run", "trainer.max_epochs=2")]
)
def test_a_run_runs_no_code_that_the_user_did_not_name(words: tuple, workspace: Path) -> None:
    (workspace / "my_net.py").write_text("raise SystemExit('it ran')\n")
    module, *arguments = words
    line = only_line(run(workspace, *arguments, module=module))
    assert "my_net.MyNet" in line
    assert NAMED in line


def test_a_checkpoint_drives_with_the_part_named(
    trained: Path, named_here: NameFile, capsys: pytest.CaptureFixture[str]
) -> None:
    named_here(trained / "my_net.py")
    command = load_policy(trained / "run")(np.zeros((160, 320, 3), np.uint8), 10.0)
    assert -1 <= command.steering <= 1
    assert capsys.readouterr().err == ""


def test_a_changed_file_is_reported_and_used(
    workspace: Path, named_here: NameFile, capsys: pytest.CaptureFixture[str]
) -> None:
    with (workspace / "my_net.py").open("a") as file:
        file.write("# changed\n")
    named_here(workspace / "my_net.py")
    load_checkpoint(workspace / "run")
    (line,) = capsys.readouterr().err.splitlines()
    assert "best.ckpt: my_net.py has changed" in line


def test_a_repeated_run_names_a_changed_file(
    trained: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    digest = hash_file(trained / "my_net.py")[:16]
    then = json.loads((trained / "run" / "metrics.json").read_text())
    _report(then, then | {"versions": then["versions"] | {"my_net.py": "now"}}, trained / "again")
    assert f"my_net.py: {digest} then, now now\n" in capsys.readouterr().out


def test_a_changed_file_that_does_not_fit_is_refused(workspace: Path, named_here: NameFile) -> None:
    code = (workspace / "my_net.py").read_text().replace("self.head", "self.last")
    (workspace / "my_net.py").write_text(code)
    named_here(workspace / "my_net.py")
    assert "lacks last.weight" in refusal(load_checkpoint, workspace / "run")


@pytest.mark.parametrize(
    ("word", "fault"),
    [
        ("parts=none.py", "no such file"),
        ("parts=.my_net", "no such file"),
        ("parts=~nobody/my_net.py", "no such file"),
        ("parts=no_such_module", "no such file or module"),
        ("parts=", "names no part"),
        ("parts=[]", "names no part"),
        (f"parts={'x' * 300}", "no such file or module"),
        ("parts=my-net.py", "rename it"),
        ("parts=empty", "holds no .py file"),
        ("parts=co:lon/my_net.py", "cannot be used"),
    ],
)
def test_a_wrong_name_is_refused(word: str, fault: str, here: Path) -> None:
    (here / "my-net.py").touch()
    write_network(here / "co:lon")
    (here / "empty").mkdir()
    with pytest.raises(InputError, match=f"^parts=.*{fault}") as failed:
        take_parts(["seed=1", word])
    assert word.removeprefix("parts=")[:20] in str(failed.value) or len(word) > 200


def test_a_saved_sweep_may_choose_a_named_part(tmp_path: Path, named_here: NameFile) -> None:
    sweep = SavedSweep(tmp_path / "sweep.json", ())
    with pytest.raises(InputError, match=r"model=my_net.*parts=FILE\.py"):
        check_overrides(["model=my_net"], sweep)
    named_here(write_network(tmp_path))
    check_overrides(["model=my_net"], sweep)


def test_an_installed_package_names_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One in the current folder does not."""
    package = tmp_path / "drivezoo_nets"
    write_network(package)
    (package / "__init__.py").touch()
    yaml = package / "conf" / "model" / "my_net.yaml"
    yaml.write_text(yaml.read_text().replace("my_net.MyNet", "drivezoo_nets.my_net.MyNet"))
    about = tmp_path / "drivezoo_nets-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: drivezoo-nets\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[drivezoo.parts]\nnets = drivezoo_nets\n")
    monkeypatch.syspath_prepend(tmp_path)
    try:
        _installed.cache_clear()
        assert "my_net" in choices("model")
        model = compose_config(["model=my_net"])["model"]
        assert type(make_network(model, VIEW)).__module__ == "drivezoo_nets.my_net"
        monkeypatch.chdir(tmp_path)
        _installed.cache_clear()
        assert "my_net" not in choices("model")
    finally:
        monkeypatch.undo()
        _installed.cache_clear()


def test_the_variable_takes_whole_paths(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a file of that name in a downloaded folder would run."""
    write_network(here)
    monkeypatch.setenv("DRIVEZOO_PARTS", "my_net.py")
    assert f"whole path; write {here}" in refusal(take_parts, [])


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (("import Tensor, nn", "import Tensor, nm"), "line 3: ImportError"),
        (("self.head((", "self.tail(("), "line 17: AttributeError"),
        (("outputs = 1", "outputs = 2"), "MyNet.forward returns [2, 1] for 2 images"),
        ((".flatten(1))", ".flatten(1))[:, 0]"), "MyNet.forward returns [2] for 2 images"),
        (("class MyNet", "class YourNet"), "defines no class MyNet"),
        (("def __init__(self,", "def __init__(self, depth,"), "argument: 'shape'"),
        (("class MyNet", "import sys; sys.exit(3)\nclass MyNet"), "line 6: SystemExit: 3"),
        (("super()", "raise BaseException('no'); super()"), "line 13: BaseException: no"),
        (("self.head(", "exit(self.head)("), "line 17: SystemExit: "),
        (("class MyNet(nn.Module)", "class MyNet"), "derive the class from torch.nn.Module"),
    ],
)
def test_a_mistake_in_the_file_is_one_line(change: tuple, fault: str, part: Path) -> None:
    part.write_text(part.read_text().replace(*change))
    assert fault in refusal(make_network, {"_target_": "my_net.MyNet"}, VIEW)


def test_a_file_that_is_edited_after_its_import_is_refused_until_a_reload(part: Path) -> None:
    make_network({"_target_": "my_net.MyNet"}, VIEW)
    part.write_text(part.read_text() + "# edited\n")
    with pytest.raises(InputError, match=r"my_net\.py: was edited .* restart Python"):
        name_parts([])
    importlib.reload(sys.modules["my_net"])
    name_parts([])


def test_a_metric_that_cannot_be_imported_is_never_left_out(part: Path) -> None:
    part.write_text("import no_module\n\n\n@metric\ndef turns(): ...\n")
    for _ in range(2):
        with pytest.raises(InputError, match=r"my_net\.py: line 1: .*no_module"):
            list(METRICS)


def test_a_yaml_file_that_is_added_later_is_a_choice(part: Path) -> None:
    conf = (part.parent / "conf").rename(part.parent / "later")
    assert "my_net" not in choices("model")
    conf.rename(part.parent / "conf")
    assert "my_net" in choices("model")


@pytest.mark.usefixtures("part")
@pytest.mark.parametrize(
    ("call", "fault"),
    [
        (lambda network: network(None), "line 17: TypeError: "),
        (lambda network: network(), "line 6: TypeError: MyNet.forward() missing"),
        (lambda network: network.newest, "line 6: AttributeError: 'MyNet' object has no"),
    ],
)
def test_an_error_of_a_part_in_a_command_is_one_line(
    call: Callable, fault: str, capsys: pytest.CaptureFixture[str]
) -> None:
    network = make_network({"_target_": "my_net.MyNet"}, VIEW)
    assert run_command("zoo", lambda _: call(network), []) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert f"my_net.py: {fault}" in line


def test_a_commands_own_exit_status_stays() -> None:
    with pytest.raises(SystemExit):
        run_command("zoo", sys.exit, [])


@pytest.mark.parametrize(
    ("statement", "line"),
    [
        ("ValueError('no wheel')", "outside_part: line 4: ValueError: no wheel; correct it"),
        ("InputError(f'{path}: no wheel; name one')", "nm: no wheel; name one"),
    ],
)
def test_an_installed_packages_error_is_its_own(
    statement: str, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = f"from zoo.base.errors import InputError\n\ndef read(path):\n    raise {statement}\n"
    with installed(tmp_path, code, "drivezoo.formats"):
        read = importlib.import_module("outside_part").read
        assert run_command("zoo", lambda _: read("nm"), []) == 1
    assert capsys.readouterr().err == f"zoo: {line}\n"


def test_a_format_with_a_name_of_ours_is_refused(tmp_path: Path, named_here: NameFile) -> None:
    code = "title = 'mine'\ndef detect(path): ...\ndef read(path, options): ...\n"
    named_here(tmp_path / "udacity.py")
    (tmp_path / "udacity.py").write_text(code)
    with pytest.raises(InputError, match=r"^udacity\.py: drivezoo has a format udacity; rename"):
        formats()
    named_here((tmp_path / "udacity.py").rename(tmp_path / "udacity_of_mine.py"))
    assert formats()["udacity_of_mine"].title == "mine"


@pytest.mark.parametrize("module", ["zoo", "zoo.commands.export"])
def test_a_part_without_a_network_is_named(module: str, workspace: Path) -> None:
    code = (workspace / "my_net.py").read_text()
    (workspace / "my_net.py").write_text(code.replace("class MyNet(nn.Module)", "class MyNet"))
    what = "resume=run" if module == "zoo" else "run"
    result = run(workspace, NAMED, what, module=module)
    assert result.returncode == 1
    assert "Traceback" not in result.stderr
    assert "my_net.py defines no such network" in result.stderr


def test_a_file_named_as_another_module_is_refused(tmp_path: Path, named_here: NameFile) -> None:
    path = write_network(tmp_path)
    named_here(path.rename(path.with_name("wave.py")))  # the name of one of Python's own modules
    with pytest.raises(InputError, match=r"another module wave .*; rename"):
        make_network({"_target_": "wave.MyNet"}, VIEW)


@pytest.mark.usefixtures("part")
def test_a_class_that_the_file_only_imports_is_refused() -> None:
    for name in ("my_net.Tensor", "my_net.nn.Linear", "my_net.nn"):
        assert "my_net" in refusal(make_network, {"_target_": name}, VIEW)


def test_a_saved_config_names_a_part_where_it_belongs(tmp_path: Path, named_here: NameFile) -> None:
    network = {"_target_": "my_net.MyNet"}
    config = dict.fromkeys(("model", "loss", "optim", "trainer"), network)
    config["callbacks"] = {"mine": network}
    assert len(list(find_refusals(config))) == 5, "no part is named yet"
    named_here(write_network(tmp_path))
    refused = [refusal.key for refusal in find_refusals(config)]
    assert refused == ["optim._target_", "trainer._target_", "callbacks.mine._target_"]


def test_a_choice_of_a_part_that_is_not_named_says_what_to_add(tmp_path: Path) -> None:
    write_network(tmp_path)
    line = only_line(run(tmp_path, "model=my_net", "--help"))
    assert "model=my_net: no such choice" in line
    assert "add parts=" in line


def test_a_yaml_that_hides_one_of_drivezoo_is_refused(tmp_path: Path) -> None:
    write_network(tmp_path)
    yaml = tmp_path / "conf" / "model" / "my_net.yaml"
    yaml.rename(yaml.with_name("lenet.yaml"))
    assert "drivezoo has model=lenet" in only_line(run(tmp_path, NAMED, "--help"))


def test_the_help_lists_the_parts_choices_and_keys(tmp_path: Path) -> None:
    write_network(tmp_path)
    printed = succeed(run(tmp_path, NAMED, "model=my_net", "--help"))
    (models,) = [line for line in printed.splitlines() if line.startswith("model: ")]
    assert "my_net" in models.split(": ")[1].split(", ")
    assert "model.bias=true" in printed
