"""What every network and every loss say about themselves, over all of the zoo."""

import pytest
import torch
from hydra.utils import instantiate
from omegaconf import OmegaConf
from torch import Tensor, nn

from tests.zoo.models.test_models_command import build
from zoo.base.compose import choices, conf_folder
from zoo.base.errors import InputError
from zoo.base.parts import Part
from zoo.models.frame_window import Window
from zoo.models.layers import OneFrame
from zoo.models.make_network import check_network
from zoo.models.memory import Memory, Stack
from zoo.models.network_facts import LossFacts, NetworkFacts, facts_of, loss_facts_of

SHAPE = (3, 16, 32)


@pytest.fixture(scope="module", params=choices("model"))
def network(request: pytest.FixtureRequest) -> nn.Module:
    torch.manual_seed(1)
    built, view = build(request.param)
    built.shape_of_view = (view.shape[2], *view.shape[:2])
    return built.eval()


def inputs_of(network: nn.Module) -> tuple[Tensor, ...]:
    facts = facts_of(network)
    frames = (facts.window.sequence,) if facts.window else ()
    images = torch.randint(0, 256, (2, *frames, *network.shape_of_view), dtype=torch.uint8)
    return (images, torch.tensor([9.0, 20.0])) if facts.takes_speed else (images,)


@torch.inference_mode()
def test_forward_takes_and_returns_what_the_facts_say(network: nn.Module) -> None:
    assert type(network.facts) is NetworkFacts, "not by attributes, as in version 0.1"
    facts = facts_of(network)
    assert facts.outputs in (1, 2)
    assert bool(facts.window) == isinstance(network, Memory)
    images, *speed = inputs_of(network)
    out = network(images, *speed)
    rows = len(range(*network.targets.indices(1000))) if facts.window else None
    assert out.shape == ((2, rows, facts.columns) if rows else (2, facts.columns))
    assert torch.isfinite(out).all()
    assert torch.equal(out, network(images.float(), *speed)), "uint8 and float must see the same"


@torch.inference_mode()
def test_a_frozen_front_and_a_backbone_are_parts_of_the_network(network: nn.Module) -> None:
    facts = facts_of(network)
    if facts.backbone is not None:
        inside = {id(parameter) for parameter in network.parameters()}
        assert {id(parameter) for parameter in facts.backbone.parameters()} <= inside
    if facts.frozen_front is None:
        assert all(parameter.requires_grad for parameter in network.parameters())
        return
    (images,) = inputs_of(network)
    assert torch.equal(network.rest(facts.frozen_front(images)), network(images))
    assert not any(weight.requires_grad for weight in facts.frozen_front.parameters())


@pytest.mark.parametrize("name", choices("loss"))
def test_a_loss_has_the_divisor_of_its_sum(name: str) -> None:
    """The losses of two processes, weighted by it, are the loss of the whole batch."""
    loss = instantiate(OmegaConf.load(conf_folder() / "loss" / f"{name}.yaml"))
    facts = loss_facts_of(loss)
    generator = torch.Generator().manual_seed(0)
    true = torch.randn(7, 1, generator=generator)
    predicted = torch.randn(7, 1 + facts.needs_spread, generator=generator)
    parts = [slice(0, 3), slice(3, 7)]
    divisors = [facts.divisor(true[at]) if facts.divisor else len(true[at]) for at in parts]
    losses = [loss(predicted[at], true[at]) for at in parts]
    whole = sum(each * by for each, by in zip(losses, divisors, strict=True)) / sum(divisors)
    assert float(whole) == pytest.approx(float(loss(predicted, true)))


def test_a_module_without_facts_has_the_defaults() -> None:
    assert facts_of(nn.Linear(1, 1)) == NetworkFacts()
    assert loss_facts_of(nn.MSELoss()) == LossFacts()


class OfFormerVersion(nn.Module):
    """A part of version 0.1, which gives each fact as an attribute."""

    takes_speed, outputs, predicts_spread = True, 2, True

    def __init__(self) -> None:
        super().__init__()
        self.backbone = nn.Linear(1, 1)


def test_the_attributes_of_a_part_of_version_0_1_are_its_facts() -> None:
    network = OfFormerVersion()
    expected = NetworkFacts(2, takes_speed=True, predicts_spread=True, backbone=network.backbone)
    assert facts_of(network) == expected


def test_an_attribute_of_another_type_is_no_fact() -> None:
    network = nn.Module()
    network.outputs = nn.Linear(1, 1)
    network.window, network.facts = 5, {"outputs": 2}
    assert facts_of(network) == NetworkFacts()


@pytest.mark.parametrize("base", [OneFrame, Stack])
def test_a_part_of_version_0_1_may_derive_from_a_class_of_the_zoo(base: type) -> None:
    class TwoOutputs(base):
        outputs = 2

    network = TwoOutputs() if base is OneFrame else TwoOutputs(SHAPE, 2, 1)
    assert facts_of(network).outputs == 2
    assert facts_of(network).window == (Window(2) if base is Stack else None)


def test_facts_that_do_not_fit_the_network_are_refused() -> None:
    network = nn.Sequential(nn.Flatten(), nn.Linear(3 * 16 * 32, 1))
    part = Part("my_net")
    check_network(network, SHAPE, part)
    network.facts = NetworkFacts(outputs=2)
    with pytest.raises(InputError, match=r"returns \[2, 1\] .*return \[2, 2\].*NetworkFacts"):
        check_network(network, SHAPE, part)
