"""Losses, compared with sums by hand."""

import torch

from zoo.losses import SteeringWeightedMSE


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
