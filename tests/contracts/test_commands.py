"""Every command: a typed function with the same grammar, help, hints and Python callable."""

import inspect
import re
import shutil
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import pytest
from pydantic import TypeAdapter

from tests.contracts.outside_package import manual_example, write_package
from tests.recordings import Written, write_recording
from tests.zoo.command_runs import ROOT, only_line, run, run_here, run_words
from tests.zoo.written_checkpoints import write_constant
from zoo.base.command import Command, command
from zoo.base.command_keys import Choice, changed, keys_of, meanings_of, typed
from zoo.base.console_script import ALIASES, GROUPS, LISTED, load, places
from zoo.base.errors import InputError, UsageError
from zoo.base.key_values import kinds_in, read_options
from zoo.base.terminal import command_line
from zoo.commands.simulator import all_commands
from zoo.driving.drive_log import write_drive
from zoo.driving.drive_record import Drive, DriveRow
from zoo.scoring.evaluate_options import EvaluateOptions, ReplayOptions

MOST_SHOWN = 27
# Trainings have a config in place of a signature, `simulator` has commands below it.
PLACES = places()
SPECIAL = ("train", "simulator")
COMMANDS = {name: load(entry) for name, entry in PLACES.items() if name not in SPECIAL}
COMMANDS |= {f"simulator {name}": cmd for name, cmd in all_commands().items()}
WITH_KEYS = [name for name, cmd in COMMANDS.items() if cmd.keys]
RANGED = [
    (name, key.name)
    for name, cmd in COMMANDS.items()
    for key in cmd.keys
    if key.kind in (int, float, bool) or get_origin(key.kind) is Annotated
    if not any(isinstance(mark, Choice) for mark in get_args(key.kind))
]


def arguments_of(called: Command[Any]) -> list[str]:
    """Return words for the needed arguments."""
    words = {"push|pull": "push", "bash|zsh|fish": "bash"}
    return [words.get(name, "x.ckpt") for name in called.arguments if name[0] != "["]


def test_the_help_shows_few_commands_and_old_names_still_work() -> None:
    shown = [name for group in GROUPS.values() for name in group]
    assert len(shown) == len(set(shown)) <= MOST_SHOWN
    assert {"doubt", "replay", "results", "rerun", "sweep"} == set(ALIASES)
    assert {"models", "tracks", "metrics"} < set(LISTED)


@pytest.mark.parametrize("name", COMMANDS)
def test_the_signature_and_the_docstring_say_the_same(name: str) -> None:
    documented = COMMANDS[name]
    assert documented.name == name or name in ("import", "list")
    assert documented.purpose.endswith(".")
    meanings = meanings_of(documented.function)
    assert all(meanings.get(parameter.name) for parameter in documented.arguments.values())
    names = [key.name for key in documented.keys]
    assert len(names) == len(set(names))
    assert "overwrite" in names or {"table", "plot"}.isdisjoint(names)
    for key in documented.keys:
        assert key.meaning, f"{key.name} has no meaning"
        if key.choices:
            assert key.typed in (*key.choices, "null")
        elif key.default is not inspect.Parameter.empty:
            assert TypeAdapter(key.kind).validate_python(key.default) == key.default


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_has_a_row_per_argument_and_key(name: str, capsys: pytest.CaptureFixture) -> None:
    cmd = COMMANDS[name]
    cmd.main(["--help"])
    printed = capsys.readouterr().out
    assert printed.startswith(f"usage: drivezoo {name}")
    assert max(map(len, printed.splitlines())) <= 100
    for argument in cmd.arguments:
        assert f"\n  {argument}" in printed
    for key in cmd.keys:
        assert f"\n  {command_line([f'{key.name}={key.typed}'])}" in printed


@pytest.mark.parametrize("name", WITH_KEYS)
def test_a_typo_names_the_right_key(name: str) -> None:
    cmd, key = COMMANDS[name], COMMANDS[name].keys[-1].name
    typo = f"{key[:-1]}{key[-1] * 2}"
    with pytest.raises(UsageError, match=f"{typo}: no such key; did you mean .*{key}"):
        cmd.main([*arguments_of(cmd), f"{typo}=1"])
    with pytest.raises(UsageError, match="no such key"):
        cmd(*arguments_of(cmd), **{typo: 1})


