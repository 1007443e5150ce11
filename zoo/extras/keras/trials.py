"""Trials of combinations on frames, from coarse to fine.

1. Every colour, crop and unknown scale, on few frames of the centre camera.
2. The better third of the colours and crops, with their best scale, on more frames.
3. The best of these and the best of each colour, on these frames of all cameras.
4. The neighbouring crops of the best of these and its other scales, as long as one is better.
5. The best with each way of resizing, which changes the outputs least; and `POPULAR`.

`zoo.extras.keras.judgement` tries again, on all frames, what these cannot tell apart.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter

import numpy as np
import torch
from torch import nn

from datamodules.view import RESIZES, View
from zoo.base.machine import usable_cores
from zoo.driving.run_drives import one_thread
from zoo.extras.keras.combinations import (
    SCALES,
    Combination,
    KnownInput,
    Scale,
    TrialFrames,
    combinations,
    popular_combinations,
    with_each_resize,
)
from zoo.training.open_loop import side_response

# Steering that each camera's image calls for more than the centre's; solutions of the course add
# 0.2 to 0.3 for the left camera.
SIDE_OFFSETS = np.array([0.0, 0.25, -0.25])
SPREAD_WEIGHT = 1 / 8  # of the spread and the mean, beside the correlation
LEAST_LIKENESS = 0.5  # of an output that means steering; published networks reach 0.65 or more
COARSE_ROWS, COARSE_STEP = 100, 3  # rows after the first stage, and every how many in it
COARSE_SCALES = [scale for scale in SCALES if scale != (128.0, 1.0)]  # it is near (127.5, 1)
FINALISTS = 6
MOST_TIED = 4  # that are tried on all frames
USUAL_NEIGHBOURS = 6  # crops and scales that are tried in the fourth stage
HOPELESS = 0.5  # of the best agreement in the first stage; another colour below it is left out
NEAR_ROWS = 5  # difference of neighbouring crops, at the top and at the bottom
BATCH = 64
Network = Callable[[View, Scale], nn.Module]
_score = attrgetter("score")


@dataclass(frozen=True, eq=False)
class Trial:
    """A combination's outputs, and how well they agree with the recording.

    Attributes:
        combination: the view and the scale.
        cameras: steering that the network returns for each camera's frames, float64 [cameras, N]:
            the centre one, or the centre, left and right ones.
        steering: recorded steering, float64 [N].
    """

    combination: Combination
    cameras: np.ndarray
    steering: np.ndarray

    @cached_property
    def correlation(self) -> float:
        """Return Pearson's correlation of the output with the recorded steering."""
        return float(correlations(self.cameras[:1], self.steering)[0])

    @cached_property
    def recovery(self) -> float | None:
        """Return the recovery response, -1..1; None without side images."""
        return side_response(*self.cameras[1:]) if len(self.cameras) > 1 else None

    @cached_property
    def agreement(self) -> float:
        """Return the agreement with the steering that each image calls for, see `concordance`.

        It is the recorded steering for the centre, and more or less for the side cameras, see
        `SIDE_OFFSETS`. So the agreement has the correlation and the recovery response in it.
        """
        return concordance(self.outputs, self.wanted)

    @cached_property
    def score(self) -> float:
        """Return what ranks the trial: mostly the correlation, of all cameras, without its sign.

        A wrong colour or scale amplifies the output, and the agreement of a weak network rises with
        it. The agreement of outputs that mean something else, such as degrees, tells nothing.
        """
        correlation = float(correlations(self.outputs[None], self.wanted)[0])
        if not correlation:
            return 0.0
        return abs(correlation) * abs(self.agreement / correlation) ** SPREAD_WEIGHT

    @cached_property
    def line(self) -> tuple[float, float]:
        """Return factor and offset of the straight line from the output to the recorded steering.

        It is that of the least squares, centre camera.
        """
        output = self.cameras[0]
        variance = output.var()
        factor = np.mean((output - output.mean()) * self.steering) / variance if variance else 0.0
        return float(factor), float(self.steering.mean() - factor * output.mean())

    @property
    def means_steering(self) -> bool:
        """Return whether the output's sign, mean and spread are like those of the steering."""
        agreement = concordance(self.cameras[0], self.steering)
        return self.correlation > 0 and agreement >= LEAST_LIKENESS * self.correlation

    @property
    def wanted(self) -> np.ndarray:
        """Return the steering that each image of `outputs` calls for, float64."""
        return np.add.outer(SIDE_OFFSETS[: len(self.cameras)], self.steering).ravel()

    @property
    def outputs(self) -> np.ndarray:
        """Return the outputs for all cameras, one after the other, float64."""
        return self.cameras.ravel()

    def rows(self, rows: np.ndarray) -> "Trial":
        """Return the trial of some rows only, such as a bootstrap's."""
        cameras, steering = self.cameras[:, rows], self.steering[rows]
        return Trial(self.combination, cameras, steering)


