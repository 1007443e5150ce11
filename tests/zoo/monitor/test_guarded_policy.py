"""A guard file, and the policy that it watches."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.zoo.written_checkpoints import write_pilotnet
from zoo.base.bounded_files import hash_file
from zoo.base.errors import InputError
from zoo.checkpoints.command import Command, Policy
from zoo.checkpoints.policy import load_policy
from zoo.monitor.guarded_policy import KEY, Guard, GuardedPolicy, guarded, read_guard, write_guard
from zoo.monitor.scores import fit_score, make_score

DARK, BRIGHT = (np.full((160, 320, 3), grey, np.uint8) for grey in (20, 230))


class Remembering(Policy):
    """A policy with a state and a spread that is the frame's brightness."""

    latency_s = 0.0

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, frame: np.ndarray, mph: float) -> Command:
        self.calls += 1
        return Command(0.1, None, float(frame.mean()))

    def reset(self) -> None:
        self.calls = 0

    def session(self) -> "Remembering":
        return Remembering()


def guard_of_brightness(window: int = 3) -> Guard:
    return Guard(make_score("spread", {}), 100.0, window, 6.0, 8, "0" * 64)


def test_the_guard_limits_the_speed_while_a_whole_window_is_above_the_threshold() -> None:
    policy = GuardedPolicy(Remembering(), guard_of_brightness())
    frames = [DARK, DARK, BRIGHT, BRIGHT, DARK, DARK, DARK, BRIGHT, BRIGHT]
    limits = [policy(frame, 9.0).limit_mph for frame in frames]
    # Means of the last three: -, -, 90, 160, 160, 90, 20, 90, 160.
    assert limits == [None, None, None, 6.0, 6.0, None, None, None, 6.0]
    assert policy.alarms == 2
    assert policy(DARK, 9.0).steering == 0.1


def test_a_reset_forgets_the_window_and_the_policys_frames() -> None:
    policy = GuardedPolicy(Remembering(), guard_of_brightness())
    for _ in range(3):
        policy(BRIGHT, 9.0)
    assert policy.fires
    policy.reset()
    assert not policy.fires
    assert policy.policy.calls == 0
    assert policy(BRIGHT, 9.0).limit_mph is None, "the window is not whole yet"


def test_each_session_has_a_window_of_its_own_and_alarms_add_up() -> None:
    policy = GuardedPolicy(Remembering(), guard_of_brightness(1))
    first, second = policy.session(), policy.session()
    first(BRIGHT, 9.0)
    assert first.fires
    assert not second.fires
    second(BRIGHT, 9.0)
    assert policy.alarms == 2
    assert first.policy is not second.policy


def _autoencoder(checkpoint: Path, **changes: object) -> Guard:
    score = fit_score("autoencoder", np.zeros((8, 40, 80, 3), np.uint8), epochs=1)
    return Guard(score, 0.01, 2, 6.0, 8, hash_file(checkpoint))


def test_a_guard_file_fires_as_the_guard_that_was_written(tmp_path: Path) -> None:
    checkpoint = write_pilotnet(tmp_path / "best.ckpt")
    guard = _autoencoder(checkpoint)
    path = write_guard(tmp_path / "guard.pt", guard)
    read, written = (
        guarded(load_policy(checkpoint), checkpoint, path),
        GuardedPolicy(load_policy(checkpoint), guard),
    )
    for frame in (DARK, DARK, BRIGHT, BRIGHT):
        assert read(frame, 9.0) == written(frame, 9.0)
    assert read.alarms == 1


def test_a_guard_of_a_network_fits_only_its_checkpoint(tmp_path: Path) -> None:
    own, other = (write_pilotnet(tmp_path / f"{seed}.ckpt", seed) for seed in (1, 2))
    score = make_score("dropout", {})
    path = write_guard(tmp_path / "guard.pt", Guard(score, 0.01, 2, 6.0, 8, hash_file(own)))
    assert guarded(load_policy(own), own, path).alarms == 0
    with pytest.raises(InputError, match="another checkpoint"):
        guarded(load_policy(other), other, path)
    images = write_guard(tmp_path / "images.pt", _autoencoder(own))
    assert guarded(load_policy(other), other, images).alarms == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": 9}, "format version 9"),
        ({"threshold": float("nan")}, "threshold"),
        ({"window": 0}, "window"),
        ({"method": "magic"}, "method"),
        ({"state": {}}, "state"),
        ({"state": None}, "state"),
        ({"limit_mph": "fast"}, "limit_mph"),
        ({"samples": 10**8}, "samples"),
        ({"state": {"shape": [3, 8 * 10**6, 8 * 10**6], "weights": {}}}, "state"),
        ({"method": "attention_mean", "state": {"mean": "much"}}, "state"),
    ],
)
def test_a_damaged_guard_file_is_one_line(tmp_path: Path, change: dict, words: str) -> None:
    path = write_guard(tmp_path / "guard.pt", _autoencoder(write_pilotnet(tmp_path / "a.ckpt")))
    contents = torch.load(path, weights_only=True)
    contents[KEY] |= change
    torch.save(contents, path)
    with pytest.raises(InputError, match=words) as caught:
        read_guard(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_another_file_is_no_guard(tmp_path: Path) -> None:
    checkpoint = write_pilotnet(tmp_path / "best.ckpt")
    with pytest.raises(InputError, match="is not a guard file"):
        read_guard(checkpoint)
    with pytest.raises(InputError, match="cannot be read"):
        read_guard(tmp_path / "missing.pt")