@pytest.mark.parametrize(("name", "key"), RANGED)
def test_a_value_of_another_type_names_the_key(name: str, key: str) -> None:
    called = COMMANDS[name]
    words = arguments_of(called)
    needed = {"out": "x"} if name == "simulator record" else {}
    with pytest.raises(UsageError, match=f"^{key}=many: must be "):
        called.main([*words, f"{key}=many", *(f"{name}={text}" for name, text in needed.items())])
    (kind,) = (entry.kind for entry in called.keys if entry.name == key)
    if bool not in kinds_in(kind):
        with pytest.raises(UsageError, match=f"^{key}=true: must be "):
            called(*words, **{key: True}, **needed)


@pytest.mark.parametrize("value", ["nan", "inf", float("nan"), float("-inf")])
def test_what_is_not_finite_is_no_number(value: object) -> None:
    with pytest.raises(UsageError, match="laps="):
        example(laps=value)


def test_a_value_out_of_range_names_the_range() -> None:
    with pytest.raises(UsageError, match=r"speed=99: must be a number in 1\.\.30$"):
        read_options(EvaluateOptions, ["speed=99"])
    with pytest.raises(UsageError, match=r"seeds=0: must be a whole number of 1 or more$"):
        read_options(EvaluateOptions, ["seeds=0"])


CHECKPOINTS = [name for name, cmd in COMMANDS.items() if "".join(cmd.arguments).startswith("CKPT")]


@pytest.mark.parametrize("name", CHECKPOINTS)
def test_a_checkpoints_path_is_taken_as_it_stands(name: str) -> None:
    path = "my run=[1], ${x} {a}/lr=0.1 'best'.ckpt"
    cmd = COMMANDS[name]
    with pytest.raises(InputError) as failed:
        cmd.main([path, *arguments_of(cmd)[1:]])
    assert str(failed.value).startswith(f"{path}: no such checkpoint")


@command
def example(*, out: str | None = None, options: EvaluateOptions) -> tuple[object, EvaluateOptions]:
    """Return the values.

    Args:
        out: file to write.
        options: see `EvaluateOptions`.
    """
    return out, options


@pytest.mark.parametrize("out", ["a b", "lr=0.1,[x]", "it's", "C:\\x", "~tilde", "${x}", "1e5"])
def test_a_path_among_the_options_is_taken_as_it_stands(out: str) -> None:
    assert read_options(EvaluateOptions, [f"out={out}"]).out == out


@pytest.mark.parametrize(
    ("text", "keyword", "key", "value"),
    [
        ("laps=2", {"laps": 2}, "laps", 2.0),
        ("--laps=2", {"laps": "2"}, "laps", 2.0),
        ("--film", {"film": True}, "film", True),
        ("track=lake,mountain", {"track": ["lake", "mountain"]}, "tracks", ["lake", "mountain"]),
        ("weather={fog: 0.4}", {"weather": {"fog": 0.4}}, "weather", "{fog: 0.4}"),
        ("margin=null", {"margin": None}, "margin", None),
        ("direction=backward", {"direction": -1}, "direction", -1),
        ("out=a", {"out": Path("a")}, "out", "a"),
    ],
)
def test_a_text_and_a_value_of_python_mean_the_same(
    text: str, keyword: dict[str, object], key: str, value: object
) -> None:
    assert getattr(read_options(EvaluateOptions, [text]), key) == value
    if key != "out":
        assert getattr(example(**keyword)[1], key) == value


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["evaluate", "x", "laps=1", "evaluate.laps=2"], "laps: given twice"),
        (["evaluate", "laps=2"], "CKPT comes first"),
        (["evaluate"], "usage: drivezoo evaluate CKPT"),
        (["evaluate", "x", "y"], "takes no further arguments"),
        (["evaluate", "x", "replay=a", "replay=b"], "replay: given twice"),
        (["demo", "x"], "demo takes no arguments"),
        (["report", "x", "a=1"], "report takes no options"),
        (["drive", "x", "speed=cnstant"], "did you mean constant"),
        (["drive", "x", "speed=constant", "speed.kp=1"], "speed.kp: no such key"),
    ],
)
def test_wrong_use_prints_its_remedy(arguments: list[str], words: str, tmp_path: Path) -> None:
    result = run_here(tmp_path, *arguments[1:], module=PLACES[arguments[0]].partition(":")[0])
    assert words in only_line(result, 2)


