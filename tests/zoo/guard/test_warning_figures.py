"""Windows before failures, and recall, precision, false alarms, F3 and AUC with intervals."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

from zoo.guard.warning_figures import LEADS_S, label_windows, warning_figures, window_scores


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


RATE = 15


def failing_drive(seconds: float, *failures_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times and interventions of a drive with failures at the given times."""
    time_s = np.arange(round(seconds * RATE)) / RATE
    intervention = np.zeros(len(time_s), bool)
    intervention[[round(one * RATE) for one in failures_s]] = True
    return time_s, intervention


@pytest.mark.parametrize("lead", LEADS_S)
def test_a_window_of_one_second_ends_before_the_failure(lead: int) -> None:
    time_s, intervention = failing_drive(20, 12.0)
    (window,) = label_windows(time_s, intervention).before[lead]
    assert window.stop - window.start == RATE
    assert time_s[window.stop - 1] == pytest.approx(12.0 - lead)


def test_normal_windows_end_long_before_the_failure_and_do_not_overlap() -> None:
    time_s, intervention = failing_drive(20, 12.0)
    found = label_windows(time_s, intervention)
    ends = [time_s[one.stop - 1] for one in found.normal]
    assert all(one.stop - one.start == RATE for one in found.normal)
    assert all(one.stop <= other.start for one, other in pairwise(found.normal))
    # Before the failure: 1 s to settle, windows up to 4 s before it. After it: 12..20 s.
    assert [round(one) for one in ends] == [2, 3, 4, 5, 6, 7, 8, 14, 15, 16, 17, 18, 19]


def test_a_failure_shortly_after_a_put_back_has_no_window() -> None:
    time_s, intervention = failing_drive(20, 10.0, 12.5)
    found = label_windows(time_s, intervention)
    assert found.failures == 2
    assert {lead: len(windows) for lead, windows in found.before.items()} == {1: 1, 2: 1, 3: 1}
    assert found.late == {1: 1, 2: 1, 3: 1}


def test_a_drive_without_a_failure_has_only_normal_windows() -> None:
    found = label_windows(*failing_drive(10))
    assert found.failures == 0
    assert not any(found.before.values())
    assert len(found.normal) == 8


def test_a_failure_in_the_last_row_and_in_the_first_are_counted() -> None:
    time_s, intervention = failing_drive(10, 0.0)
    intervention[-1] = True
    found = label_windows(time_s, intervention)
    assert found.failures == 2
    assert found.late == dict.fromkeys(LEADS_S, 1)


def test_a_windows_score_is_the_mean_of_its_frames() -> None:
    scores = window_scores(np.arange(10.0), [slice(0, 2), slice(4, 8)])
    assert scores.tolist() == [0.5, 5.5]
    assert window_scores(np.arange(3.0), []).shape == (0,)
