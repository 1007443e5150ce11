"""Drives whose frames are scored, and which an expert may take over after an alarm.

A condition changes the drives at a level at which 20 to 80 % of them fail, found on the fit roads.
A drive ends at its first failure.
"""

from collections import deque
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor, nn

from benchmarks.study_grid import Entry, Study
from zoo.checkpoints.checkpoint_path import find_driver
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.checkpoints.frozen_graph import network_inputs
from zoo.checkpoints.policy_base import Command, Policy, PolicyWrapper
from zoo.driving.baseline import Baseline
from zoo.driving.drive_record import Drive, DriveRow
from zoo.driving.run_drives import Keep, PolicyMaker, run_drives
from zoo.driving.scenario import Scenario
from zoo.driving.world import World
from zoo.simulator.udacity_car import CameraOffset
from zoo.simulator.weather import CLEAR

CONDITIONS: dict[str, Callable[[float], dict[str, Any]]] = {
    "clear": lambda level: {},
    "dark": lambda level: {"weather": replace(CLEAR, brightness=0.06**level, sun=1 - 0.7 * level)},
    "camera": lambda level: {"weather": replace(CLEAR, camera=CameraOffset(yaw_deg=20 * level))},
    "delay": lambda level: {"delay_s": 1.5 * level},
}
# Columns of a frame; the activations before the network's last layer follow them.
COLUMNS = "brightness", "autoencoder", "ensemble", "dropout", "steering", "random", "expert"
EXPERT = 6
FRAME_RATE, WINDOW = 5.0, 5  # a score is its mean over a window of 1 s
BEFORE_S, CLEAR_S = (1.0, 3.0), 6.0  # frames that a failure follows, and that none does
REACTION_S, TAKEOVER_S = 1.0, 2.0
SAMPLES, IMAGE = 8, (80, 40)  # passes of dropout; width and height of the autoencoder's images
SEARCHES, WANTED = 5, (0.2, 0.8)  # levels tried, and the share of fit roads that should fail

Score = Callable[[np.ndarray], np.ndarray]  # function of rows of columns, [N, C], to [N]


