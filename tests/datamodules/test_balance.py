"""Samples of a row's cameras, and the balanced batches of them."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datamodules.balance import BalancedBatches, epoch_batches
from datamodules.samples import CENTER, LEFT, RIGHT, Samples, make_samples, recovery_steering
from datamodules.windows import Windows
from tests.recordings import recording_in_memory
from zoo.base.errors import InputError, UsageError
from zoo.base.rig import UDACITY

FREE = {"straight_cap": None}


def samples_of(steering: np.ndarray, cameras: tuple[str, ...] = ("center",)) -> Samples:
    return make_samples(recording_in_memory(steering), np.arange(len(steering)), [*cameras], 0.25)


def straight_of(samples: Samples, batch: np.ndarray, threshold: float = 0.1) -> int:
    return int((np.abs(samples.steering[batch]) < threshold).sum())


@st.composite
def straight_and_curved(draw) -> np.ndarray:
    """Draw steering of 2 to 300 rows, mostly straight, with at least one curved row."""
    rows = draw(st.integers(1, 300))
    share = draw(st.floats(0, 1))
    rng = np.random.default_rng(draw(st.integers(0, 1000)))
    steering = np.where(rng.random(rows) < share, 0.0, rng.uniform(-1, 1, rows))
    return np.append(steering, 0.5)


@given(
    steering=straight_and_curved(),
    cap=st.one_of(st.floats(0, 1), st.sampled_from([None, 0.0, 0.1, 0.29, 0.3, 0.5, 0.7, 1.0])),
    batch_size=st.integers(1, 130),
    count=st.one_of(st.none(), st.integers(1, 500)),
    epoch=st.integers(0, 3),
)
def test_batches_are_whole_and_none_exceeds_the_cap(steering, cap, batch_size, count, epoch):
    samples = samples_of(steering)
    balanced = BalancedBatches(samples, batch_size, 1, samples_per_epoch=count, straight_cap=cap)
    balanced.set_epoch(epoch)
    batches = [key.samples for key in balanced]
    assert sum(map(len, batches)) == (count or len(samples))
    assert all(len(batch) == batch_size for batch in batches[:-1])
    for batch in batches if cap is not None else []:
        assert straight_of(samples, batch) <= math.floor(cap * len(batch))


def test_the_cap_is_used_up():
    """Nine of ten rows are straight: each batch of 20 holds 10 of them, not fewer."""
    samples = samples_of(np.where(np.arange(1000) % 10, 0.0, 0.5))
    batches = epoch_batches(samples, 20, 0, 1, straight_cap=0.5)
    assert {straight_of(samples, batch) for batch in batches[:-1]} == {10}


def test_the_cap_is_judged_on_the_corrected_steering():
    """A straight row is a curve through the left camera, and a curve may be straight there."""
    samples = samples_of(np.array([0.0, -0.25] * 50), ("center", "left"))
    for batch in epoch_batches(samples, 10, 0, 1, straight_cap=0.3):
        assert np.isclose(samples.steering[batch], 0.0).sum() <= 3


def test_the_threshold_itself_is_not_straight():
    samples = samples_of(np.full(10, 0.25))
    assert len(epoch_batches(samples, 5, 0, 1, straight_cap=0.0, straight_threshold=0.25)) == 2


@given(cap=st.sampled_from([None, 0.5]), batch_size=st.integers(1, 50), rows=st.integers(1, 200))
def test_under_the_cap_each_sample_comes_once(cap, batch_size, rows):
    """A cap that no batch reaches changes nothing."""
    samples = samples_of(np.full(rows, 0.5))
    drawn = np.concatenate(epoch_batches(samples, batch_size, 0, 1, straight_cap=cap))
    assert sorted(drawn) == list(range(rows))


def test_rows_are_drawn_alike_however_many_cameras_they_have():
    """Row 0 has one camera, row 1 has three: each gets half of the draws."""
    recording = recording_in_memory(np.zeros(2))
    recording.images[0, 1:] = None
    samples = make_samples(recording, np.arange(2), ["center", "left", "right"], 0.25)
    (batch,) = epoch_batches(samples, 6000, 0, 1, samples_per_epoch=6000, **FREE)
    counts = Counter(zip(samples.row[batch].tolist(), samples.camera[batch].tolist(), strict=True))
    assert counts[0, 0] == pytest.approx(3000, abs=200)
    for camera in range(3):
        assert counts[1, camera] == pytest.approx(1000, abs=120)


def keys(samples: Samples, seed: int = 1, epoch: int = 0, rank: int = 0, world: int = 1, **balance):
    batches = BalancedBatches(samples, 10, seed, rank, world, **balance)
    batches.set_epoch(epoch)
    listed = list(batches)
    assert len(listed) == len(batches)
    return listed


def order(listed) -> list[int]:
    return np.concatenate([key.samples for key in listed]).tolist()


def test_batches_are_those_of_the_seed_and_epoch():
    samples = samples_of(np.append(np.zeros(200), np.full(20, 0.5)))
    drawn = [(seed, epoch) for seed in (1, 2) for epoch in (0, 1)]
    orders = {pair: order(keys(samples, *pair)) for pair in drawn}
    assert orders[2, 1] == order(keys(samples, seed=2, epoch=1))
    assert len(set(map(tuple, orders.values()))) == 4


def test_keys_are_numbered_within_their_epoch():
    listed = keys(samples_of(np.zeros(35)), epoch=2, **FREE)
    assert [(key.epoch, key.number) for key in listed] == [(2, 0), (2, 1), (2, 2), (2, 3)]


@st.composite
def balances(draw) -> tuple[Samples, dict]:
    """Draw samples and arguments of `epoch_batches`: with or without cap, weights and a count."""
    samples = samples_of(draw(straight_and_curved()))
    rng = np.random.default_rng(draw(st.integers(0, 1000)))
    balance = {
        "straight_cap": draw(st.sampled_from([None, 0.0, 0.3, 1.0])),
        "samples_per_epoch": draw(st.one_of(st.none(), st.integers(1, 400))),
    }
    if draw(st.booleans()):
        balance["weights"] = rng.uniform(0.1, 5, len(samples))
    return samples, balance


@given(drawn=balances(), world=st.integers(1, 4), size=st.integers(1, 130), epoch=st.integers(0, 3))
def test_the_shares_of_processes_are_the_batches_of_one(drawn, world, size, epoch):
    """The ranks' shards hold each sample of each step once, in the same order."""
    samples, balance = drawn
    alone = BalancedBatches(samples, size, 1, **balance)
    ranks = [BalancedBatches(samples, size, 1, rank, world, **balance) for rank in range(world)]
    for batches in (alone, *ranks):
        batches.set_epoch(epoch)
        assert len(batches) == len(list(batches))
    steps = 0
    for whole, *shares in zip(alone, *ranks, strict=True):
        assert np.concatenate([key.own for key in shares]).tolist() == whole.own.tolist()
        sizes = [len(key.own) for key in shares]
        assert max(sizes) - min(sizes) <= 1
        assert {(key.epoch, key.number) for key in shares} == {(epoch, whole.number)}
        steps += 1
    assert steps == len(alone)