@dataclass(frozen=True)
class Trials:
    """The trials of a search.

    Attributes:
        finalists: trials on all frames of all cameras, the highest score first.
        coarse: trials of the second stage, on some frames of the centre camera.
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
        value = 2 * covariance / spread
    return float(value) if np.isfinite(value) else 0.0


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


def planned_images(facts: KnownInput, frames: TrialFrames) -> int:
    """Return the number of images that the stages take at most, but for further neighbours."""
    possible = combinations(facts)
    some, cameras = len(_some(frames).steering), len(frames.cameras)
    views = {choice.view for choice in possible}
    fine = FINALISTS + len({view.colour for view in views}) + USUAL_NEIGHBOURS + len(RESIZES)
    coarse = len(_coarse(possible, facts)) // COARSE_STEP + _kept(len(views))
    again = 0 if some == len(frames.steering) else (MOST_TIED + 3) * len(frames.steering) * cameras
    return some * (coarse + fine * cameras) + again


def try_inputs(
    network: Network,
    facts: KnownInput,
    frames: TrialFrames,
    did: Callable[[int], None],
    show_best: Callable[[Trial], None],
) -> Trials:
    """Try the combinations that fit what is known, and return the trials.

    Args:
        network: function of a view and a scale that returns the network for them, in evaluation
            mode, on the CPU.
        facts: facts about the input.
        frames: frames to try on.
        did: function called with the number of images that a network has seen.
        show_best: function called with the best trial of each stage.

    Raises:
        InputError: no combination fits.
    """
    some = _some(frames)

    def stage(chosen: Sequence[Combination], frames: TrialFrames) -> list[Trial]:
        """Return the trials, the best first."""
        trials = try_all(network, chosen, frames, did)
        for best in trials[:1]:
            show_best(best)
        return trials

    possible = combinations(facts)
    best: dict[View, Combination] = {}  # the best scale of each view
    for trial in stage(_coarse(possible, facts), some.every(COARSE_STEP).center_only()):
        best.setdefault(trial.combination.view, trial.combination)
    coarse = stage(list(best.values())[: _kept(len(best))], some.center_only())
    finalists = stage(_finalists(coarse), some)
    while near := _neighbours(finalists, possible):
        finalists += stage(near, some)
    chosen = max(finalists, key=_score).combination
    last = dict.fromkeys([*with_each_resize(chosen, facts)[1:], *popular_combinations(facts)])
    finalists += stage(list(last), some)
    return Trials(tuple(sorted(finalists, key=_score, reverse=True)), tuple(coarse))


def _some(frames: TrialFrames) -> TrialFrames:
    return frames.every(max(1, len(frames.steering) // COARSE_ROWS))


def _coarse(possible: Sequence[Combination], facts: KnownInput) -> list[Combination]:
    return [choice for choice in possible if facts.scale or choice.scale in COARSE_SCALES]


def _kept(views: int) -> int:
    return max(FINALISTS, views // 3)


def _neighbours(finalists: list[Trial], possible: list[Combination]) -> list[Combination]:
    """Return the combinations near the best finalist that are not tried yet."""
    best = max(finalists, key=_score).combination
    tried = {finalist.combination for finalist in finalists}

    def is_near(other: Combination) -> bool:
        apart = np.abs(np.subtract(other.view.crop, best.view.crop)).max()
        same_scale = other.scale == best.scale
        return other.view.colour == best.view.colour and apart <= (NEAR_ROWS if same_scale else 0)

    return [other for other in possible if other not in tried and is_near(other)]


def try_all(
    network: Network,
    chosen: Sequence[Combination],
    frames: TrialFrames,
    did: Callable[[int], None],
) -> list[Trial]:
    """Return the trial of each combination, the best first; each core tries another one.

    This is faster than to share each batch among the cores, most of all on a busy machine.
    """

    @torch.inference_mode()
    def try_one(choice: Combination) -> Trial:
        module = network(choice.view, choice.scale)
        outputs = [_steering(module, choice.view, camera, did) for camera in frames.cameras]
        return Trial(choice, np.stack(outputs), frames.steering)

    threads = min(torch.get_num_threads(), usable_cores())
    with one_thread(), ThreadPoolExecutor(threads) as pool:
        return sorted(pool.map(try_one, chosen), key=_score, reverse=True)


def _steering(
    module: nn.Module, view: View, frames: np.ndarray, did: Callable[[int], None]
) -> np.ndarray:
    """Return the network's steering for frames uint8 [N, H, W, 3] RGB, float64 [N]."""
    steering = []
    for start in range(0, len(frames), BATCH):
        images = np.stack([view(frame) for frame in frames[start : start + BATCH]])
        steering.append(module(torch.from_numpy(images).permute(0, 3, 1, 2))[:, 0].numpy())
        did(len(images))
    return np.concatenate(steering).astype(np.float64)


def _finalists(coarse: Sequence[Trial]) -> list[Combination]:
    """Return the best combinations, and each colour's best that is not hopeless.

    Args:
        coarse: trials of the first stage, the best first.
    """
    near = [trial for trial in coarse if trial.score >= HOPELESS * coarse[0].score]
    colours = {trial.combination.view.colour: trial for trial in reversed(near)}
    best = [*coarse[:FINALISTS], *colours.values()]
    return list(dict.fromkeys(trial.combination for trial in best))
