"""`--help` of every command: short, useful, fast and without an error."""

import json
import re
import subprocess
import sys

import pytest

from tests.zoo.commands import ROOT, environment
from zoo.cli.compose import choices, compose_with_choices, config_groups
from zoo.cli.config_help import key_comments, typed_keys

GUARD = '\nif __name__ == "__main__":'
PROBE = "zoo.doctor.renderer"  # only the doctor runs it, as a subprocess
SIMULATOR = ("record", "drive", "client")
# Texts that each help must contain besides the usage: options, or files that the command writes.
NAMED = {
    "zoo": ("data.offset=0.275", "experiment: action_chunk", "seed=1"),
    "zoo.clean": ("older_days=0.0", "remove=false"),
    "zoo.search": ("family=alpine", "budget=200", "mildest failing road"),
    "zoo.completion": ("bash|zsh|fish", "~/.bashrc"),
    "zoo.compare": ("out=compare.json", "result.json"),
    "zoo.benchmark": ("suite=v1", "expert_late", "result.json"),
    "zoo.convert": ("to=null", "crf=18", "fit=keep"),
    "zoo.correct": ("track=", "out="),
    "zoo.demo": ("trains PilotNet",),
    "zoo.doctor": ("CKPT", "RECORDING", "port=4567"),
    "zoo.doubt": ("samples=20", "an ensemble", "out=doubt.ckpt"),
    "zoo.drive": ("port=4567", "speed=pi", "one of bends"),
    "zoo.edit": ("drop=null", "page=true", "FOLDER..."),
    "zoo.evaluate": ("laps=1.0", "perturb=null"),
    "zoo.export": ("out=", "frames="),
    "zoo.film": ("out=null", "fps=null", "plays as fast as it was driven"),
    "zoo.guard": ("levels=10", "guard.pt", "false_alarms=0.05"),
    "zoo.hub": ("push|pull", "repo=null", "send=false", "user/name"),
    "zoo.import": ("recording=null", "crop=null", "out=null"),
    "zoo.leaderboard": ("FOLDER", "leaderboard.html"),
    "zoo.list": ("[KIND]", "augmentations", "suites"),
    "zoo.models": ("multiply-adds",),
    "zoo.new": ("KIND", "augmentation", "NAME"),
    "zoo.preview": ("data.root=FOLDER", "fed_batch.png"),
    "zoo.replay": ("margin=1.0", "frame_rate=null", "frames=false", "out=null"),
    "zoo.report": ("RUN_FOLDER",),
    "zoo.rerun": ("out=null",),
    "zoo.results": ("RUN_FOLDER", "metrics=false"),
    "zoo.saliency": ("out=saliency.png", "published=false", "to the letter"),
    "zoo.sweep": ("resume=null", "hydra/launcher=NAME"),
    "datamodules.check": ("FOLDER", "--images"),
    "simulator": SIMULATOR,
    "simulator record": ("laps=", "noise="),
    "simulator drive": ("track=lake", "seconds=0.0"),
    "simulator client": ("url=", "track="),
}
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
    result = subprocess.run(
        [sys.executable, "-W", "ignore::RuntimeWarning", "-c", ASK, json.dumps(list(NAMED))],
        cwd=cwd,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert list(cwd.iterdir()) == [], "--help writes no files"
    return json.loads(result.stdout)


@pytest.mark.parametrize("command", NAMED)
def test_help_shows_the_usage_and_exits_with_0(command: str, helps: dict) -> None:
    status, text, slow = helps[command]
    assert status == 0
    typed = re.sub(r"^(zoo\.|datamodules\.|(?=simulator))", "drivezoo ", command)
    assert text.startswith(f"usage: {'drivezoo train' if command == 'zoo' else typed}")
    for words in NAMED[command]:
        assert words in " ".join(text.split())
    assert slow == [], "--help must be fast"
    assert len(text.splitlines()) < (160 if command == "zoo" else 60)


def test_no_command_is_forgotten() -> None:
    for package in ("zoo", "datamodules", "simulator"):
        for path in (ROOT / package).rglob("*.py"):
            # `zoo.base` has programs that start others.
            if GUARD in path.read_text() and path.parent != ROOT / "zoo" / "base":
                name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
                assert name.removesuffix(".__main__") in [*NAMED, PROBE], path


def test_the_help_of_zoo_explains_keys_by_the_chosen_yaml(helps: dict) -> None:
    lines = [line.split(maxsplit=1) for line in helps["zoo"][1].splitlines()]
    shown = {words[0]: "".join(words[1:]) for words in lines if words}
    assert "left camera" in shown["data.offset=0.275"]
    assert "mph" in shown["score.speed=15.0"]
    assert "quick_samples" in shown["quick=false"]
    assert "528" not in shown["model.weights=null"], "a comment of model=vgg"


def test_the_help_of_zoo_lists_only_parts_of_its_config(helps: dict) -> None:
    _, text, _ = helps["zoo"]
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
        silent |= {key for key, _ in typed_keys(config) if not meanings.get(key)}
    assert silent == set()
