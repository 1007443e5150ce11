"""One grammar for all commands: the same keys, help, hints for typos and exit statuses."""

from dataclasses import fields
from pathlib import Path

import pytest
import yaml

from tests.zoo.cli.command_kinds import KINDS, command_options
from tests.zoo.commands import only_line, run
from zoo.cli.command_config import read_keys, read_options
from zoo.cli.conf_files import command_keys, conf_folder

# What stands before the options.
ARGUMENTS = {
    "clean": [],
    "compare": ["a", "b"],
    "benchmark": ["x.ckpt"],
    "convert": ["folder"],
    "correct": ["x.ckpt"],
    "doctor": [],
    "doubt": ["x.ckpt"],
    "drive": ["x.ckpt"],
    "edit": ["folder"],
    "evaluate": ["x.ckpt"],
    "export": ["x.ckpt"],
    "film": ["folder"],
    "guard": ["x.ckpt"],
    "hub": ["push", "x.ckpt"],
    "import": ["model.h5"],
    "leaderboard": ["folder"],
    "replay": ["x.ckpt", "recording"],
    "rerun": ["run"],
    "results": ["run"],
    "saliency": ["x.ckpt", "image.png"],
    "search": ["x.ckpt"],
    "sweep": [],
}
# A key of each, mistyped, and a value of another type where a key takes no text.
TYPOS = {
    "clean": ("remov=true", "remove", "older_days=many"),
    "compare": ("ou=x.json", "out", None),
    "benchmark": ("workerss=1", "workers", "workers=many"),
    "convert": ("speed_unti=mph", "speed_unit", "crf=best"),
    "correct": ("rouds=2", "rounds", "rounds=many"),
    "doctor": ("prot=4567", "port", "port=here"),
    "doubt": ("samplez=9", "samples", "samples=many"),
    "drive": ("expos=true", "expose", "laps=many"),
    "edit": ("prot=4571", "port", "port=many"),
    "evaluate": ("trakc=lake", "track", "delay_s=long"),
    "export": ("frame=x", "frames", None),
    "film": ("fsp=3", "fps", "fps=fast"),
    "guard": ("levelz=3", "levels", "levels=many"),
    "hub": ("repoo=x", "repo", "send=many"),
    "import": ("recrding=x", "recording", "colour=green"),
    "leaderboard": ("tble=x.csv", "table", None),
    "replay": ("marign=1", "margin", "frames=some"),
    "rerun": ("trsut=x", "trust", None),
    "results": ("metric=true", "metrics", "metrics=all"),
    "saliency": ("ou=x.png", "out", "published=2013"),
    "search": ("budgt=9", "budget", "budget=many"),
    "sweep": ("resum=x", "resume", None),
}
OWN = sorted(path.stem for path in conf_folder().glob("*.yaml") if path.stem != "config")


def test_every_command_with_a_yaml_is_tested() -> None:
    assert sorted(ARGUMENTS) == sorted(TYPOS) == OWN
    assert sorted([*KINDS, "doctor"]) == OWN


@pytest.mark.parametrize("name", KINDS)
def test_the_yaml_and_the_dataclass_have_the_same_keys(name: str) -> None:
    assert set(read_keys(name, [])) == {field.name for field in fields(KINDS[name])}
    assert command_options(name)


@pytest.mark.parametrize("name", OWN)
def test_help_names_every_key_with_its_default_and_meaning(name: str, tmp_path: Path) -> None:
    result = run(tmp_path, *ARGUMENTS[name], "--help", module=f"zoo.{name}")
    assert result.returncode == 0, result.stderr
    composed = _flat(read_keys(name, []))
    shown = {one.name: one for one in command_keys(name)}
    assert set(shown) - {"speed"} == set(composed) - {"speed"}
    for key, one in shown.items():
        assert f"{key}={one.default}" in result.stdout
        assert one.comment, f"{name}.{key} has no comment"
        if key in composed:
            assert (yaml.safe_load(one.default) or None) == (composed[key] or None)


@pytest.mark.parametrize("name", OWN)
def test_a_typo_names_the_right_key(name: str, tmp_path: Path) -> None:
    typo, right, _ = TYPOS[name]
    result = run(tmp_path, *ARGUMENTS[name], typo, module=f"zoo.{name}")
    assert result.returncode == 2
    assert f"{typo.partition('=')[0]}: no such key; did you mean {right}" in only_line(result)


@pytest.mark.parametrize("name", [name for name in OWN if TYPOS[name][2]])
def test_a_value_of_another_type_names_the_key(name: str, tmp_path: Path) -> None:
    wrong = TYPOS[name][2]
    result = run(tmp_path, *ARGUMENTS[name], wrong, module=f"zoo.{name}")
    assert result.returncode == 2
    assert f"{wrong}: must be " in only_line(result)


@pytest.mark.parametrize("name", [name for name in OWN if ARGUMENTS[name][:1] == ["x.ckpt"]])
def test_a_checkpoints_path_is_taken_as_it_stands(name: str, tmp_path: Path) -> None:
    path = "my run=[1], ${x} {a}/lr=0.1 'best'.ckpt"
    result = run(tmp_path, path, *ARGUMENTS[name][1:], module=f"zoo.{name}")
    assert result.returncode == 1
    assert f"{path}: no such checkpoint" in only_line(result)


@pytest.mark.parametrize("out", ["a b", "lr=0.1,[x]", "it's", "C:\\x", "~tilde", "${x}", "1e5"])
def test_a_path_among_the_options_is_taken_as_it_stands(out: str) -> None:
    assert read_options("film", KINDS["film"], [f"out={out}"]).out == out


@pytest.mark.parametrize(
    ("typed", "key", "value"),
    [
        ("laps=2", "laps", 2.0),
        ("evaluate.laps=2", "laps", 2.0),
        ("--laps=2", "laps", 2.0),
        ("--film", "film", True),
        ("track=lake,mountain", "tracks", ["lake", "mountain"]),
        ("weather={fog: 0.4, wet: 1}", "weather", "{fog: 0.4, wet: 1}"),
        ("margin=null", "margin", None),
        ("perturb=all", "perturb", "all"),
        ("delay_s=0.2", "delay_s", 0.2),
        ("direction=backward", "direction", -1),
        ("direction=-1", "direction", -1),
    ],
)
def test_values_mean_what_they_say(typed: str, key: str, value: object) -> None:
    assert getattr(read_options("evaluate", KINDS["evaluate"], [typed]), key) == value


def _flat(section: dict, prefix: str = "") -> dict:
    found = {}
    for key, value in section.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{prefix}{key}.")
        elif not key.startswith("_"):
            found[f"{prefix}{key}"] = value
    return found
