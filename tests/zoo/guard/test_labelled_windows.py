"""Windows of a drive that end some seconds before a failure, and nominal ones."""

from itertools import pairwise

import numpy as np
import pytest

from zoo.guard.labelled_windows import LEADS_S, label_windows, window_scores

RATE = 15


def drive(seconds: float, *failures_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times and interventions of a drive with failures at the given times."""
    time_s = np.arange(round(seconds * RATE)) / RATE
    intervention = np.zeros(len(time_s), bool)
    intervention[[round(one * RATE) for one in failures_s]] = True
    return time_s, intervention


@pytest.mark.parametrize("lead", LEADS_S)
def test_a_window_of_one_second_ends_before_the_failure(lead: int) -> None:
    time_s, intervention = drive(20, 12.0)
    (window,) = label_windows(time_s, intervention).before[lead]
    assert window.stop - window.start == RATE
    assert time_s[window.stop - 1] == pytest.approx(12.0 - lead)


def test_normal_windows_end_long_before_the_failure_and_do_not_overlap() -> None:
    time_s, intervention = drive(20, 12.0)
    found = label_windows(time_s, intervention)
    ends = [time_s[one.stop - 1] for one in found.normal]
    assert all(one.stop - one.start == RATE for one in found.normal)
    assert all(one.stop <= other.start for one, other in pairwise(found.normal))
    # Before the failure: 1 s to settle, windows up to 4 s before it. After it: 12..20 s.
    assert [round(one) for one in ends] == [2, 3, 4, 5, 6, 7, 8, 14, 15, 16, 17, 18, 19]


def test_a_failure_shortly_after_a_put_back_has_no_window() -> None:
    time_s, intervention = drive(20, 10.0, 12.5)
    found = label_windows(time_s, intervention)
    assert found.failures == 2
    assert {lead: len(windows) for lead, windows in found.before.items()} == {1: 1, 2: 1, 3: 1}
    assert found.late == {1: 1, 2: 1, 3: 1}


def test_a_drive_without_a_failure_has_only_normal_windows() -> None:
    found = label_windows(*drive(10))
    assert found.failures == 0
    assert not any(found.before.values())
    assert len(found.normal) == 8


def test_a_failure_in_the_last_row_and_in_the_first_are_counted() -> None:
    time_s, intervention = drive(10, 0.0)
    intervention[-1] = True
    found = label_windows(time_s, intervention)
    assert found.failures == 2
    assert found.late == dict.fromkeys(LEADS_S, 1)


def test_a_windows_score_is_the_mean_of_its_frames() -> None:
    scores = window_scores(np.arange(10.0), [slice(0, 2), slice(4, 8)])
    assert scores.tolist() == [0.5, 5.5]
    assert window_scores(np.arange(3.0), []).shape == (0,)
