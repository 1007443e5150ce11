import pytest

from zoo.drives.intervals import wilson_interval


def test_a_wider_confidence_gives_a_wider_interval() -> None:
    low, high = wilson_interval(5, 10)
    wider_low, wider_high = wilson_interval(5, 10, confidence=0.99)

    assert wider_low < low < 0.5 < high < wider_high


def test_more_trials_give_a_narrower_interval() -> None:
    assert wilson_interval(30, 30)[0] > wilson_interval(3, 3)[0]


@pytest.mark.parametrize(("successes", "trials"), [(4, 3), (-1, 3)])
def test_a_count_outside_its_trials_is_refused(successes: int, trials: int) -> None:
    with pytest.raises(ValueError, match=f"{successes} of {trials}"):
        wilson_interval(successes, trials)