def test_a_cap_without_a_curved_sample_cannot_be_held():
    with pytest.raises(InputError, match=r"straight_cap=0\.5 cannot be held.*straight_cap=null"):
        epoch_batches(samples_of(np.zeros(50)), 10, 0, 1)


@given(
    weights=st.lists(st.floats(0.05, 7), min_size=1, max_size=60).map(np.array),
    batch_size=st.integers(1, 20),
    epoch=st.integers(0, 3),
)
def test_a_sample_comes_its_weight_rounded_up_or_down(weights, batch_size, epoch):
    samples = samples_of(np.zeros(len(weights)))
    batches = epoch_batches(samples, batch_size, epoch, 1, weights=weights, **FREE)
    counts = np.bincount(np.concatenate(batches), minlength=len(weights))
    assert counts.sum() == max(1, round(weights.sum()))
    scaled = weights * (counts.sum() / weights.sum())
    assert (counts >= np.floor(scaled - 1e-6)).all()
    assert (counts <= np.ceil(scaled + 1e-6)).all()
    assert len(BalancedBatches(samples, batch_size, 1, weights=weights)) == len(batches)


def test_a_fraction_does_not_pick_one_camera_of_three():
    recording = recording_in_memory(np.zeros(300))
    samples = make_samples(recording, np.arange(300), ["center", "left", "right"], 0.25)
    drawn = np.concatenate(epoch_batches(samples, 50, 0, 1, weights=np.full(900, 1 / 3), **FREE))
    assert np.bincount(samples.camera[drawn]) == pytest.approx([100] * 3, abs=30)


def test_draws_are_by_weight():
    samples = samples_of(np.zeros(10), ("center", "left"))
    weights = np.where(samples.row < 5, 1.0, 3.0)
    (batch,) = epoch_batches(samples, 8000, 0, 1, samples_per_epoch=8000, weights=weights, **FREE)
    assert (samples.row[batch] >= 5).mean() == pytest.approx(0.75, abs=0.02)


