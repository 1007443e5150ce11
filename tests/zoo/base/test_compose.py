"""Overrides as users type them: choices, paths, lists and typos."""

import inspect
import sys
from pathlib import Path

import lightning
import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from tests.zoo.command_runs import only_line, run_here, run_words
from zoo.base.compose import (
    PATH_KEYS,
    compose_config,
    conf_folder,
    escape_interpolation,
    hydra_overrides,
    quote,
)
from zoo.base.conf_files import trainer_arguments


@pytest.mark.parametrize("path", sorted(conf_folder().rglob("*.yaml")), ids=lambda path: path.stem)
def test_every_yaml_opens_with_a_command(path: Path) -> None:
    opening = path.read_text().splitlines()[:2]
    assert any(line.startswith("#") and "drivezoo " in line for line in opening)


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("modle=nvidia", "modle: no such key; did you mean model"),
        ("my_recording", "my_recording: expected key=value, such as data.root=my_recording"),
        ("data.ofset=0.2", "did you mean data.offset"),
        ("ofset=0.2", "did you mean data.offset"),
        ("model=nvidai", "model=nvidai: no such choice; did you mean nvidia?"),
        ("augment=[rain]", "bend, blur, brightness"),
        ("data.offset=[", "close its brackets"),
        ("callbacks=null", "callbacks=null: name a choice; available: "),
        ("optim=1", "optim=1: name a choice; available: adam, sgd"),
        ("model=[lenet,tiny]", "drivezoo train -m takes"),
        ("optim.lr=0.1,0.2", "drivezoo train -m trains with each"),
        ("optim.lr=0,5", "a decimal number with a point"),
        ("data.crop=40,20", "'data.crop=[40,20]'"),
        ("foo=1", "foo: no such key"),
        ("--tub=laps", "did you mean data.root?"),
        ("--batch-size=3", "did you mean data.batch_size?"),
        ("--cfg=job", "--cfg=job: no such option"),
        ("trainer.max_stesp=3", "did you mean trainer.max_steps"),
        ("resume=nowhere", "nowhere: "),
    ],
)
def test_a_typo_gets_one_line_with_the_nearest(argument: str, words: str, tmp_path: Path) -> None:
    line = only_line(run_here(tmp_path, argument))
    assert words in line
    assert "+" not in line
    assert list(tmp_path.iterdir()) == [], "a typo leaves nothing behind"


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        ("--epochs 5", "did you mean trainer.max_epochs?"),
        ("--tub laps --model mine.h5", "did you mean data.root?"),
        ("+foo=1", "foo: no such key"),
        ("++modle.x=1", "modle.x: no such key"),
    ],
)
@pytest.mark.parametrize("sweep", ["", "-m "])
def test_what_is_no_key_gets_one_line(typed: str, words: str, sweep: str, tmp_path: Path) -> None:
    assert words in only_line(run_here(tmp_path, *f"{sweep}{typed}".split()), 2)
    assert not list(tmp_path.glob("outputs/*/*/*/status.json"))


@pytest.mark.parametrize(
    ("typed", "key"),
    [
        ("seed=1 model=tiny seed=2", "seed"),
        ("optim.lr=1 +optim.lr=2", "optim.lr"),
        ("resume=a resume=b", "resume"),
        ("-m model=tiny model=lenet", "model"),
    ],
)
def test_a_key_is_given_once(typed: str, key: str, tmp_path: Path) -> None:
    result = run_here(tmp_path, *typed.split(), module="zoo.commands.train")
    assert f"{key}: given twice" in only_line(result, 2)


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("model=pilotnet", "model=nvidia"),
        ("logger=none", "logger=csv"),
        ("callbacks=none", "callbacks=checkpoints"),
        ("augment=none", "augment=[]"),
        ("schedule=none", "schedule=constant"),
        ("data={folder}", "data.root={folder}"),
        ("data=not/yet", "data.root=not/yet"),
        ("+optim.lr=0.1", "optim.lr=0.1"),
        ("+model=lenet", "model=lenet"),
        ("trainer.max_steps=9", "+trainer.max_steps=9"),
        ("trainer.profiler=simple", "+trainer.profiler=simple"),
        ("--config-dir={folder}", "hydra.searchpath=[file://{folder}]"),
    ],
)
def test_what_users_type_means_the_same(typed: str, meant: str, tmp_path: Path) -> None:
    (tmp_path / "my lake").mkdir()
    folder = tmp_path / "my lake"
    config = compose_config(hydra_overrides([typed.format(folder=folder)]))
    assert config == compose_config(hydra_overrides([meant.format(folder=folder)]))
    assert config != compose_config([]) or "lr" not in typed


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("model=lenet,pilotnet", "model=lenet,nvidia"),
        ("data.root=my laps,b=1", "data.root='my laps','b=1'"),
    ],
)
def test_a_sweep_splits_aliases_and_odd_paths_at_commas(typed: str, meant: str) -> None:
    assert hydra_overrides([typed], sweep=True) == [meant]


