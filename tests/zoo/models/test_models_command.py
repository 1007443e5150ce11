"""Tests that every network of the zoo must pass."""

import pytest
import torch

from datamodules.view import View
from tests.zoo.command_runs import ROOT, run_here, succeed
from tests.zoo.compositions import composed
from zoo.base.compose import choices
from zoo.base.errors import InputError
from zoo.models.layers import Normalize
from zoo.models.make_network import make_network, published_view
from zoo.models.vgg import Vgg16

# Only published models stand here; a new model needs no line.
PARAMETERS = {
    "commaai": 6_621_809,
    "lenet": 137_741,
    "nvidia": 252_219,
    "nvidia_gaussian": 252_230,
    "nvidia_speed": 252_330,
    "tiny": 41,
    "tiny63": 63,
    "linear": 15,
    "vgg": 15_370_305,
}


def build(name: str, *overrides: str) -> tuple[torch.nn.Module, View]:
    config = composed(f"model={name}", *overrides)
    view = published_view(config)
    return make_network(config["model"], view), view


@pytest.mark.parametrize(("name", "parameters"), PARAMETERS.items())
def test_a_published_model_has_its_parameters(name: str, parameters: int) -> None:
    network, _ = build(name)
    assert sum(weight.numel() for weight in network.parameters()) == parameters


def test_pilotnet_has_the_published_layers() -> None:
    network, _ = build("nvidia")
    sizes = [sum(p.numel() for p in m.parameters(recurse=False)) for m in network.modules()]
    assert [size for size in sizes if size] == [
        1_824, 21_636, 43_248, 27_712, 36_928, 115_300, 5_050, 510, 11,
    ]  # fmt: skip
    maps = []
    for layer in network.features:
        if isinstance(layer, torch.nn.Conv2d):
            layer.register_forward_hook(lambda _, __, out: maps.append(tuple(out.shape[2:])))
    network(torch.zeros(1, 3, 66, 200))
    assert maps == [(31, 98), (14, 47), (5, 22), (3, 20), (1, 18)]
    rates = [m.p for m in network.modules() if isinstance(m, torch.nn.Dropout)]
    assert (rates[0], rates[-1]) == pytest.approx((0.1, 0.5))


@pytest.mark.parametrize("name", ["nvidia", "lenet", "commaai", "tiny", "tiny63"])
def test_settings_reach_the_network(name: str) -> None:
    plain, _ = build(name)
    wide, _ = build(name, "model.width=2", "model.activation=elu")
    assert any(isinstance(m, torch.nn.ELU) for m in wide.modules())
    usual, more = (sum(p.numel() for p in each.parameters()) for each in (plain, wide))
    assert more > 1.5 * usual


@pytest.mark.parametrize(
    ("name", "setting", "words"),
    [
        ("nvidia", "dropout=0.2", r"dropout=.*2 numbers from 0 to below 1, such as \[0.1,0.5\]"),
        ("nvidia", "dropout=[0.1,a]", "model.dropout=.*2 numbers"),
        ("lenet", "dropout=[0.1,0.2]", "model.dropout=.*a number from 0 to below 1"),
        ("lenet", "dropout=1", "model.dropout=.*a number from 0 to below 1"),
        ("nvidia", "width=-1", "model.width=.*a number of 0.01 or more"),
        ("cnn_gru", "neurons=1.5", "model.neurons=.*a whole number of 1 or more, such as 64"),
        ("nvidia", "size=[20,20]", "too small"),
        ("nvidia", "activation=tanh", "activation=.*elu, relu"),
        ("nvidia", "colour_depth=3", "colour_depth"),
        ("nvidia", "resize=cubic", "model.resize=cubic .*linear_first"),
        ("nvidia", "scale=[0,1]", r'model.scale=.*set "model.scale=\[127.5,1\]"'),
        ("nvidia", "scale=255", "model.scale=255: .*two finite numbers"),
        ("nvidia", "scale=[true,1]", "model.scale="),
        ("nvidia", "_target_=os.system", "no network of zoo.models"),
        ("nvidia", "_target_=zoo.models.layers.activation_layer", "no network of zoo.models"),
    ],
)
def test_a_wrong_setting_is_refused_with_its_key(name: str, setting: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        build(name, f"++model.{setting}")


@pytest.mark.parametrize("name", [name for name in choices("model") if name != "vgg"])
def test_the_scale_reaches_the_network(name: str) -> None:
    network, _ = build(name, "model.scale=[255,0.5]")
    (layer,) = [m for m in network.modules() if isinstance(m, Normalize)]
    pixels = torch.arange(256, dtype=torch.uint8)
    assert torch.equal(layer(pixels), pixels.float() / 255 - 0.5)


def test_the_usual_scale_is_that_of_earlier_versions_to_the_bit() -> None:
    pixels = torch.linspace(0, 255, 100_000)
    assert torch.equal(Normalize()(pixels), pixels / 127.5 - 1.0)
    assert torch.equal(Normalize([127.5, 1])(pixels), pixels / 127.5 - 1.0)


def test_speed_changes_what_nvidia_speed_predicts() -> None:
    network, _ = build("nvidia_speed")
    images = torch.full((1, 3, 66, 200), 90.0)
    slow, fast = (network.eval()(images, torch.tensor([mph])) for mph in (0.0, 30.0))
    assert slow.shape == (1, 2)
    assert not torch.equal(slow, fast)


@pytest.mark.parametrize("trainable", range(6))
def test_vgg_freezes_all_but_last_blocks(trainable: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.nn.Conv2d, "reset_parameters", lambda _: None)  # takes a while
    network = Vgg16((3, 32, 32), trainable)
    convolutions = [m for m in network.features if isinstance(m, torch.nn.Conv2d)]
    last = sum([2, 2, 3, 3, 3][5 - trainable :])
    assert [m.weight.requires_grad for m in convolutions] == [False] * (13 - last) + [True] * last
    assert all(p.requires_grad for p in network.head.parameters())


def test_the_zoo_is_printed_with_its_papers() -> None:
    printed = succeed(run_here(ROOT, "models", module="zoo.commands.list"))
    for name, parameters in PARAMETERS.items():
        assert f"{name}: " in printed
        assert f"{parameters:,}" in printed
    assert "26,876,342" in printed  # nvidia's multiply-adds: about 27 million in the paper
