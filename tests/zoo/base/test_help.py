"""`--help` of every command: short, useful, fast and without an error."""

import json
import sys

import pytest

from tests.zoo.command_runs import ROOT, run_words, succeed
from zoo.base.command_keys import typed_keys
from zoo.base.compose import choices, compose_with_choices, config_groups, key_comments
from zoo.base.console_script import commands
from zoo.commands.simulator import all_commands

GUARD = '\nif __name__ == "__main__":'
# `zoo` is `zoo.commands.train`; only other commands run the others, as subprocesses.
PROBES = (
    *("zoo", "zoo.server.renderer_check"),
    *("zoo.extras.studio.watched_network", "zoo.extras.teaching.submitted_network"),
)
TRAIN = "zoo.commands.train"
SIMULATOR = tuple(all_commands())
# Choices and ranges that a help must contain; the contract of commands
# (tests/contracts/test_commands.py) checks a row for each key.
NAMED = {
    TRAIN: ("data.offset=0.275", "experiment: action_chunk", "seed=1"),
    "zoo.commands.drive": ("one of bends",),
    "zoo.commands.film": ("plays as fast as it was driven", "(above 0, up to 1000)"),
    "zoo.commands.sweep": ("hydra/launcher=NAME",),
    "zoo.commands.simulator": SIMULATOR,
}
HAS_OWN = "zoo.commands.simulator"  # has commands of its own
MODULES = sorted({module for module in commands().values()} - {HAS_OWN})
ALL = [*MODULES, HAS_OWN, *(f"{HAS_OWN} {name}" for name in SIMULATOR)]
# Runs all commands in one process, so that modules are imported once.
ASK = """
import contextlib, io, json, runpy, sys
found = {}
for command in json.loads(sys.argv[1]):
    module, *rest = command.split()
    sys.argv = [module, *rest, "--help"]
    for name in [one for one in sys.modules if one == module]:
        del sys.modules[name]  # so that it runs as with `python -m`
    status = 0
    with contextlib.redirect_stdout(io.StringIO()) as out:
        try:
            runpy.run_module(module, run_name="__main__", alter_sys=True)
        except SystemExit as end:
            status = end.code or 0
    slow = sorted({"torch", "scipy", "panda3d", "matplotlib"} & {*sys.modules})
    found[command] = status, out.getvalue(), slow
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def helps(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str, list[str]]]:
    """Return by command its exit status, its output, and the slow libraries imported by then."""
    cwd = tmp_path_factory.mktemp("empty")
    words = (sys.executable, "-W", "ignore::RuntimeWarning", "-c", ASK, json.dumps(ALL))
    printed = succeed(run_words(cwd, *words))
    assert list(cwd.iterdir()) == [], "--help writes no files"
    return json.loads(printed)


@pytest.mark.parametrize("command", ALL)
def test_help_shows_the_usage_and_exits_with_0(command: str, helps: dict) -> None:
    status, text, slow = helps[command]
    assert status == 0
    module, *words = command.split()
    assert text.startswith(f"usage: drivezoo {' '.join([module.rpartition('.')[2], *words])}")
    for words in NAMED.get(command, ()):
        assert words in " ".join(text.split())
    assert slow == [], "--help must be fast"
    assert len(text.splitlines()) < (165 if command == TRAIN else 60)


def test_no_command_is_forgotten() -> None:
    for package in ("zoo", "datamodules"):
        for path in (ROOT / package).rglob("*.py"):
            # `zoo.base` has programs that start others.
            if GUARD in path.read_text() and path.parent != ROOT / "zoo" / "base":
                name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
                assert name.removesuffix(".__main__") in [*ALL, *PROBES], path


def test_the_help_of_zoo_explains_keys_by_the_chosen_yaml(helps: dict) -> None:
    lines = [line.split(maxsplit=1) for line in helps[TRAIN][1].splitlines()]
    shown = {words[0]: "".join(words[1:]) for words in lines if words}
    assert "left camera" in shown["data.offset=0.275"]
    assert "mph" in shown["score.speed=15.0"]
    assert "quick_samples" in shown["quick=false"]
    assert "528" not in shown["model.weights=null"], "a comment of model=vgg"


def test_the_help_of_zoo_lists_only_parts_of_its_config(helps: dict) -> None:
    _, text, _ = helps[TRAIN]
    groups = text.partition("Choices")[2].partition("Keys")[0]
    assert "\nmodel: " in groups
    for other in ("drive/speed", "\ntrack:", "hydra"):
        assert other not in groups


def test_every_key_of_a_training_has_a_meaning() -> None:
    """Whatever choice is made; a key below `model` may be described in another network's file."""
    groups = {group: choices(group) for group in config_groups()}
    silent = set()
    for number in range(max(map(len, groups.values()))):
        overrides = [f"{group}={names[number % len(names)]}" for group, names in groups.items()]
        config, chosen = compose_with_choices(overrides)
        meanings = key_comments(chosen)
        keys = [key for key, _ in typed_keys(config) if "._" not in key]
        silent |= {key for key in keys if not meanings.get(key)}
    assert silent == set()
