"""Trials of combinations on frames, from coarse to fine.

1. Every colour and crop, on every third frame of the centre camera. If the scale is not known, it
   is tried as -1..1 and as 0..255 only.
2. The best of these and the best of each colour, with every scale, on all frames of all cameras.
3. The neighbouring crops of the best of these, as long as one of them is better.
4. The best with each way of resizing, which changes the outputs least.
"""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import nn

from datamodules.view import View
from zoo.base.cores import usable_cores
from zoo.input_search.combinations import (
    SCALES,
    Combination,
    KnownInput,
    Scale,
    TrialFrames,
    combinations,
    with_each_resize,
)
from zoo.training.open_loop import side_response

SIDE_OFFSET = 0.25  # steering that solutions of the course add for the left camera: 0.2 to 0.3
COARSE_STEP = 3
COARSE_SCALES = (SCALES[0], SCALES[-1])
FINALISTS = 6
SCALED = 3  # combinations that are tried with every scale
NEAR_ROWS = 5  # difference of neighbouring crops, at the top and at the bottom
BATCH = 64
Network = Callable[[View, Scale], nn.Module]


@dataclass(frozen=True, eq=False)
class Trial:
    """A combination's outputs, and how well they agree with the recording.

    Attributes:
        combination: the view and the scale.
        center, left, right: steering that the network returns for each camera's frames, float64
            [N]; the side cameras' are empty without their images.
        steering: recorded steering, float64 [N].
    """

    combination: Combination
    center: np.ndarray
    left: np.ndarray
    right: np.ndarray
    steering: np.ndarray

    @cached_property
    def correlation(self) -> float:
        """Return Pearson's correlation of the output with the recorded steering."""
        return float(correlations(self.center[None], self.steering)[0])

    @cached_property
    def recovery(self) -> float | None:
        """Return the recovery response, -1..1; None without side images."""
        return side_response(self.left, self.right)

    @cached_property
    def score(self) -> float:
        """Return the agreement with the steering that each image calls for, see `concordance`.

        It is the recorded steering for the centre, and `SIDE_OFFSET` more or less for the side
        cameras. So the score has the correlation and the recovery response in it.
        """
        called = [self.steering, self.steering + SIDE_OFFSET, self.steering - SIDE_OFFSET]
        has_sides = len(self.left) > 0
        wanted = np.concatenate(called) if has_sides else self.steering
        return concordance(self.outputs, wanted)

    @property
    def outputs(self) -> np.ndarray:
        """Return the outputs for all cameras, one after the other, float64."""
        return np.concatenate([self.center, self.left, self.right])

    def rows(self, rows: np.ndarray) -> "Trial":
        """Return the trial of some rows only, such as a bootstrap's."""
        sides = [one[rows] if len(one) else one for one in (self.left, self.right)]
        return Trial(self.combination, self.center[rows], *sides, self.steering[rows])


@dataclass(frozen=True)
class Trials:
    """The trials of a search.

    Attributes:
        finalists: trials on all frames of all cameras, the highest score first.
        coarse: trials of the first stage, on some frames of the centre camera.
    """

    finalists: tuple[Trial, ...]
    coarse: tuple[Trial, ...]


def concordance(outputs: np.ndarray, steering: np.ndarray) -> float:
    """Return Lin's concordance correlation of outputs [N] with steering [N], -1..1.

    Source: Lin, "A concordance correlation coefficient to evaluate reproducibility", 1989. It is
    Pearson's correlation, reduced where the outputs' mean or spread differs from the steering's: a
    wrong input often leaves the correlation high, but not these. 0 if an output is not finite.
    """
    with np.errstate(all="ignore"):
        covariance = np.mean((outputs - outputs.mean()) * (steering - steering.mean()))
        spread = outputs.var() + steering.var() + (outputs.mean() - steering.mean()) ** 2
        found = 2 * covariance / spread
    return float(found) if np.isfinite(found) else 0.0


