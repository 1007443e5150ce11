"""The loss and the predictions of a batch of windows."""

import pytest
import torch
from torch import nn

from tests.zoo.models.test_memory import NAMES, memory_of, windows
from zoo.losses import SteeringWeightedMSE
from zoo.training.steering_module import SteeringModule, network_targets

ROWS = {
    "pilotnet_stack": [3],
    "cnn_gru": [0, 1, 2, 3],
    "ncp": [0, 1, 2, 3],
    "action_chunk": [3, 4, 5],
}


def network_of(name: str) -> nn.Module:
    ahead = ["model.ahead=2"] if name == "action_chunk" else []
    return memory_of(name, "model.sequence=4", *ahead)


def module_of(network: nn.Module, loss: nn.Module | None = None) -> SteeringModule:
    return SteeringModule(network, loss or nn.MSELoss(), optimizer=torch.optim.Adam)


def batch_of(network: nn.Module) -> dict[str, torch.Tensor]:
    rows = network.sequence + network.ahead
    steering = torch.arange(2 * rows).float().reshape(2, rows) / 20
    targets = torch.stack([steering, -torch.ones(2, rows)], 2)
    return {"images": windows(network), "speed": torch.zeros(2), "targets": targets}


@pytest.mark.parametrize("name", NAMES)
def test_each_prediction_is_compared_with_the_row_that_it_is_for(name: str) -> None:
    network = network_of(name)
    batch = batch_of(network)
    predicted = network(batch["images"])
    true = network_targets(network, batch)
    assert predicted.flatten(0, 1).shape == true.shape == (2 * len(ROWS[name]), 1)
    assert true[:, 0].tolist() == batch["targets"][:, ROWS[name], 0].flatten().tolist()


@pytest.mark.parametrize("name", NAMES)
def test_every_weight_learns_from_windows(name: str) -> None:
    network = network_of(name).train()
    module_of(network, SteeringWeightedMSE())._loss(batch_of(network)).backward()
    assert all(one.grad is not None and one.grad.isfinite().all() for one in network.parameters())


@pytest.mark.parametrize("name", NAMES)
def test_an_evaluation_is_of_the_newest_frame(name: str) -> None:
    network = network_of(name)
    batch = batch_of(network)
    with torch.inference_mode():
        found = module_of(network)({"images": batch["images"], "speed": batch["speed"]})
        assert torch.equal(found, network.newest(network(batch["images"])))
    assert found.shape == (2, 1)


@pytest.mark.parametrize("name", NAMES)
def test_windows_of_one_frame_are_plain_batches(name: str) -> None:
    """A datamodule without windows has images [N, C, H, W] and targets [N, 2]."""
    network = memory_of(name, "model.sequence=1", *["model.ahead=0"] * (name == "action_chunk"))
    images, targets = windows(network)[:, 0], torch.tensor([[0.5, 0.0], [0.25, 0.0]])
    module = module_of(network)
    with torch.inference_mode():
        predicted = module({"images": images})
        loss = module._loss({"images": images, "targets": targets})
    assert predicted.shape == (2, 1)
    assert loss.item() == pytest.approx(float((predicted - targets[:, :1]).square().mean()))
