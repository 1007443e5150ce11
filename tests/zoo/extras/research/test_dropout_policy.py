"""Monte-Carlo dropout as a policy: its masks, its mean and its spread."""

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from datamodules.view import View
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.frozen_graph import network_inputs, quick_forward
from zoo.extras.research.doubt_policy import DropoutPolicy, SampledNetwork
from zoo.models.frame_window import Window
from zoo.models.lenet import LeNet
from zoo.models.network_facts import NetworkFacts
from zoo.models.pilotnet import PilotNet

VIEW = View((40, 20), "rgb", (66, 200))


def pilotnet(**settings: object) -> Checkpoint:
    torch.manual_seed(1)
    return Checkpoint(PilotNet((3, 66, 200), width=0.2, **settings).eval(), VIEW, {}, {})


@pytest.fixture
def frame() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (160, 320, 3), np.uint8)


@pytest.mark.parametrize("speed", [False, True], ids=["steering", "steering and throttle"])
def test_the_command_is_mean_and_deviation_of_the_samples(speed: bool, frame: np.ndarray) -> None:
    checkpoint = pilotnet(speed=speed)
    inputs = network_inputs(VIEW(frame), 9.0 if speed else None)
    samples = SampledNetwork(checkpoint.network, VIEW, 7, seed=3)(*inputs).detach().numpy()

    command = DropoutPolicy(checkpoint, samples=7, seed=3)(frame, 9.0)

    assert samples.shape == (7, 1 + speed)
    assert len({row[0] for row in samples}) == 7, "every mask is another"
    assert command.steering == pytest.approx(samples[:, 0].mean(), abs=1e-6)
    assert command.spread == pytest.approx(samples[:, 0].std(), abs=1e-6)
    assert (command.throttle is not None) == speed


def test_the_masks_depend_on_the_seed_alone(frame: np.ndarray) -> None:
    checkpoint = pilotnet()
    policy = DropoutPolicy(checkpoint, 5, seed=1)
    torch.manual_seed(99)
    assert policy(frame, 9.0) == policy(frame, 9.0) == DropoutPolicy(checkpoint, 5, 1)(frame, 9.0)
    assert policy(frame, 9.0) != DropoutPolicy(checkpoint, 5, seed=2)(frame, 9.0)


def test_the_checkpoints_network_stays_as_it_was(frame: np.ndarray) -> None:
    checkpoint = pilotnet()
    inputs = network_inputs(VIEW(frame), None)
    before = checkpoint.network(*inputs)
    policy = DropoutPolicy(checkpoint, 5, seed=1)
    assert torch.equal(policy.network(*inputs), before)
    assert not any(module.training for module in policy.sampled.modules())
    assert sum(p.numel() for p in policy.network.parameters()) == policy.parameters


def test_the_samples_keep_the_mean_and_the_rate() -> None:
    """The output is a sum of 4,000 values, of which a tenth is dropped, so its mean stays 1."""

    class Mean(nn.Module):
        takes_speed, outputs = False, 1

        def __init__(self) -> None:
            super().__init__()
            self.dropout = nn.Dropout(0.1)

        def forward(self, images: Tensor) -> Tensor:
            return self.dropout(torch.ones(1, 4000)).mean(1, keepdim=True)

    samples = SampledNetwork(Mean().eval(), VIEW, 50, seed=1)(torch.zeros(1, 3, 66, 200))
    assert samples.mean().item() == pytest.approx(1, abs=0.002)
    assert samples.std().item() == pytest.approx((0.1 / 0.9 / 4000) ** 0.5, rel=0.4)


class SpeedFirst(nn.Module):
    """A network that joins the speed to the image before its first dropout."""

    takes_speed, outputs = True, 1

    def __init__(self) -> None:
        super().__init__()
        self.dropout, self.head = nn.Dropout(0.5), nn.Linear(4, 1)

    def forward(self, images: Tensor, speed: Tensor) -> Tensor:
        features = torch.cat([images.float().mean((2, 3)), speed[:, None]], dim=1)
        return self.head(self.dropout(features / 255))


def test_the_speed_may_join_before_the_first_dropout(frame: np.ndarray) -> None:
    policy = DropoutPolicy(Checkpoint(SpeedFirst().eval(), VIEW, {}, {}), 8, seed=1)
    assert policy(frame, 9.0).spread > 0


class Twice(nn.Module):
    """A network with two dropouts, which are one layer.

    Args:
        names: names of the layer.
        sizes: number of values of each dropout.
    """

    takes_speed, outputs = False, 1

    def __init__(self, names: tuple[str, str], sizes: tuple[int, int]) -> None:
        super().__init__()
        self.names, self.sizes, layer = names, sizes, nn.Dropout(0.5)
        for name in names:
            setattr(self, name, layer)

    def forward(self, images: Tensor) -> Tensor:
        first, last = (
            getattr(self, name)(images.new_ones(1, size))
            for name, size in zip(self.names, self.sizes, strict=True)
        )
        return torch.cat([first, last], 1)


@pytest.mark.parametrize("names", [("a", "a"), ("a", "b")])
@pytest.mark.parametrize("sizes", [(30, 30), (30, 40)])
def test_a_layer_has_masks_for_each_call(names: tuple, sizes: tuple, frame: np.ndarray) -> None:
    network, inputs = Twice(names, sizes).eval(), network_inputs(VIEW(frame), None)
    sampled = SampledNetwork(network, VIEW, 9, seed=1)
    samples = sampled(*inputs)
    assert torch.equal(sampled(*inputs), samples)
    assert {*samples.flatten().tolist()} == {0.0, 2.0}
    rows = {tuple(row[part].tolist()) for row in samples for part in (slice(30), slice(30, None))}
    assert len(rows) == 2 * 9, "every mask is another"
    graph = quick_forward(sampled.eval(), VIEW)
    assert graph is not sampled
    assert torch.equal(graph(*inputs), samples)


def test_dropped_channels_are_dropped_whole() -> None:
    network = nn.Sequential(nn.Dropout2d(0.5))
    network.takes_speed = False
    samples = SampledNetwork(network.eval(), VIEW, 6, seed=1)(torch.ones(1, 3, 66, 200))
    assert set(samples.mean((2, 3)).flatten().tolist()) == {0.0, 2.0}


def test_a_network_that_predicts_its_spread_adds_it(frame: np.ndarray) -> None:
    checkpoint = pilotnet(spread=True)
    samples = SampledNetwork(checkpoint.network, VIEW, 5, 1)(*network_inputs(VIEW(frame), None))
    steering, spread = samples[:, 0].detach().numpy(), samples[:, 1].exp().detach().numpy()
    expected = np.sqrt(steering.var() + np.square(spread).mean())
    assert DropoutPolicy(checkpoint, 5, 1)(frame, 9.0).spread == pytest.approx(expected, rel=1e-5)


def test_a_network_without_dropout_or_with_a_memory_is_refused() -> None:
    plain = Checkpoint(LeNet((3, 66, 200)).eval(), VIEW, {}, {})
    with pytest.raises(InputError, match=r"^LeNet has no dropout.*ensemble$"):
        DropoutPolicy(plain, 5, 1)
    remembering = pilotnet()
    remembering.network.facts = NetworkFacts(window=Window())
    with pytest.raises(InputError, match=r"^PilotNet remembers frames.*ensemble$"):
        DropoutPolicy(remembering, 5, 1)
