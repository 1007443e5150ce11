"""Open-loop figures, by hand."""

import numpy as np
import pytest

from zoo.training.open_loop import baseline_metrics, open_loop_metrics, side_response


def test_figures_of_four_rows_by_hand() -> None:
    true = np.array([0.0, 0.0, 0.0, 0.5])
    predicted = np.array([0.1, 0.1, 0.1, 0.1])
    metrics = open_loop_metrics(predicted, true)
    assert metrics["mse"] == pytest.approx((3 * 0.01 + 0.16) / 4)
    assert metrics["mae"] == pytest.approx((3 * 0.1 + 0.4) / 4)
    assert metrics["balanced_mae"] == pytest.approx((0.1 + 0.4) / 2)
    assert metrics["bias"] == pytest.approx((0.3 - 0.4) / 4)


def test_full_lock_has_a_bin_on_either_side() -> None:
    metrics = open_loop_metrics(np.zeros(3), np.array([-1.0, 0.0, 1.0]))
    assert metrics["balanced_mae"] == pytest.approx(2 / 3)


def test_baselines_look_at_nothing() -> None:
    true = np.array([-0.2, 0.6])
    baselines = baseline_metrics(true, train_mean=0.2)
    assert baselines["always zero"]["mae"] == pytest.approx(0.4)
    assert baselines["mean"]["bias"] == pytest.approx(0.0)


def test_the_side_response_is_half_of_what_the_left_camera_adds() -> None:
    assert side_response(np.array([0.3, 0.5]), np.array([-0.3, 0.1])) == pytest.approx(0.25)
    assert side_response(np.array([]), np.array([])) is None
