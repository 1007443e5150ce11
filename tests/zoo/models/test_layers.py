"""The quick dropout behaves as torch's."""

import shutil

import pytest
import torch

from zoo.models import layers
from zoo.models.layers import Dropout

SHAPE = (8, 24, 31, 98)


@pytest.fixture(autouse=True)
def seeded() -> None:
    torch.manual_seed(3)


@pytest.mark.parametrize("layout", [torch.contiguous_format, torch.channels_last])
@pytest.mark.parametrize("rate", [0.1, 0.5, 0.9])
def test_drops_at_its_rate_and_scales_the_rest(rate: float, layout: torch.memory_format) -> None:
    ones = torch.ones(SHAPE).to(memory_format=layout).requires_grad_(True)
    out = Dropout(rate).train()(ones)
    assert (out == 0).float().mean().item() == pytest.approx(rate, abs=0.005)
    passed = out[out != 0]
    torch.testing.assert_close(passed, torch.full_like(passed, 1 / (1 - rate)), rtol=1e-3, atol=0)
    assert out.is_contiguous(memory_format=layout)
    out.sum().backward()
    assert torch.equal(ones.grad, out.detach()), "a dropped value has no gradient"


def test_values_are_dropped_independently() -> None:
    """Neighbours in memory share a random word, but are dropped independently."""
    dropped = (Dropout(0.3).train()(torch.ones(4, 100_000)) == 0).float().flatten()
    for apart in (1, 2, 3, 4, 5):
        assert (dropped[:-apart] * dropped[apart:]).mean().item() == pytest.approx(0.09, abs=0.004)


def test_calls_are_drawn_independently() -> None:
    """Calls read the same tables from different places."""
    layer, ones = Dropout(0.3).train(), torch.ones(4, 100_000)
    first, *others = [(layer(ones) == 0).float().flatten() for _ in range(20)]
    for other in others:
        assert (first * other).mean().item() == pytest.approx(0.09, abs=0.004)


def test_a_larger_layer_changes_nothing_for_the_others() -> None:
    """The tables grow for the largest layer; their first numbers stay."""
    layer, ones = Dropout(0.5).train(), torch.ones(SHAPE)
    layers._drawn.clear()
    torch.manual_seed(5)
    before = layer(ones)
    layer(torch.ones(9, *SHAPE[1:]))
    torch.manual_seed(5)
    assert torch.equal(layer(ones), before)


def test_repeats_with_the_seed_and_not_otherwise() -> None:
    layer, ones = Dropout(0.5).train(), torch.ones(SHAPE)
    torch.manual_seed(5)
    first, second = layer(ones), layer(ones)
    torch.manual_seed(5)
    assert torch.equal(layer(ones), first)
    assert not torch.equal(first, second)


@pytest.mark.parametrize(("rate", "value"), [(0.0, 1.0), (1.0, 0.0)])
def test_a_rate_of_0_and_of_1(rate: float, value: float) -> None:
    assert (Dropout(rate).train()(torch.ones(SHAPE)) == value).all()


def test_changes_nothing_in_evaluation_mode() -> None:
    ones = torch.ones(SHAPE)
    assert Dropout(0.5).eval()(ones) is ones


def test_in_half_precision() -> None:
    out = Dropout(0.5).train()(torch.ones(SHAPE, dtype=torch.bfloat16))
    assert out.dtype == torch.bfloat16
    assert out.unique().tolist() == [0.0, 2.0]


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("g++"), reason="no C++ compiler")
def test_compiled_dropout_draws_from_the_seed() -> None:
    """Two equal layers drop different values; a seed repeats them."""
    pair = torch.nn.ModuleList([Dropout(0.5), Dropout(0.5)]).train()

    def both(values: torch.Tensor) -> list[torch.Tensor]:
        return [layer(values) for layer in pair]

    compiled, ones = torch.compile(both, dynamic=False), torch.ones(SHAPE, requires_grad=True)
    torch.manual_seed(5)
    first, second = compiled(ones)
    torch.manual_seed(5)
    again, _ = compiled(ones)
    assert torch.equal(first, again)
    assert not torch.equal(first, second)
    assert (first == 0).float().mean().item() == pytest.approx(0.5, abs=0.005)
    assert first.unique().tolist() == [0.0, 2.0]
    (first.sum() + 2 * second.sum()).backward()
    torch.testing.assert_close(ones.grad, (first + 2 * second).detach())