def autoencoder() -> nn.Sequential:
    """Return the autoencoder of images that SelfOracle compares with, Stocco et al. 2020."""
    width, height = (side // 8 for side in IMAGE)
    sizes = [(3, 16), (16, 32), (32, 32)]
    layers: list[nn.Module] = []
    for before, after in sizes:
        layers += [nn.Conv2d(before, after, 3, 2, 1), nn.ReLU()]
    layers += [nn.Flatten(), nn.Linear(32 * height * width, 32)]
    layers += [nn.Linear(32, 32 * height * width), nn.ReLU(), nn.Unflatten(1, (32, height, width))]
    for before, after in sizes[::-1]:
        layers += [nn.ConvTranspose2d(after, before, 4, 2, 1), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


def errors(network: nn.Module, images: np.ndarray) -> Tensor:
    """Return the mean squared error of each image, float [N], from uint8 [N, 40, 80, 3]."""
    wanted = torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255
    return (network(wanted) - wanted).square().mean((1, 2, 3))


def small(frame: np.ndarray) -> np.ndarray:
    """Return a frame at the size of the autoencoder's images."""
    return cv2.resize(frame, IMAGE, interpolation=cv2.INTER_AREA)


class SmallFrames(Keep):
    """The frames of a drive at the size of the autoencoder's images, uint8 [N, 40, 80, 3]."""

    def begin(self, world: World) -> None:
        """Forget the drive before."""
        self.frames: list[np.ndarray] = []

    def show(self, frame: np.ndarray, row: DriveRow) -> None:
        """Keep the frame."""
        self.frames.append(small(frame))

    def result(self, drive: Drive, policy: Policy, world: World) -> np.ndarray:
        """Return the frames."""
        return np.array(self.frames)


def nominal(study: Study) -> dict[str, object]:
    """Return an autoencoder of an expert's frames, and their mean brightness."""
    path, network = Path(study.config["runs"], "autoencoder.pt"), autoencoder()
    if not path.is_file():
        roads = study.config["roads"]["nominal"]
        scenarios = [Scenario(road, frame_rate=FRAME_RATE) for road in roads]
        drives = run_drives(Baseline("expert"), scenarios, SmallFrames())
        seen = np.concatenate([frames for _, frames in drives])
        torch.manual_seed(0)
        network = autoencoder()
        optimizer = torch.optim.Adam(network.parameters(), 1e-3)
        for _ in range(25):
            for rows in torch.randperm(len(seen)).split(64):
                optimizer.zero_grad()
                errors(network, seen[rows.numpy()]).mean().backward()
                optimizer.step()
        path.parent.mkdir(parents=True, exist_ok=True)
        torch.save({"weights": network.state_dict(), "mean": float(seen.mean()) / 255}, path)
    found = torch.load(path, weights_only=True)
    network.load_state_dict(found["weights"])
    return {"autoencoder": network.eval(), "brightness": found["mean"]}


@dataclass(frozen=True)
class Alarm:
    """A score and its threshold, above which an expert takes over."""

    score: Score
    threshold: float


class Observer(PolicyWrapper):
    """Policy that keeps the columns of its frames, and that an expert may take over.

    Args:
        policy: policy that drives.
        others: policies of the ensemble.
        images: autoencoder.
        expert: what takes over, and its alarm; None for neither.
    """

    def __init__(
        self,
        policy: Policy,
        others: Sequence[Policy],
        images: nn.Module,
        expert: tuple[Policy, Alarm] | None,
    ) -> None:
        super().__init__(policy)
        self._others, self._images, self._expert = others, images, expert
        self._network, self._rng = deepcopy(policy.network), np.random.default_rng(0)
        last = [one for one in self._network.modules() if isinstance(one, nn.Linear)][-1]
        last.register_forward_pre_hook(lambda _, given: setattr(self, "_activations", given[0]))
        layers = [one for one in self._network.modules() if isinstance(one, nn.Dropout)]
        self._dropout = [one for one in layers if one.p]
        self.rows: list[np.ndarray] = []
        self._scores: deque[float] = deque(maxlen=WINDOW)
        self._alarms: deque[bool] = deque(maxlen=round((REACTION_S + TAKEOVER_S) * FRAME_RATE))

    @torch.inference_mode()
    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the policy's command, or the expert's while it drives."""
        command = self.policy(frame, speed_mph)
        inputs, spread = network_inputs(self.policy.view(frame), None), np.nan
        for one in self._dropout:
            one.train()
        if self._dropout:
            torch.manual_seed(0)  # the same masks for each frame
            spread = float(self._network(inputs[0].repeat(SAMPLES, 1, 1, 1))[:, 0].std())
        self._network.eval()(*inputs)
        if len(self.rows) % round(TAKEOVER_S * FRAME_RATE) == 0:
            self._drawn = self._rng.random()
        steering = [command.steering, *(one(frame, speed_mph).steering for one in self._others)]
        error = float(errors(self._images, small(frame)[None]))
        row = [frame.mean() / 255, error, np.std(steering), spread, command.steering, self._drawn]
        self.rows.append(np.array([*row, 0.0, *self._activations[0].tolist()], np.float32))
        if self._expert is None:
            return command
        expert, alarm = self._expert
        wheel = expert(frame, speed_mph)  # always, for it has a state
        self._scores.append(float(alarm.score(self.rows[-1][None])[0]))
        whole = len(self._scores) == WINDOW
        self._alarms.append(whole and float(np.mean(self._scores)) >= alarm.threshold)
        if not any(list(self._alarms)[: -round(REACTION_S * FRAME_RATE)]):
            return command
        self.rows[-1][EXPERT] = 1.0
        return wheel


@dataclass(frozen=True)
class Observed(PolicyMaker):
    """What makes the observer of a network that comes trained, with an alarm or without."""

    names: Sequence[str]
    images: nn.Module
    alarm: Alarm | None

    def policy(self, world: World, scenario: Scenario) -> Observer:
        """Return the observer."""
        own, *others = (load_policy(find_driver(one)).in_car(world.rig) for one in self.names)
        expert = self.alarm and (Baseline("expert").policy(world, scenario), self.alarm)
        return Observer(own, others, self.images, expert)


@dataclass(frozen=True)
class Frames:
    """A drive: columns of its frames, float32 [N, C], whether it failed at the end, and metres."""

    rows: np.ndarray
    failed: bool
    metres: float

    @property
    def left_s(self) -> np.ndarray:
        """Return the seconds until the failure, infinite without one, float [N]."""
        seconds = np.arange(len(self.rows))[::-1] / FRAME_RATE
        return seconds if self.failed else np.full(len(self.rows), np.inf)

    @property
    def labels(self) -> np.ndarray:
        """Return 1 shortly before the failure, 0 where none follows, else NaN, float [N]."""
        left_s = self.left_s
        labels = np.where(left_s > CLEAR_S, 0.0, np.nan)
        labels[(left_s >= BEFORE_S[0]) & (left_s <= BEFORE_S[1])] = 1.0
        labels[: WINDOW - 1] = np.nan  # no whole window
        return labels

    def windows(self, score: Score) -> np.ndarray:
        """Return the mean score of the window that ends at each frame, float [N]."""
        sums = np.cumsum(np.concatenate([np.zeros(WINDOW), score(self.rows)]))
        return (sums[WINDOW:] - sums[:-WINDOW]) / WINDOW


class KeptFrames(Keep):
    """The columns of a drive's frames."""

    def result(self, drive: Drive, policy: Policy, world: World) -> Frames:
        """Return the frames."""
        return Frames(np.array(policy.rows), bool(drive.intervention.any()), drive.driven_m)


def driven(
    study: Study, entry: Entry, place: str, level: float, part: str, alarm: Alarm | None = None
) -> list[Frames]:
    """Return the drives of a part of the roads, which are kept in a folder; drive missing ones."""
    folder, roads = entry.folder / f"{place.replace(' ', '_')}", study.config["roads"][part]
    paths = [folder / f"{level:.3f}-{road.replace(':', '-')}.npz" for road in roads]
    missing = [number for number, path in enumerate(paths) if not path.is_file()]
    names = list(dict.fromkeys([entry.name, *study.options.ensemble.split(",")]))
    maker = Observed(names, study.values["autoencoder"], alarm)
    settings = {"frame_rate": FRAME_RATE} | CONDITIONS[place.partition("-")[0]](level)
    scenarios = [Scenario(roads[number], seed=1, **settings) for number in missing]
    for number, one in run_drives(maker, scenarios, KeptFrames(), first_only=True):
        folder.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(paths[missing[number]], **vars(one))
        print(f"{paths[missing[number]]}: {len(one.rows)} frames, failed: {one.failed}", flush=True)
    found = map(np.load, paths)
    return [Frames(one["rows"], bool(one["failed"]), float(one["metres"])) for one in found]


def search_level(study: Study, entry: Entry, condition: str) -> dict[str, float]:
    """Return the level, 0 to 1, at which some of the fit roads fail, and their share."""
    low, high = 0.0, 1.0
    for _ in range(SEARCHES):
        level = (low + high) / 2
        drives = driven(study, entry, condition, level, "fit")
        share = float(np.mean([one.failed for one in drives]))
        if WANTED[0] <= share <= WANTED[1]:
            break
        low, high = (level, high) if share < WANTED[0] else (low, level)
    return {"level": level, "failed": share}
