"""`quick=true`: a first try in minutes that learns enough to drive."""

from pathlib import Path

import pytest
from omegaconf import OmegaConf

from simulator.record import next_command
from zoo.base.errors import InputError
from zoo.cli.compose import compose_config
from zoo.cli.config_help import ABOUT
from zoo.training.run_config import with_quick

ROOT = Path(__file__).parents[3]


def quick(*overrides: str) -> tuple[int, int]:
    """Return a quick training's epochs and samples per epoch."""
    config = with_quick(OmegaConf.create(compose_config(["quick=true", *overrides])))
    return config.trainer.max_epochs, config.data.samples_per_epoch


@pytest.mark.parametrize(
    "recipe", ["experiment=lenet", "experiment=pilotnet", "model=nvidia"], ids=str
)
def test_a_quick_training_keeps_the_samples_that_driving_takes(recipe):
    assert quick(recipe) == (3, 24_000)


def test_the_first_try_is_lenet_s_recipe_quick_with_all_that_was_measured():
    ours = compose_config(["experiment=first_try"])
    same = ["experiment=lenet", "trainer.max_epochs=3", "augment=[brightness,shadow,shift]"]
    assert ours == compose_config(same)


@pytest.mark.parametrize("hint", [next_command("FOLDER"), ABOUT, (ROOT / "README.md").read_text()])
def test_every_hint_names_the_first_try(hint):
    assert "drivezoo train experiment=first_try data.root=FOLDER" in hint


@pytest.mark.parametrize(
    "recipe", ["experiment=vgg", "experiment=commaai", "experiment=efficientnet_lite0"]
)
def test_large_networks_stay_quick(recipe):
    assert quick(recipe) == (3, 3_200)


def test_explicit_keys_win_where_they_are_smaller():
    assert quick("trainer.max_epochs=1", "data.samples_per_epoch=640") == (1, 640)
    assert quick("trainer.max_epochs=60", "data.samples_per_epoch=64000") == (3, 24_000)
    assert quick("quick_samples=3200") == (3, 3_200)


def test_a_run_from_before_quick_samples_keeps_its_length():
    config = OmegaConf.create(compose_config(["quick=true", "experiment=lenet"]))
    del config["quick_samples"]
    config = with_quick(config)
    assert (config.trainer.max_epochs, config.data.samples_per_epoch) == (3, 3_200)


@pytest.mark.parametrize("value", ["0", "null", "many"])
def test_a_number_of_samples_that_cannot_be_is_refused(value):
    with pytest.raises(InputError, match=f"quick_samples={value.replace('null', 'None')} is not"):
        quick(f"quick_samples={value}")


def test_the_config_that_was_given_stays_as_it_was():
    config = OmegaConf.create(compose_config(["quick=true"]))
    before = config.copy()
    assert with_quick(config) != before
    assert config == before
