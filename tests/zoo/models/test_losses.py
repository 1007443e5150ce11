"""Losses, compared with values computed by hand."""

import math

import pytest
import torch

from zoo.models.layers import LogSpread
from zoo.models.losses import GaussianNLL, SteeringWeightedMSE


def test_a_bend_weighs_more_than_a_straight() -> None:
    loss = SteeringWeightedMSE(weight=4.0)
    true = torch.tensor([[0.0], [0.5]])
    on_straight = loss(true + torch.tensor([[0.1], [0.0]]), true)
    in_bend = loss(true + torch.tensor([[0.0], [0.1]]), true)
    assert torch.isclose(in_bend / on_straight, torch.tensor(3.0))


def test_without_weight_it_is_the_mean_squared_error() -> None:
    predicted, true = torch.randn(8, 2), torch.randn(8, 2)
    expected = torch.nn.functional.mse_loss(predicted, true)
    assert torch.isclose(SteeringWeightedMSE(weight=0.0)(predicted, true), expected)


def test_the_gaussian_loss_is_the_negative_log_likelihood() -> None:
    mean, log_spread, true = torch.randn(8, 1), torch.randn(8, 1), torch.randn(8, 1)
    likelihood = torch.distributions.Normal(mean, log_spread.exp()).log_prob(true)
    expected = -likelihood.mean() - math.log(2 * math.pi) / 2
    predicted = torch.hstack([mean, log_spread])
    assert torch.isclose(GaussianNLL()(predicted, true), expected)
    true = torch.hstack([true, torch.randn(8, 1)])
    predicted = torch.hstack([mean, true[:, 1:] + 0.2, log_spread])
    assert torch.isclose(GaussianNLL()(predicted, true), expected + 0.2**2 / 2)


@pytest.mark.parametrize(("output", "expected"), [(-1e6, -5), (0, -2), (0.1, -1.701), (1e6, 1)])
def test_the_logarithm_of_a_spread_stays_in_range(output: float, expected: float) -> None:
    mean, log_spread = LogSpread()(torch.tensor([[output, output]]))[0].tolist()
    assert mean == pytest.approx(output)
    assert log_spread == pytest.approx(expected, abs=1e-3)
