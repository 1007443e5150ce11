"""Recall, precision, false-positive rate, F3 and AUC of alarms, with intervals."""

import math

import numpy as np
import pytest
from scipy import stats

from zoo.guard.warning_figures import warning_figures


def drives(seed: int, shift: float, count: int = 12, windows: int = 9) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [rng.normal(shift, 1, windows) for _ in range(count)]


def test_figures_are_those_of_the_pooled_windows() -> None:
    failing, normal = drives(1, 1.5), drives(2, 0.0, windows=40)
    found = warning_figures(failing, normal, 1.0)
    positive, negative = np.concatenate(failing), np.concatenate(normal)
    hits, false = (positive > 1).sum(), (negative > 1).sum()
    recall, precision = hits / len(positive), hits / (hits + false)
    assert found["recall"].value == pytest.approx(recall)
    assert found["precision"].value == pytest.approx(precision)
    assert found["false_positive_rate"].value == pytest.approx(false / len(negative))
    f3 = 10 * precision * recall / (9 * precision + recall)
    assert found["f3"].value == pytest.approx(f3)
    ranks = stats.mannwhitneyu(positive, negative).statistic
    assert found["auc"].value == pytest.approx(ranks / len(positive) / len(negative))
    for one in found.values():
        assert one.low < one.value < one.high


def test_intervals_resample_drives_not_windows() -> None:
    rng = np.random.default_rng(0)
    alike = [np.full(20, one) for one in rng.normal(1, 1, 12)]  # windows of a drive are equal
    mixed = list(rng.permutation(np.concatenate(alike)).reshape(12, 20))
    wide, narrow = (warning_figures(one, drives(3, 0.0), 1.0)["recall"] for one in (alike, mixed))
    assert wide.high - wide.low > 2 * (narrow.high - narrow.low)


def test_all_alarms_have_an_interval_of_the_count() -> None:
    found = warning_figures([np.full(3, 9.0)] * 2, [np.zeros(10)] * 3, 5.0)
    assert found["recall"].value == 1
    assert found["recall"].low == pytest.approx(0.61, abs=0.01)  # Wilson, 6 of 6
    assert found["false_positive_rate"].high == pytest.approx(0.11, abs=0.01)  # 0 of 30
    assert found["f3"].value == found["auc"].value == 1


def test_without_a_failure_only_the_false_positive_rate_is_known() -> None:
    found = warning_figures([np.zeros(0)], drives(1, 0.0), 1.0)
    assert 0 < found["false_positive_rate"].value < 1
    unknown = ("recall", "precision", "f3", "auc")
    assert all(math.isnan(found[name].value) for name in unknown)


def test_without_an_alarm_f3_is_0_and_there_is_no_precision() -> None:
    found = warning_figures(drives(1, 0.0), drives(2, 0.0), 99.0)
    assert found["f3"].value == found["recall"].value == 0
    assert math.isnan(found["precision"].value)