def test_what_replaces_straight_samples_is_drawn_by_weight():
    samples = samples_of(np.repeat([0.0, 0.5, -0.5], [900, 50, 50]))
    weights = np.repeat([1.0, 1.0, 9.0], [900, 50, 50])
    batches = epoch_batches(samples, 100, 0, 1, straight_cap=0.0, weights=weights)
    assert (samples.steering[np.concatenate(batches)] < 0).mean() == pytest.approx(0.9, abs=0.03)


ALL = ["center", "left", "right"]


def test_left_steers_right_and_right_steers_left_up_to_full_lock():
    samples = make_samples(recording_in_memory([0.1, 0.9, -0.9]), np.arange(3), ALL, offset=0.25)
    assert samples.camera.tolist() == [CENTER, LEFT, RIGHT] * 3
    steering = [0.1, 0.35, -0.15, 0.9, 1, 0.65, -0.9, -0.65, -1]
    np.testing.assert_allclose(samples.steering, steering, atol=1e-7)


def test_each_row_has_its_recorded_cameras_in_their_order():
    recording = recording_in_memory(np.zeros(5), cameras=("center", "right"))
    samples = make_samples(recording, np.array([1, 3]), ["right", "center", "left"], 0.25)
    assert (samples.row.tolist(), samples.camera.tolist()) == ([1, 1, 3, 3], [CENTER, RIGHT] * 2)


def test_brake_is_throttle_below_zero():
    recording = recording_in_memory(np.zeros(2))
    recording.throttle[:], recording.brake[:] = [0.7, 0.0], [0.0, 0.4]
    samples = make_samples(recording, np.arange(2), ["center"], 0.25)
    np.testing.assert_allclose(samples.throttle, [0.7, -0.4])


def test_both_ways_is_everything_a_second_time_mirrored():
    recording = recording_in_memory([0.1, -0.2])
    samples = make_samples(recording, np.arange(2), ALL, 0.25, both_ways=True)
    assert samples.flipped.tolist() == [False] * 6 + [True] * 6
    np.testing.assert_array_equal(samples.row[:6], samples.row[6:])
    np.testing.assert_array_equal(samples.camera[:6], samples.camera[6:])
    np.testing.assert_array_equal(samples.steering[:6], samples.steering[6:])


def test_recovery_against_a_hand_computation():
    """20 mph is 8.94 m/s: 17.88 m in 2 s.

    An arc through a point 17.88 m ahead and 0.806 m aside has the curvature
    2 * 0.806 / (17.88^2 + 0.806^2) = 0.005031 per m; with a wheelbase of 2.87 m the wheels turn
    atan(2.87 * 0.005031) = 0.8273 degrees of 25.
    """
    assert recovery_steering(-0.806, 20.0, 2.0, UDACITY) == pytest.approx(0.8273 / 25, abs=1e-5)


def test_recovery_of_left_and_right_cameras_by_speed():
    recording = recording_in_memory([0.0, 0.0], speed_mph=np.array([30.0, 10.0]))
    samples = make_samples(recording, np.arange(2), ALL, offset=9.9, recover_s=2.0)
    fast, slow = samples.steering.reshape(2, 3)
    assert fast[CENTER] == slow[CENTER] == 0
    assert 0 < fast[LEFT] < slow[LEFT] < 1
    assert 0 > fast[RIGHT] > slow[RIGHT] > -1


@pytest.mark.parametrize("settings", [{"recover_s": 2.0}, {"windows": Windows(ahead=1)}])
def test_a_side_camera_whose_place_is_unknown_is_refused(settings):
    for rig in (replace(UDACITY, cameras={"center": UDACITY.cameras["center"]}), None):
        recording = replace(recording_in_memory([0.0] * 4), rig=rig)
        with pytest.raises(UsageError, match=r"left camera; .*data\.cameras=\[center\]"):
            make_samples(recording, np.array([0, 1]), ALL, **settings)
        make_samples(recording, np.array([0, 1]), ["center"], **settings)


def test_recovery_of_a_standing_car_is_that_of_four_metres():
    at_rest = recovery_steering(0.825, 0.0, 2.0, UDACITY)
    assert at_rest == recovery_steering(0.825, 4 / 0.44704 / 2, 2.0, UDACITY)
    assert -1 < at_rest < -0.3


def test_no_image_of_the_cameras_wanted():
    recording = recording_in_memory([0.0], cameras=("center",))
    with pytest.raises(InputError, match="no row has an image"):
        make_samples(recording, np.array([0]), ["left", "right"], 0.25)
