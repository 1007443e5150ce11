"""`model=keras`: a training takes its layers, its scale and its weights from a file of Keras."""

import functools
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import DictConfig, OmegaConf

from datamodules.view import View
from tests.recordings import Written
from tests.zoo.command_runs import ROOT, run_here, succeed
from tests.zoo.extras.keras.keras_files import INPUT, random_weights, write_any, write_h5
from tests.zoo.extras.keras.test_keras_layers import REST, SCALE, UNCLEAR, expected, outputs
from tests.zoo.trainings import SMALL
from zoo.base.compose import compose_config
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint, make_card
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.extras.keras.sequential import Sequential
from zoo.training.initial_weights import load_weights
from zoo.training.run_config import with_file_settings

USUAL = [override for override in SMALL if not override.startswith("model")]
KERAS = ("model=keras", f"model.size=[{INPUT[0]},{INPUT[1]}]")


@functools.cache
def composed_config() -> DictConfig:
    return OmegaConf.create(compose_config(["data.root=x", *KERAS]))


def keras_config(*overrides: str) -> DictConfig:
    return OmegaConf.merge(composed_config(), OmegaConf.from_dotlist([*overrides]))


def test_a_run_starts_from_keras_and_resumes_without_it(recorded: Written, tmp_path: Path) -> None:
    source = write_h5(tmp_path / "old.h5", [SCALE, *REST])
    run = tmp_path / "run"
    start = [*USUAL, *KERAS, f"data.root={recorded.folder}", f"hydra.run.dir={run}"]
    start += [f"model.weights={source}", "optim.l2=0"]
    succeed(run_here(tmp_path, *start, "trainer.max_epochs=0"))
    checkpoint = load_checkpoint(run / "checkpoints" / "best.ckpt")
    np.testing.assert_allclose(outputs(checkpoint.network), expected(REST), atol=1e-5)
    assert checkpoint.config["model"]["scale"] == [127.5, 1.0]
    layers = checkpoint.config["model"]["layers"]
    assert [layer["layer"] for layer in layers] == ["Conv2D", "Flatten", "Dropout", "Dense"]

    source.unlink()
    succeed(run_here(tmp_path, f"resume={run}", "trainer.max_epochs=1"))
    trained = load_checkpoint(run / "checkpoints" / "last.ckpt")
    assert trained.config["model"]["layers"] == layers
    assert not np.allclose(outputs(trained.network), expected(REST), atol=1e-5)

    other = tmp_path / "other"
    again = [word.replace(str(run), str(other)) for word in start]
    again = [word for word in again if not word.startswith("model.weights")]
    again += [f"model.weights={run / 'checkpoints' / 'last.ckpt'}", "trainer.max_epochs=0"]
    succeed(run_here(tmp_path, *again))
    copied = load_checkpoint(other / "checkpoints" / "best.ckpt")
    np.testing.assert_array_equal(outputs(copied.network), outputs(trained.network))


@pytest.mark.parametrize("name", ["m.h5", "m.json", "m.keras"])
def test_layers_and_weights_come_from_any_file_of_keras(name: str, tmp_path: Path) -> None:
    path = write_any(tmp_path / name, [SCALE, *REST])
    model = with_file_settings(keras_config(f"model.weights={path}")).model
    network = Sequential((3, *INPUT[:2]), OmegaConf.to_container(model.layers), model.scale)
    assert "3 layers" not in load_weights(network, str(path))
    np.testing.assert_allclose(outputs(network), expected(REST), atol=1e-5)


def test_layers_of_the_config_are_kept(tmp_path: Path) -> None:
    config = keras_config()
    config.model.layers = [{"layer": "Flatten"}, {"layer": "Dense", "units": 1}]
    assert with_file_settings(config) is config
    other = OmegaConf.create(compose_config(["data.root=x", "model=tiny"]))
    assert with_file_settings(other) is other


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ([], "set model.weights=FILE"),
        (["model.weights=none.h5"], r"none\.h5"),
        (["model.size=null"], r'20 x 30 x 3, .*set "data\.crop=\[0,0\]" "model\.size=\[20,30\]"'),
        (["model.colour=gray"], r"model\.colour=rgb"),
        (["unclear"], r"lambda_1 .*model\.scale; or set what drivezoo import finds"),
        (["unscaled"], r'set "model\.scale=\[127\.5,1\]"'),
    ],
)
def test_what_is_missing_is_named(overrides: list[str], words: str, tmp_path: Path) -> None:
    first = {"unclear": [UNCLEAR], "unscaled": []}.get("".join(overrides), [SCALE])
    path = write_h5(tmp_path / "m.h5", [*first, *REST])
    given = any("weights" in key for key in overrides) or not overrides
    weights = [] if given else [f"model.weights={path}"]
    with pytest.raises(InputError, match=words) as caught:
        with_file_settings(keras_config(*weights, *[key for key in overrides if "=" in key]))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("page", ["importing.md", "training.md"])
def test_the_manuals_command_names_the_view(page: str, here: Path) -> None:
    dense = ("Dense", {"units": 1}, random_weights((66 * 200 * 3, 1), (1,)))
    write_h5(here / "model.h5", [SCALE, ("Flatten", {}, []), dense], shape=(66, 200, 3))
    lines = (ROOT / "docs" / page).read_text(encoding="utf-8").splitlines()
    (line,) = (line for line in lines if line.startswith("drivezoo train model=keras "))
    config = with_file_settings(OmegaConf.create(compose_config(shlex.split(line)[2:])))
    assert config.model.scale == [127.5, 1]


def test_an_unclear_scale_is_set_by_the_user(tmp_path: Path) -> None:
    path = write_h5(tmp_path / "m.h5", [UNCLEAR, *REST])
    config = with_file_settings(keras_config(f"model.weights={path}", "model.scale=[255,0.5]"))
    assert config.model.scale == [255, 0.5]


def test_another_models_checkpoint_is_refused() -> None:
    path = find_checkpoint("tiny41")
    with pytest.raises(InputError, match=r"\.ckpt: .*without model\.layers; set model"):
        with_file_settings(keras_config(f"model.weights={path}"))


def test_a_checkpoint_of_another_view_names_its_keys(tmp_path: Path) -> None:
    layers = [{"layer": "Flatten"}, {"layer": "Dense", "units": 1}]
    config = {"model": {"name": "keras", "layers": layers, "scale": [255, 0.5]}}
    for view, words in (
        (View([60, 25], "yuv_old", (66, 200), "linear"), "crop=[60,25]' model.colour=yuv_old "),
        (View([0, 0], "bgr", None), "crop=[0,0]' model.colour=bgr model.size=null "),
    ):
        card = make_card(config, view, {"fingerprint": "0", "rows": 1})
        torch.save({"drivezoo": card, "state_dict": {}}, tmp_path / "old.ckpt")
        with pytest.raises(InputError, match=re.escape(words)):
            with_file_settings(keras_config(f"model.weights={tmp_path / 'old.ckpt'}"))
    same = ["model.colour=bgr", "model.size=null", "data.crop=[0,0]"]
    model = with_file_settings(keras_config(f"model.weights={tmp_path / 'old.ckpt'}", *same)).model
    assert (model.layers, model.scale) == (layers, [255, 0.5])
