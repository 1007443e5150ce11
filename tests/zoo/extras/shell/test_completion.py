"""`drivezoo completion`: the script for bash, in a real bash."""

import re
import shutil
import subprocess
import sys
from io import BytesIO, TextIOWrapper
from pathlib import Path

import pytest

from tests.zoo.command_runs import only_line, run_here
from zoo.base.compose import choices
from zoo.base.console_script import commands, load
from zoo.extras.shell.completion import SCRIPTS, Words, command_words, completion

pytestmark = pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")

# What bash does at Tab, without any other program: it splits words at blanks and at =.
AT_TAB = r"""
PATH=
. "$1"
COMP_LINE="$2" COMP_POINT=${#2}
set -f
split="${2//=/ = }"
COMP_WORDS=($split)
set +f
case "$2" in *[[:space:]=]) COMP_WORDS+=("");; esac
COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
_drivezoo
for one in "${COMPREPLY[@]}"; do echo "$one"; done
"""


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("completion") / "drivezoo.bash"
    path.write_text(SCRIPTS["bash"](command_words()))
    return path


def completed(script: Path, line: str, cwd: Path) -> list[str]:
    """Return what bash offers at the end of a line; words end in a blank, keys do not."""
    words = [shutil.which("bash"), "--norc", "-c", AT_TAB, "bash", str(script), line]
    streams = {"capture_output": True, "text": True}
    result = subprocess.run(words, cwd=cwd, timeout=30, check=True, **streams)
    assert not result.stderr
    return result.stdout.splitlines()


def test_the_script_has_the_line_ends_of_bash_on_windows_too(monkeypatch) -> None:
    monkeypatch.setattr("sys.stdout", TextIOWrapper(BytesIO(), newline="\r\n"))
    completion("fish")
    sys.stdout.flush()
    assert b"\r" not in sys.stdout.buffer.getvalue()


def test_commands_are_completed(script: Path, tmp_path: Path) -> None:
    assert completed(script, "drivezoo eva", tmp_path) == ["evaluate "]
    offered = completed(script, "drivezoo ", tmp_path)
    assert {f"{command} " for command in commands()} <= set(offered)
    assert "tracks " in offered


def test_keys_of_a_command_are_completed(script: Path, tmp_path: Path) -> None:
    assert completed(script, "drivezoo evaluate latest film_", tmp_path) == ["film_speed="]
    offered = completed(script, "drivezoo drive latest ", tmp_path)
    assert {f"{key.name}=" for key in load("zoo.commands.drive:drive").keys} <= set(offered)
    assert "perturb=" not in offered


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("drivezoo evaluate latest track=udacity_m", ["udacity_mountain "]),
        ("drivezoo evaluate latest film=", ["true ", "false "]),
        ("drivezoo benchmark lenet suite=lat", ["latency "]),
        ("drivezoo drive latest speed=con", ["constant "]),
        ("drivezoo train model=le", ["lenet "]),
        ("drivezoo train data.spl", ["data.split=", "data.split_seed="]),
        ("drivezoo simulator rec", ["record "]),
        ("drivezoo simulator record lap", ["laps="]),
        ("drivezoo evaluate tiny4", ["tiny41 "]),
        ("drivezoo export lenet to=onn", ["onnx "]),
        ("drivezoo doctor --h", ["--help "]),
    ],
)
def test_values_are_completed(line: str, offered: list[str], script: Path, tmp_path: Path) -> None:
    assert completed(script, line, tmp_path) == offered


def test_files_are_completed(script: Path, tmp_path: Path) -> None:
    (tmp_path / "my run").mkdir()
    (tmp_path / "my.ckpt").touch()
    assert sorted(completed(script, "drivezoo evaluate my", tmp_path)) == ["my.ckpt ", "my\\ run/"]
    assert completed(script, "drivezoo film x out=my.", tmp_path) == ["my.ckpt "]


def test_no_name_of_a_part_is_run(tmp_path: Path) -> None:
    evil = "$(echo>pwned)"
    words = {"train": Words((evil, "fine"), {"model": (evil, "lenet")}), evil: Words((), {})}
    script, here = tmp_path / "a.bash", tmp_path / "here"
    here.mkdir()
    script.write_text(SCRIPTS["bash"](words))
    assert completed(script, "drivezoo train model=", here) == ["lenet "]
    assert "fine " in completed(script, "drivezoo train ", here)
    assert completed(script, "drivezoo ", here) == ["train "]
    assert not [*here.iterdir()]
    assert evil not in SCRIPTS["fish"]({"train": words["train"]})


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_the_scripts_of_other_shells_have_every_command_and_model(shell: str) -> None:
    text = SCRIPTS[shell](command_words())
    for name in (*commands(), *choices("model")):
        assert re.search(rf"\b{name}\b", text), name


def test_fish_tells_the_simulators_drive_from_the_command_of_that_name() -> None:
    script = SCRIPTS["fish"](command_words())
    (line,) = re.findall(r".*'__fish_seen_subcommand_from drive;.*", script)
    assert "drive; and not __fish_seen_subcommand_from simulator'" in line


def test_an_unknown_shell_is_one_line(tmp_path: Path) -> None:
    result = run_here(tmp_path, "bsh", module="zoo.extras.shell.completion")
    assert "did you mean bash?" in only_line(result, 2)