def correlations(outputs: np.ndarray, steering: np.ndarray) -> np.ndarray:
    """Return Pearson's correlation of each row of outputs [C, N] with steering [N], float64 [C].

    It is 0 for constant outputs, and for outputs that are not finite.
    """
    with np.errstate(all="ignore"):
        centred = outputs - outputs.mean(1, keepdims=True)
        wanted = steering - steering.mean()
        product = centred @ wanted
        product /= np.sqrt(np.square(centred).sum(1) * np.square(wanted).sum())
    return np.nan_to_num(product, nan=0.0, posinf=0.0, neginf=0.0)


def try_inputs(
    network: Network,
    known: KnownInput,
    frames: TrialFrames,
    show: Callable[[float], None] = lambda share: None,
) -> Trials:
    """Try the combinations that fit what is known, and return the trials.

    Args:
        network: function of a view and a scale that returns the network for them, in evaluation
            mode, on the CPU.
        known: facts about the input.
        frames: frames to try on.
        show: function called with the finished share of the work, 0..1.

    Raises:
        InputError: no combination fits.
    """
    possible = combinations(known)
    if known.scale is None:
        possible = [one for one in possible if one.scale in COARSE_SCALES]
    some = frames.every(COARSE_STEP).center_only()
    coarse = _try_all(network, possible, some, lambda share: show(0.4 * share))
    chosen = _finalists(coarse, known)
    finalists = _try_all(network, chosen, frames, lambda share: show(0.4 + 0.5 * share))
    while more := _neighbours(finalists, combinations(known)):
        finalists += _try_all(network, more, frames)
    best = max(finalists, key=_score).combination
    finalists += _try_all(network, with_each_resize(best, known)[1:], frames)
    show(1.0)
    return Trials(tuple(sorted(finalists, key=_score, reverse=True)), tuple(coarse))


def _neighbours(finalists: list[Trial], possible: list[Combination]) -> list[Combination]:
    """Return the combinations near the best finalist that are not tried yet."""
    best = max(finalists, key=_score).combination
    tried = {one.combination for one in finalists}
    return [
        one
        for one in possible
        if one not in tried
        and (one.view.colour, one.scale) == (best.view.colour, best.scale)
        and all(
            abs(rows - own) <= NEAR_ROWS
            for rows, own in zip(one.view.crop, best.view.crop, strict=True)
        )
    ]


def _score(trial: Trial) -> float:
    return trial.score


def _try_all(
    network: Network,
    chosen: Sequence[Combination],
    frames: TrialFrames,
    show: Callable[[float], None] = lambda share: None,
) -> list[Trial]:
    """Return the trial of each combination; each core tries another one.

    This is faster than to share each batch among the cores, most of all on a busy machine.
    """
    trials = []
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with ThreadPoolExecutor(min(threads, usable_cores())) as pool:
            for one in pool.map(lambda one: try_one(network, one, frames), chosen):
                trials.append(one)
                show(len(trials) / len(chosen))
    finally:
        torch.set_num_threads(threads)
    return trials


@torch.inference_mode()
def try_one(network: Network, combination: Combination, frames: TrialFrames) -> Trial:
    """Return the trial of a combination."""
    module = network(combination.view, combination.scale)
    outputs = [
        _steering(module, combination.view, one)
        for one in (frames.center, frames.left, frames.right)
    ]
    return Trial(combination, *outputs, frames.steering)


def _steering(module: nn.Module, view: View, frames: np.ndarray) -> np.ndarray:
    """Return the network's steering for frames uint8 [N, H, W, 3] RGB, float64 [N]."""
    steering = []
    for start in range(0, len(frames), BATCH):
        images = np.stack([view(frame) for frame in frames[start : start + BATCH]])
        steering.append(module(torch.from_numpy(images).permute(0, 3, 1, 2))[:, 0].numpy())
    return np.concatenate(steering).astype(np.float64) if steering else np.empty(0)


def _finalists(coarse: Iterable[Trial], known: KnownInput) -> list[Combination]:
    """Return the best combinations, with each scale if it is not known, and each colour's best."""
    ranked = [one.combination for one in sorted(coarse, key=_score, reverse=True)]
    colours = {one.view.colour: one for one in reversed(ranked)}
    best = ranked[:FINALISTS]
    if known.scale is None:
        best = [replace(one, scale=scale) for one in ranked[:SCALED] for scale in SCALES]
    return list(dict.fromkeys([*best, *colours.values()]))
