"""A frozen front's features, computed once: nothing else about a training may change."""

import copy
from pathlib import Path

import lightning
import numpy as np
import pytest
import torch
from omegaconf import OmegaConf
from rich.console import Console

from datamodules.driving import DrivingData
from datamodules.features import FeaturePlan
from datamodules.image import decode_image
from datamodules.samples import CENTER
from datamodules.view import View
from tests.recordings import Written, write_recording
from tests.slow_members import slow
from tests.zoo.trainings import equal, planned, weights
from zoo.base.compose import compose_config
from zoo.base.errors import InputError
from zoo.models.vgg import Vgg16
from zoo.training import frozen_layers
from zoo.training.build import load_data
from zoo.training.frozen_layers import fingerprint
from zoo.training.run import run_experiment
from zoo.training.steering_module import SteeringModule

SHAPE = (3, 32, 32)
SMALL = (
    *("model=vgg", "model.weights=null", "model.size=[32,32]", "model.units=8"),
    *("augment=[]", "data.cameras=[center]", "data.block_s=0.5", "data.gap_s=0.1"),
    *("data.batch_size=16", "data.samples_per_epoch=48", "trainer.accelerator=cpu"),
    *("callbacks=checkpoints", "logger=csv", "score=none"),
)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """Write a shorter recording than other tests share: each image passes through VGG16."""
    folder = tmp_path_factory.mktemp("short") / "lake"
    return write_recording(folder, rows=60, cameras=("center",))


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


def compose(recorded: Written, cache: Path, *overrides: str) -> OmegaConf:
    places = (f"data.root={recorded.folder}", f"data.cache={cache}")
    return OmegaConf.create(compose_config([*SMALL, *places, *overrides]))


def prepare(
    config: OmegaConf, folder: Path, console: Console
) -> tuple[SteeringModule, DrivingData, lightning.Trainer]:
    """Build all that a training of `config` needs, including features."""
    data = load_data(config, Console(quiet=True))
    config.callbacks = {}
    module, data, trainer = planned(config, data, folder, console)
    assert (data.features is not None) == module.skips_front
    return module, data, trainer


@pytest.mark.parametrize("trainable", [0, 2, 5, *slow(1, 3, 4)])
def test_vgg_is_its_front_and_its_rest_to_the_bit(trainable: int) -> None:
    torch.manual_seed(0)
    network = Vgg16(SHAPE, trainable).eval()
    images = torch.randint(0, 256, (2, *SHAPE), dtype=torch.uint8)
    plain = network.head(network.features(network.normalize(images)).flatten(1))
    assert torch.equal(network(images), plain)
    front = network.front(images)
    assert torch.equal(network.rest(front), plain)
    assert (network.facts.frozen_front is None) == (trainable == 5)
    if trainable < 5:
        assert not front.requires_grad
        assert torch.equal(network.facts.frozen_front(images), front)


def test_a_fingerprint_is_of_the_frozen_weights_alone() -> None:
    torch.manual_seed(0)
    network = Vgg16(SHAPE, 1).requires_grad_(False)
    before = fingerprint(network.facts.frozen_front)
    network.head[0].weight += 1
    network.features[-3].weight += 1
    assert fingerprint(network.facts.frozen_front) == before
    network.features[0].bias[0] += 1e-3
    assert fingerprint(network.facts.frozen_front) != before


