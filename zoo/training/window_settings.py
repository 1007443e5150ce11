"""Window settings: the keys that `data` and `model` share."""

from omegaconf import DictConfig, OmegaConf

from zoo.base.errors import InputError
from zoo.cli.conf_files import choice_files

# For networks without the key.
SINGLE_FRAME = {"sequence": 1, "stride": 1, "ahead": 0}


def settle_windows(config: DictConfig) -> DictConfig:
    """Return a config in which `data` and `model` have the same windows.

    A value of `data` is written into `model`; null takes the value of `model`.

    Raises:
        InputError: `data` asks for windows that the network does not take.
    """
    config = config.copy()
    for key, single in SINGLE_FRAME.items():
        asked = config.data.get(key)
        if key in config.model:
            settled = config.model[key] if asked is None else asked
            config.model[key] = settled
        elif asked is None or asked == single:
            settled = single
        else:
            names = ", ".join(models_with(key)) or "none yet"
            raise InputError(
                f"data.{key}={asked}: model={config.model.name} does not take it; set "
                f"data.{key}=null, or a model that takes it: {names}"
            )
        OmegaConf.update(config, f"data.{key}", settled, force_add=True)
    return config


def models_with(key: str) -> list[str]:
    """Return the names of the models whose YAML has a key."""
    files = choice_files("model")
    return [name for name in sorted(files) if key in OmegaConf.load(files[name])]
