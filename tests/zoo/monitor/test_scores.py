"""Scores of frames: fitted on nominal frames, higher for others, and deterministic."""

from pathlib import Path

import numpy as np
import pytest

from tests.zoo.written_checkpoints import write_constant, write_pilotnet
from zoo.checkpoints.command import Command
from zoo.checkpoints.policy import load_policy
from zoo.monitor.scores import METHODS, fit_score, make_score
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
