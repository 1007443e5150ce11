"""What a person types: every YAML, every typo."""

from pathlib import Path

import pytest
from hydra.utils import get_object
from omegaconf import OmegaConf

from tests.recordings import Written
from tests.zoo.commands import only_line, run
from zoo.build import build_data, build_module, build_trainer
from zoo.config import choices, compose_config, conf_folder, quote_paths

# Tracks are the simulator's: tests/simulator/test_track_file.py reads them all.
GROUPS = sorted(p.name for p in conf_folder().iterdir() if p.is_dir() and p.name != "track")
# Their packages are extras, which the tests do not install.
OPTIONAL = {("logger", "mlflow"), ("logger", "wandb")}
EVERY = [(group, name) for group in GROUPS for name in choices(group)]


@pytest.mark.parametrize(("group", "name"), EVERY)
def test_every_yaml_can_be_built(group: str, name: str, recorded: Written, tmp_path: Path) -> None:
    override = f"augment=[{name}]" if group == "augment" else f"{group}={name}"
    overrides = [override, f"data.root={recorded.folder}"]
    if group != "trainer":
        overrides.append("trainer.accelerator=cpu")
    config = OmegaConf.create(compose_config(overrides))
    config.model.weights = None
    if (group, name) == ("trainer", "gpu"):
        assert get_object(config.trainer["_target_"])
        return
    data = build_data(config)
    if (group, name) in OPTIONAL:
        assert config.logger[name]["_target_"].startswith("lightning.pytorch.loggers.")
        return
    module = build_module(config, data, {})
    assert module.configure_optimizers()["optimizer"].param_groups
    assert build_trainer(config, tmp_path, has_validation=True).callbacks


@pytest.mark.parametrize("path", sorted(conf_folder().rglob("*.yaml")), ids=lambda path: path.stem)
def test_every_yaml_opens_with_a_command(path: Path) -> None:
    opening = path.read_text().splitlines()[:2]
    commands = ("python -m zoo", "python -m simulator")
    assert any(line.startswith("#") and any(c in line for c in commands) for line in opening)


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("modle=nvidia", "modle: no such key; did you mean model"),
        ("data.ofset=0.2", "did you mean data.offset"),
        ("ofset=0.2", "did you mean data.offset"),
        ("model.dropuot=0.2", "did you mean model.dropout"),
        ("model=nvidai", "model=nvidai: no such choice; did you mean nvidia?"),
        ("experiment=pilotnt", "did you mean pilotnet"),
        ("augment=[rain]", "there are bend, blur, brightness"),
        ("data.offset=[", "--help lists all keys"),
        ("resume=nowhere", "nowhere: is no run's folder"),
    ],
)
def test_a_typo_gets_one_line_with_the_nearest_valid(
    argument: str, words: str, tmp_path: Path
) -> None:
    line = only_line(run(tmp_path, argument))
    assert words in line
    assert "+" not in line
    assert list(tmp_path.iterdir()) == [], "a typo leaves nothing behind"


def test_a_file_where_the_runs_folder_is_to_be_gets_one_line(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("mine")
    line = only_line(run(tmp_path, "hydra.run.dir=taken"))
    assert "taken: cannot be made the run's folder (File exists); set hydra.run.dir=" in line
    assert (tmp_path / "taken").read_text() == "mine"


def test_a_path_that_exists_is_taken_as_it_stands(tmp_path: Path) -> None:
    odd = tmp_path / "my 'run'=1 [a], (b)"
    odd.mkdir()
    config = compose_config(quote_paths([f"data.root={odd}"]))
    assert config["data"]["root"] == str(odd)


def test_several_roots_are_a_list() -> None:
    assert compose_config(quote_paths(["data.root=[a,b]"]))["data"]["root"] == ["a", "b"]


@pytest.mark.parametrize("typed", ["track=lake", "drive=pi"])
def test_what_belongs_to_another_command_is_not_proposed(typed: str, tmp_path: Path) -> None:
    line = only_line(run(tmp_path, typed))
    assert "no such key" in line
    assert f"did you mean {typed.partition('=')[0]}" not in line