def test_the_trainers_keys_are_those_of_the_installed_lightning() -> None:
    wanted = set(inspect.signature(lightning.Trainer).parameters)
    assert set(trainer_arguments()) == wanted - set(compose_config([])["trainer"])


def test_a_file_in_place_of_the_runs_folder_gets_one_line(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("mine")
    line = only_line(run_here(tmp_path, "hydra.run.dir=taken"))
    assert "taken: " in line
    assert "hydra.run.dir=" in line
    assert (tmp_path / "taken").read_text() == "mine"


ODD = ["my 'run'=1 [a], (b)", "piste à ïle", "a${seed}b", "\\${seed}", 'back\\slash"', "1e5", "~x"]


@pytest.mark.parametrize(
    ("key", "name"),
    [
        *((key, name) for key in ("data.root", "hydra.run.dir") for name in ODD[1:]),
        *((key, ODD[0]) for key in PATH_KEYS),
    ],
)
def test_a_path_that_exists_is_not_parsed(key: str, name: str, tmp_path: Path) -> None:
    odd = tmp_path / name
    odd.mkdir()
    assert composed(f"{key}={odd}", key) == str(odd)


@pytest.mark.parametrize("name", [name for name in ODD if "${" not in name])
@pytest.mark.parametrize("key", ["hydra.run.dir", "data.root"])
def test_a_path_that_does_not_exist_is_not_parsed(key: str, name: str) -> None:
    assert composed(f"{key}=not/{name}", key) == f"not/{name}"


def test_an_interpolation_in_a_path_is_resolved_unless_escaped() -> None:
    assert composed("hydra.run.dir=runs/${model.name}", "hydra.run.dir") == "runs/nvidia"
    assert composed("hydra.run.dir=runs/\\${model.name}", "hydra.run.dir") == "runs/${model.name}"


def test_a_list_of_odd_paths_is_a_list(tmp_path: Path) -> None:
    odd = tmp_path / "laps [1], é"
    odd.mkdir()
    roots = composed(f"data.root=[{odd}, other laps=2,'c, d']", "data.root")
    assert roots == [str(odd), "other laps=2", "c, d"]


@given(st.text(alphabet="a\\'\"${}[]=, ï:()", max_size=8))
def test_any_text_can_be_quoted(text: str) -> None:
    override = OverridesParser.create().parse_override(f"k={quote(escape_interpolation(text))}")
    assert OmegaConf.create({"k": override.value()}).k == text


def composed(argument: str, key: str) -> object:
    """Return the value of a key in the config of `drivezoo train ARGUMENT`."""
    from hydra import compose, initialize_config_dir

    with initialize_config_dir(str(conf_folder().resolve()), version_base="1.3"):
        config = compose("config", hydra_overrides([argument]), return_hydra_config=True)
    value = OmegaConf.select(config, key)
    return list(value) if OmegaConf.is_list(value) else value


@pytest.mark.parametrize(
    ("arguments", "more"),
    [
        (["callbacks=fed_batch"], {"fed_batch"}),
        (["callbacks=checkpoints"], set()),
        (["callbacks=mine", "hydra.searchpath=[file://{folder}]"], {"mine"}),
        (["callbacks=lists", "hydra.searchpath=[file://{folder}]"], {"early_stopping"}),
        (["~callbacks"], set()),
    ],
)
def test_callbacks_keep_checkpoints(arguments: list[str], more: set[str], tmp_path: Path) -> None:
    (tmp_path / "callbacks").mkdir()
    mine = tmp_path / "callbacks" / "mine.yaml"
    mine.write_text("mine: {_target_: lightning.pytorch.callbacks.Timer}")
    mine.with_name("lists.yaml").write_text("defaults: [checkpoints, early_stopping]")
    callbacks = compose_config([word.format(folder=tmp_path) for word in arguments])["callbacks"]
    assert set(callbacks) == {"best", "last", "progress"} | more


def test_single_callbacks_are_added_and_switched_off() -> None:
    typed = ["callbacks={mine:{_target_:lightning.pytorch.callbacks.Timer}}"]
    callbacks = compose_config(hydra_overrides([*typed, "callbacks.progress=null"]))["callbacks"]
    assert set(callbacks) >= {"best", "last", "mine", "early_stopping"}
    assert callbacks["progress"] is None
    target = "zoo.training.training_progress.TrainingProgress"
    again = hydra_overrides([f"+callbacks.progress._target_={target}"])
    assert "progress" in compose_config(again)["callbacks"]


@pytest.mark.parametrize("typed", ["track=lake", "drive=pi"])
def test_keys_of_another_command_are_not_proposed(typed: str, tmp_path: Path) -> None:
    line = only_line(run_here(tmp_path, typed))
    assert "no such key" in line
    assert f"did you mean {typed.partition('=')[0]}" not in line


def test_nothing_slow_is_imported_before_ctrl_c_is_caught(tmp_path: Path) -> None:
    source = (
        "import sys, zoo.commands.train; print([*{'hydra', 'omegaconf', 'torch'} & {*sys.modules}])"
    )
    assert run_words(tmp_path, sys.executable, "-c", source).stdout.strip() == "[]"
