"""Policies with memory: resets, sessions, the stride and the latency."""

import numpy as np
import pytest
import torch

from tests.zoo.models.test_memory import NAMES
from tests.zoo.models.test_models_command import build
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.policy import CheckpointPolicy

FRAMES = np.random.default_rng(3).integers(0, 256, (6, 160, 320, 3), np.uint8)


def policy_of(name: str, *overrides: str, **data: float) -> CheckpointPolicy:
    torch.manual_seed(1)
    network, view = build(name, *overrides)
    return CheckpointPolicy(Checkpoint(network.eval(), view, {}, dict(data)))


def steering(policy: CheckpointPolicy, frames: np.ndarray = FRAMES) -> list[float]:
    return [policy(frame, 9.0).steering for frame in frames]


@pytest.mark.parametrize("name", NAMES)
def test_a_reset_forgets_the_frames_before(name: str) -> None:
    policy = policy_of(name, "model.sequence=4")
    first = steering(policy)
    assert steering(policy)[0] != first[0], "it has no memory"
    policy.reset()
    assert steering(policy) == first


@pytest.mark.parametrize("name", NAMES)
def test_sessions_do_not_mix_their_frames(name: str) -> None:
    policy = policy_of(name, "model.sequence=4")
    wanted = steering(policy)
    one, other = policy.session(), policy.session()
    for forth, back, steers in zip(FRAMES, FRAMES[::-1], wanted, strict=True):
        assert one(forth, 9.0).steering == steers
        other(back, 9.0)


def test_with_a_stride_each_state_sees_every_second_frame() -> None:
    policy = policy_of("cnn_gru", "model.stride=2")
    even, odd = policy_of("cnn_gru"), policy_of("cnn_gru")
    wanted = [0.0] * len(FRAMES)
    wanted[0::2], wanted[1::2] = steering(even, FRAMES[0::2]), steering(odd, FRAMES[1::2])
    assert steering(policy) == wanted


def test_the_steering_is_that_of_the_time_at_which_it_reaches_the_wheels() -> None:
    policy = policy_of("action_chunk", "model.ahead=3", "model.stride=3", rows_per_s=15.0)
    with torch.no_grad():
        images = torch.from_numpy(policy.view(FRAMES[0])).permute(2, 0, 1)[None]
        steps = policy.network.step(images, *policy.network.first_state())[0][0, :, 0]
    now, *later = steps.clamp(-1, 1).tolist()
    asked = {0.0: now, 0.2: later[0], 0.3: (later[0] + later[1]) / 2, 0.6: later[2], 9.0: later[2]}
    for latency_s, wanted in asked.items():
        policy.latency_s = latency_s
        policy.reset()
        assert policy(FRAMES[0], 9.0).steering == pytest.approx(wanted, abs=1e-6)


def test_without_the_recordings_rate_the_latency_changes_nothing() -> None:
    policy = policy_of("action_chunk")
    before = policy(FRAMES[0], 9.0)
    policy.latency_s = 0.5
    assert policy(FRAMES[0], 9.0) == before


@pytest.mark.parametrize("name", ["nvidia", "cnn_gru"])
def test_only_policies_that_predict_ahead_have_a_latency(name: str) -> None:
    assert policy_of(name).latency_s is None
    assert policy_of("action_chunk").latency_s == 0.0