def test_changed_keys_are_typed_with_the_name_of_their_section() -> None:
    words = ["margin=0.5", "data.format=table", "data.columns={image: path, steering: angle}"]
    assert changed(read_options(ReplayOptions, words)) == words


def test_a_default_is_typed_as_users_type_it() -> None:
    keys = {key.name: key for key in keys_of(EvaluateOptions)}
    assert (keys["film"].typed, keys["out"].typed, keys["laps"].typed) == ("false", "null", "1.0")
    assert typed({"fog": 0.4}) == "{fog: 0.4}"


def test_a_command_of_another_package_is_one_like_ours(tmp_path: Path) -> None:
    site, code = tmp_path / "site", manual_example("lap_counter.py")
    names = "".join(f"{name} = lap_counter:count_laps\n" for name in ("count_laps", "evaluate"))
    write_package(site, "lap_counter", code, f"[drivezoo.commands]\n{names}")
    main = "import sys; from zoo.base.console_script import main; sys.exit(main())"
    outside = partial(run_words, tmp_path, sys.executable, "-c", main, PYTHONPATH=f"{site}:{ROOT}")

    shown = outside("--help").stdout
    assert "count_laps  count the laps of a drive" in shown
    assert "  evaluate    score a checkpoint" in shown, "ours go first"
    assert "lap_m=500.0" in outside("count_laps", "--help").stdout
    assert "no drive: no such folder" in only_line(outside("count_laps", "no drive"), 1)
    wrong = only_line(outside("count_laps", "a", "lap_m=0"), 2)
    assert "lap_m=0: must be a number above 0, up to 5000" in wrong
    assert "did you mean count_laps?" in outside("count_lap").stderr
    drive = Drive.of([DriveRow(0.0), DriveRow(0.1)])
    write_drive(tmp_path / "drive", replace(drive, driven_m=1900.0))
    assert outside("count_laps", "drive", "lap_m=900").stdout == "2 laps\n"
    assert len(code.splitlines()) < 40


# Commands whose output cannot be written: what is in the way, and the words.
IN_THE_WAY = {
    "hub": ("push", "tiny41", "repo=./full"),
    "hub, a file": ("push", "tiny41", "repo=./file"),
    "drive": ("tiny41", "port=0", "record=file"),
    "drive, in a file": ("tiny41", "port=0", "record=file/x"),
    "drive, a recording": ("tiny41", "port=0", "record=lake"),
    "edit": ("lake", "page=false", "out=full"),
    "edit, in a file": ("lake", "page=false", "drop=1-3", "out=file/x"),
    "convert": ("lake", "out=full"),
    "convert, in a file": ("lake", "out=file/x"),
    "evaluate": ("tiny41", "track=lake", "out=full"),
    "grade": ("class", "out=file"),
    "export": ("tiny41", "out=file/x.onnx"),
}


@pytest.mark.parametrize("case", [case for case in IN_THE_WAY if case.partition(",")[0] in PLACES])
def test_a_refused_output_names_a_real_key(case: str, recorded: Written, tmp_path: Path) -> None:
    shutil.copytree(recorded.folder, tmp_path / "lake")
    for folder in ("full", "class"):
        (tmp_path / folder).mkdir()
        write_constant(tmp_path / folder / "a.ckpt", 0.0)
    (tmp_path / "file").touch()
    name = case.partition(",")[0]
    module = PLACES[name].partition(":")[0]
    line = run(tmp_path, *IN_THE_WAY[case], module=module).stderr.splitlines()[-1]
    names = re.findall(r"([\w.]+)=", line)
    assert names, line
    assert set(names) <= {key.name for key in COMMANDS[name].keys}
    assert ".part" not in line
    assert "free some space" not in line


@pytest.mark.parametrize("name", ["check", "edit", "convert"])
def test_a_key_of_a_training_that_a_message_names_is_taken(name: str, here: Path) -> None:
    folder = str(write_recording(here / "lake", rows=30).folder)
    given = {"edit": ["page=false", "out=a"], "convert": ["to=donkeycar", "out=a"]}.get(name, [])
    key = "data.steering={unit: share, right: negative}"
    COMMANDS[name].main([folder, *given, key])
    with pytest.raises(UsageError, match="given twice"):
        COMMANDS[name].main([folder, *given, key, key.removeprefix("data.")])
    with pytest.raises(UsageError, match=r"data\.ofset: no such key"):
        COMMANDS[name].main([folder, *given, "data.ofset=1"])
