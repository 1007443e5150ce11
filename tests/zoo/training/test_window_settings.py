"""The windows of `data` and `model` agree before anything is built."""

import pytest
from omegaconf import DictConfig, OmegaConf

from zoo.base.errors import InputError
from zoo.cli.compose import compose_config
from zoo.training.run_config import settle_windows


def config_of(model: dict, **data: object) -> DictConfig:
    config = OmegaConf.create(compose_config([f"data.{key}={one}" for key, one in data.items()]))
    config.model.update(model)
    OmegaConf.set_struct(config, True)
    return config


def windows_of(config: DictConfig) -> tuple:
    return tuple(config.data[key] for key in ("sequence", "stride", "ahead"))


def test_null_takes_the_networks_values():
    settled = settle_windows(config_of({"sequence": 8, "stride": 2}))
    assert windows_of(settled) == (8, 2, 0)


def test_a_network_of_one_frame_has_windows_of_one():
    config = config_of({}, sequence=1)
    assert windows_of(settle_windows(config)) == (1, 1, 0)
    assert "sequence" not in config.model


def test_a_value_of_data_is_the_networks():
    config = config_of({"sequence": 8, "stride": 1, "ahead": 4}, sequence=5, ahead=0)
    settled = settle_windows(config)
    assert windows_of(settled) == (5, 1, 0)
    assert (settled.model.sequence, settled.model.ahead) == (5, 0)
    assert config.model.sequence == 8  # the config itself stays as it was


def test_settling_twice_changes_nothing():
    settled = settle_windows(config_of({"sequence": 8, "stride": 1}, stride=3))
    assert settle_windows(settled) == settled


@pytest.mark.parametrize("model", [{}, {"sequence": 4, "stride": 1}])
def test_a_config_of_an_older_version_has_no_keys(model):
    config = config_of(model)
    OmegaConf.set_struct(config, False)
    for key in ("sequence", "stride", "ahead"):
        del config.data[key]
    OmegaConf.set_struct(config, True)
    assert windows_of(settle_windows(config)) == (model.get("sequence", 1), 1, 0)


@pytest.mark.parametrize("key", ["sequence", "stride", "ahead"])
def test_a_network_that_does_not_take_it_is_named(key):
    with pytest.raises(InputError, match=rf"data\.{key}=3: model=nvidia .*data\.{key}=null"):
        settle_windows(config_of({}, **{key: 3}))