@pytest.mark.parametrize("other", ["threads", "part"])
def test_features_that_other_threads_or_code_computed_are_not_taken(
    other: str, recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in "12":
        if other == "threads":  # which round the sums of a feature otherwise
            monkeypatch.setenv("OMP_NUM_THREADS", number)
        else:  # a user's file that has changed
            cards = [{"name": "own.py", "sha256": number}]
            monkeypatch.setattr(frozen_layers, "part_cards", lambda config, cards=cards: cards)
        config = compose(recorded, tmp_path, "model.cache_features=true", "data.flip=0")
        prepare(config, tmp_path / "run", Console(quiet=True))
    assert len([*tmp_path.glob("*.npy")]) == 3, "the views, and the features of each"


def test_random_frozen_blocks_are_neither_dead_nor_huge(recorded: Written) -> None:
    view = View((50, 20), "rgb", (32, 80))
    frames = [decode_image(recorded.image(row).read_bytes()) for row in range(0, 60, 15)]
    images = torch.stack([torch.from_numpy(view(frame)).permute(2, 0, 1) for frame in frames])
    torch.manual_seed(1)
    out = Vgg16((3, 32, 80), 0).front(images)
    assert 0.005 < out.std() < 1
    assert (out.amax((0, 2, 3)) == 0).float().mean() < 0.2, "channels that never answer"


@pytest.mark.parametrize("trainable", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_run_on_cached_features_is_the_run_without(
    trainable: int, recorded: Written, cache: Path, tmp_path: Path
) -> None:
    # Plain gradients: Adam's first steps are of one length, whatever the gradient's.
    overrides = (f"model.trainable_blocks={trainable}", "trainer.max_epochs=1", "optim=sgd")
    trained = []
    for setting in ("true", "false"):
        config = compose(recorded, cache, *overrides, f"model.cache_features={setting}")
        module, data, trainer = prepare(config, tmp_path / setting, Console(quiet=True))
        assert module.skips_front == (setting == "true")
        before = {name: weight.clone() for name, weight in module.state_dict().items()}
        trainer.fit(module, datamodule=data)
        assert module.train_samples == 48
        trained.append((module, {n: float(v) for n, v in trainer.callback_metrics.items()}))
    (ours, figures), (theirs, expected) = trained
    # Half precision keeps eleven bits of each feature, which turns a maximum's choice here and
    # there; another sample, or one that is not mirrored, would change all that was learnt.
    assert figures == pytest.approx(expected, rel=2e-3, abs=1e-4)
    cached, plain = ours.state_dict(), theirs.state_dict()
    assert cached.keys() == plain.keys(), "a checkpoint is whole"
    learnt = {name: plain[name] - weight for name, weight in before.items()}
    changed = [name for name, step in learnt.items() if step.any()]
    assert len(changed) == 4 + 6 * trainable, "the head, and three layers of the last block"
    for name in changed:
        assert (cached[name] - plain[name]).norm() < 0.05 * learnt[name].norm(), name
    images = torch.from_numpy(data.views.take(np.arange(8), CENTER)).permute(0, 3, 1, 2)
    with torch.inference_mode():
        output, other = (module.network.eval()(images) for module in (ours, theirs))
    torch.testing.assert_close(output, other, rtol=2e-3, atol=2e-4)


def test_features_behind_frozen_batch_normalization_are_cached(
    recorded: Written, cache: Path, tmp_path: Path
) -> None:
    overrides = ("model=efficientnet_lite0", "model.trainable_blocks=0", "trainer.max_epochs=1")
    config = compose(recorded, cache, *overrides, "model.cache_features=true")
    module, data, trainer = prepare(config, tmp_path / "run", Console(quiet=True))
    before = copy.deepcopy(module.network.state_dict())
    trainer.fit(module, datamodule=data)
    after = module.network.state_dict()
    changed = [name for name in after if not torch.equal(after[name], before[name])]
    assert {name.partition(".")[0] for name in changed} == {"reduce", "head"}
    network = module.network.eval()
    rows = np.arange(8)
    images = torch.from_numpy(data.views.take(rows, CENTER)).permute(0, 3, 1, 2)
    cached = torch.from_numpy(data.features.take(rows, CENTER)).permute(0, 3, 1, 2)
    with torch.inference_mode():
        torch.testing.assert_close(network.rest(cached), network(images), rtol=5e-3, atol=1e-3)


@pytest.mark.slow
def test_a_run_that_goes_on_is_fed_the_features_of_its_own_front(
    recorded: Written, cache: Path, tmp_path: Path
) -> None:
    torch.manual_seed(5)  # not the weights that the run's seed draws
    torch.save(Vgg16(SHAPE, 0, units=8).state_dict(), tmp_path / "other.pth")
    overrides = ("model.trainable_blocks=0", "model.cache_features=true", "data.flip=0")
    overrides += (f"model.weights={tmp_path / 'other.pth'}",)
    whole, halves = (
        compose(recorded, cache, *overrides, f"trainer.max_epochs={epochs}") for epochs in (2, 1)
    )
    run_experiment(whole.copy(), tmp_path / "whole")
    run_experiment(halves, tmp_path / "halves")
    files = set(cache.iterdir())
    run_experiment(whole.copy(), tmp_path / "halves", resume=True)
    assert set(cache.iterdir()) == files, "nothing was computed again"
    assert equal(weights(tmp_path / "whole"), weights(tmp_path / "halves"))


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("augment=[brightness,shift]", r"augment=\[brightness,shift\] changes every image"),
        ("model.trainable_blocks=5", r"no block of the network is frozen"),
        ("data.sequence=2", r"cache_features=true: .*data.sequence=2.* set .*cache_features=false"),
        ("model.cache_features=maybe", r"cache_features=maybe is not auto, true or false"),
    ],
)
def test_what_cannot_be_cached_is_refused_in_words(
    override: str, words: str, recorded: Written, cache: Path, tmp_path: Path
) -> None:
    config = compose(recorded, cache, "model.cache_features=true", override)
    with pytest.raises(InputError, match=words):
        prepare(config, tmp_path / "run", Console(quiet=True))


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (("augment=[brightness]",), "computed in every epoch: augment=[brightness]"),
        (("data.sequence=2",), "data.sequence=2 data.ahead=0 make windows"),
        (("trainer.max_epochs=1",), "of 120"),
        (("model.trainable_blocks=5",), ""),
    ],
)
def test_auto_computes_nothing_where_it_cannot_or_does_not_pay(
    overrides: tuple[str], words: str, recorded: Written, cache: Path, tmp_path: Path, console
) -> None:
    config = compose(recorded, cache, *overrides)
    files = set(cache.iterdir())
    module, _, _ = prepare(config, tmp_path / "run", console)
    assert not module.skips_front
    printed = console.file.getvalue()
    assert words in printed
    assert printed.count("\n") == (1 if words else 0)
    assert set(cache.iterdir()) == files


@pytest.mark.parametrize("setting", ["auto", "true"])
def test_a_disk_without_room_is_said_before_anything_is_computed(
    setting: str, recorded: Written, tmp_path: Path, monkeypatch, console
) -> None:
    monkeypatch.setattr(FeaturePlan, "free_bytes", lambda _: 100_000)
    keys = (f"model.cache_features={setting}", "model.size=[32,64]", "trainer.max_epochs=9")
    config = compose(recorded, tmp_path / "cache", *keys)
    words = rf"(?i)cache_features={setting}: .*1 MB, with 0 MB free .*; set a smaller .*=false"
    with pytest.raises(InputError, match=words):
        prepare(config, tmp_path / "run", console)


def test_auto_leaves_out_what_is_large_on_every_machine(
    recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, console: Console
) -> None:
    monkeypatch.setattr(frozen_layers, "AUTO_BYTES", 100_000)
    config = compose(recorded, tmp_path / "cache", "trainer.max_epochs=9")
    module, _, _ = prepare(config, tmp_path / "run", console)
    assert not module.skips_front
    assert "caching takes" in console.file.getvalue()
