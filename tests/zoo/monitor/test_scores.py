"""Scores of unusual frames, their thresholds, and the policy that a guard watches."""

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy import stats

from tests.zoo.written_checkpoints import write_constant, write_pilotnet
from zoo.base.bounded_files import hash_file
from zoo.base.errors import InputError
from zoo.checkpoints.command import Command, Policy
from zoo.checkpoints.policy import load_policy
from zoo.monitor.guarded_policy import KEY, Guard, GuardedPolicy, guarded, read_guard, write_guard
from zoo.monitor.scores import METHODS, fit_score, fit_threshold, make_score
from zoo.monitor.signals import DROPOUT, ENSEMBLE, IMAGE, MAP, SPREAD, signal_sources

RNG = np.random.default_rng(0)
FRAME = RNG.integers(0, 255, (160, 320, 3), np.uint8)


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pilotnet(tmp_path_factory.mktemp("run") / "best.ckpt")


def nominal(count: int = 64) -> np.ndarray:
    """Return images with a bright strip that moves, uint8 [count, 40, 80, 3]."""
    images = np.zeros((count, 40, 80, 3), np.uint8)
    for row, image in enumerate(images):
        image[20:, 20 + row % 30 : 40 + row % 30] = 180
    return images


def test_an_autoencoder_reconstructs_nominal_images_best() -> None:
    score = fit_score("autoencoder", nominal(), epochs=15)
    odd = 255 - nominal()
    assert score(odd).min() > 2 * score(nominal()).max()
    again = make_score("autoencoder", score.state)
    np.testing.assert_array_equal(again(odd), score(odd))


def test_a_fit_is_repeated_to_the_bit() -> None:
    first, second = (fit_score("autoencoder", nominal(), epochs=1) for _ in range(2))
    np.testing.assert_array_equal(first(nominal()), second(nominal()))


def test_attention_scores_are_level_and_change() -> None:
    maps = np.zeros((3, 16, 64, 1), np.uint8)
    maps[2] = 255
    level = fit_score("attention_mean", maps[:2], epochs=1)
    assert level(maps).tolist() == [0, 0, 1]
    assert fit_score("attention_change", maps, epochs=1)(maps).tolist() == [0, 0, 1]


def test_every_frames_score_needs_only_the_frames_that_its_method_names() -> None:
    maps = RNG.integers(0, 255, (9, 16, 64, 1), np.uint8)
    images = RNG.integers(0, 255, (9, 40, 80, 3), np.uint8)
    signals = {MAP: maps, IMAGE: images}
    for name, method in METHODS.items():
        own = signals.get(method.signal, RNG.random(9))
        score = fit_score(name, own, epochs=1)
        last = score(own[-method.frames :])[-1]
        assert last == pytest.approx(score(own)[-1], rel=1e-5)


def test_a_network_with_dropout_has_image_map_and_spread(checkpoint: Path) -> None:
    policy = load_policy(checkpoint)
    sources, lacking = signal_sources(policy, samples=8)
    assert set(sources) == {IMAGE, MAP, DROPOUT}
    assert SPREAD in lacking[0]
    command = policy(FRAME, 9.0)
    assert sources[IMAGE](FRAME, 9.0, command).shape == (40, 80, 3)
    assert sources[MAP](FRAME, 9.0, command).shape == (16, 64, 1)
    spread = sources[DROPOUT](FRAME, 9.0, command)
    assert spread > 0
    assert sources[DROPOUT](FRAME, 9.0, command) == spread, "the masks are the same for each frame"
    assert policy(FRAME, 9.0) == command, "the policy itself drives without dropout"


def test_a_network_without_dropout_is_one_line(tmp_path: Path) -> None:
    policy = load_policy(write_pilotnet(tmp_path / "best.ckpt", dropout=0.0))
    sources, lacking = signal_sources(policy, samples=8)
    assert DROPOUT not in sources
    assert any("has no dropout" in one for one in lacking)


def test_the_spread_of_a_policy_and_of_an_ensemble(checkpoint: Path, tmp_path: Path) -> None:
    def doubting(frame: np.ndarray, mph: float) -> Command:
        return Command(0.1, None, 0.25)

    others = [load_policy(write_constant(tmp_path / "other.ckpt", 0.3))]
    sources, _ = signal_sources(doubting, 8, others)
    assert set(sources) == {IMAGE, SPREAD, ENSEMBLE}
    command = doubting(FRAME, 9.0)
    assert sources[SPREAD](FRAME, 9.0, command) == 0.25
    expected = np.std([0.1, 0.3], ddof=1)
    assert sources[ENSEMBLE](FRAME, 9.0, command) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("rate", [0.01, 0.05, 0.3])
def test_the_share_above_the_threshold_is_the_chosen_rate(rate: float) -> None:
    scores = stats.gamma(2, scale=0.3).rvs(20_000, random_state=1)
    found = fit_threshold(scores, rate)
    assert (scores > found.value).mean() == pytest.approx(rate, rel=0.1)
    assert (found.shape, found.scale) == pytest.approx((2, 0.3), rel=0.1)


def test_scores_of_0_can_be_fitted() -> None:
    assert np.isfinite(fit_threshold(np.array([0.0, *np.linspace(1, 2, 40)]), 0.05).value)


@pytest.mark.parametrize("scores", [np.ones(30), np.arange(5.0), np.full(30, np.nan)])
def test_too_few_or_equal_scores_are_one_line(scores: np.ndarray) -> None:
    with pytest.raises(InputError, match="nominal"):
        fit_threshold(scores, 0.05)


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
        ({"method": "attention_mean", "state": torch.tensor(1.0)}, "state"),
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
