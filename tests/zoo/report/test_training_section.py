"""The table of a network's layers."""

import pytest
import torch
from torch import nn

from tests.zoo.compositions import composed
from zoo.cli.compose import choices
from zoo.models.make_network import make_network, view_of
from zoo.report.training_section import network_layers


@pytest.mark.parametrize("model", choices("model"))
def test_the_parameters_of_the_layers_add_up(model: str) -> None:
    config = composed(f"model={model}")
    view = view_of(config["model"], config["data"]["crop"])
    network = make_network(config["model"], view)
    layers = network_layers(network, view.shape)

    assert sum(layer.parameters for layer in layers) == sum(p.numel() for p in network.parameters())
    columns = network.outputs + getattr(network, "predicts_spread", False)
    assert layers[-1].shape == (columns * (1 + getattr(network, "ahead", 0)),)
    assert {layer.name for layer in layers} <= dict(network.named_modules()).keys()


def test_the_published_table_of_pilotnet() -> None:
    config = composed("model=nvidia")
    view = view_of(config["model"], config["data"]["crop"])
    layers = network_layers(make_network(config["model"], view), view.shape)
    counts = [layer.parameters for layer in layers if layer.parameters]
    assert counts == [1_824, 21_636, 43_248, 27_712, 36_928, 115_300, 5_050, 510, 11]
    convolutions = [layer for layer in layers if layer.kind.startswith("Conv2d")]
    assert [layer.shape for layer in convolutions][0::4] == [(24, 31, 98), (64, 1, 18)]
    assert "Dropout (p=0.157)" in {layer.kind for layer in layers}


class Odd(nn.Module):
    """A network with a layer that is used twice, and a parameter outside layers."""

    takes_speed, outputs = False, 1

    def __init__(self) -> None:
        super().__init__()
        self.layer, self.scale = nn.Conv2d(1, 1, 1), nn.Parameter(torch.ones(3))

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        return self.layer(self.layer(images)).mean((1, 2, 3))[:, None] * self.scale.sum()


def test_a_layer_used_twice_counts_once_and_no_parameter_is_lost() -> None:
    layers = network_layers(Odd(), (4, 4, 1))
    assert [layer.parameters for layer in layers] == [2, 0, 3]
    assert layers[-1].name == ""
