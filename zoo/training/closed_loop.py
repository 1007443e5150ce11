"""Drives in the embedded world during training."""

import copy
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from lightning import Callback, LightningModule, Trainer
from rich.console import Console
from torch import nn

from datamodules.recorded_car import other_car
from datamodules.view import View
from zoo.base.errors import InputError
from zoo.base.terminal import counted
from zoo.driving.scenario import SpeedMph
from zoo.simulator.world_settings import Quality
from zoo.training.run_module import RunModule, callbacks_of, data_of

if TYPE_CHECKING:
    from zoo.driving.embedded_world import EmbeddedWorld

DROVE = "drive/"  # begins the names of the figures
FRAME_IMAGES = 8  # training images that take as long as a driven frame: PilotNet's, on two cores
DRIVEN = "driven.ckpt"
# Attributes that a checkpoint keeps.
KEPT = ("best_score", "figures", "frames", "last_frames", "drives", "spent_s", "passed_s")


class ClosedLoop(Callback):
    """A callback that drives in the embedded world after an epoch, and logs the figures.

    Logs `drive/autonomy` (0..1), `drive/interventions`, `drive/cte_mean` and `drive/cte_max`
    (metres), and `drive/score` (see `zoo.driving.interventions`), which checkpoints and early
    stopping can monitor. In epochs without a drive they keep their last value.

    The weights with the highest `drive/score` are kept as `checkpoints/driven.ckpt`: a candidate
    for `best.ckpt` at the end of the run.

    A copy of the network drives on the CPU: training is not changed. The first rank drives, and the
    other ranks wait for its figures.

    Args:
        track: name or file of a track.
        every_n_epochs: number of epochs from one drive to the next; the first epoch always drives.
        starts: number of drives, from places evenly spaced along the centreline.
        metres: length of each drive.
        speed: speed to hold, mph.
        share: largest share of driving in the training's work, of which a driven frame is as much
            as 8 training images; drives but the first are skipped to keep it, on every machine the
            same. None skips none.
        quality: `full`, `fast` (less detail far away) or `simple` (no shadows).
    """

    def __init__(
        self,
        track: str = "lake",
        every_n_epochs: int = 1,
        starts: int = 4,
        metres: float = 150.0,
        speed: SpeedMph = 20.0,
        share: float | None = 0.2,
        quality: Quality = "full",
    ) -> None:
        for name, value, least in (
            ("every_n_epochs", every_n_epochs, 1),
            ("starts", starts, 1),
            ("metres", metres, 1),
            ("share", share or 0.0, 0.0),
        ):
            if not value >= least:
                raise InputError(f"callbacks.closed_loop.{name}={value}: must be {least} or more")
        self.track, self.every_n_epochs, self.starts = track, every_n_epochs, starts
        self.metres, self.speed, self.share, self.quality = metres, speed, share, quality
        self.world: EmbeddedWorld | None = None
        self.drives, self.spent_s, self.last_s = 0, 0.0, 0.0
        self.passed_s, self.started = 0.0, time.perf_counter()  # before this process; its start
        self.frames = self.last_frames = 0  # driven in all, and in the last drive
        self.figures: dict[str, float] = {}  # logged after the last drive, by name
        self.best_score = float("-inf")
        self.cost: dict[str, float] | None = None  # of all drives in training, set at its end

    def on_fit_start(self, trainer: Trainer, module: LightningModule) -> None:
        """Open the world; report where that fails."""
        source = other_car(data_of(trainer).recording)
        problem = source and f"the {self.track} shows another car than the recording ({source})"
        if trainer.is_global_zero and problem is None:
            try:
                self._open()
            except InputError as error:
                problem = str(error)
        problem = trainer.strategy.broadcast(problem)
        if problem is None:
            return
        for callback in callbacks_of(trainer):
            monitor = getattr(callback, "monitor", None) or ""
            if monitor.startswith(DROVE):
                raise InputError(f"{type(callback).__name__} monitors {monitor}, but {problem}")
        if trainer.is_global_zero:
            line = f"closed loop: not driven: {problem}"
            Console(soft_wrap=True).print(line, highlight=False, markup=False)

    def on_train_start(self, trainer: Trainer, module: LightningModule) -> None:
        """Start the clock; restore the figures of the last drive of a resumed run."""
        self.started = time.perf_counter() - self.passed_s
        # Not logged: the loggers, too, hold figures of drives only.
        trainer.callback_metrics.update(
            {key: torch.tensor(value) for key, value in self.figures.items()}
        )

    def on_train_epoch_end(self, trainer: Trainer, module: Any) -> None:
        """Drive if it is due; log the figures and keep the best weights."""
        figures = None
        data = data_of(trainer)
        images = data.epoch_samples() * (trainer.current_epoch + 1)
        is_due = self._due(trainer.current_epoch, images)
        if trainer.is_global_zero and self.world is not None and is_due:
            figures = self.drive(module.network, data.view, module.card)
            Console(soft_wrap=True).print(
                f"           drove {self.starts} x {self.metres:g} m: autonomy "
                f"{figures['autonomy']:.1%}, "
                f"{counted(figures['interventions'], 'intervention')}, mean error "
                f"{figures['cte_mean']:.2f} m ({self.last_s:.1f} s)",
                highlight=False,
            )
        figures = trainer.strategy.broadcast(figures)
        if figures is not None:
            self.figures = {f"{DROVE}{key}": float(value) for key, value in figures.items()}
            module.log_dict(self.figures, on_step=False, on_epoch=True, sync_dist=True)
            if figures["score"] > self.best_score:
                self.best_score = figures["score"]
                trainer.save_checkpoint(Path(trainer.default_root_dir) / "checkpoints" / DRIVEN)

    def state_dict(self) -> dict:
        """Return the best score, the last figures, and the drives' work, for checkpoints."""
        self.passed_s = time.perf_counter() - self.started
        return {name: getattr(self, name) for name in KEPT}

    def load_state_dict(self, state: dict) -> None:
        """Restore them; checkpoints of before do not hold all."""
        vars(self).update({name: state[name] for name in KEPT if name in state})

    def on_train_end(self, trainer: Trainer, module: LightningModule) -> None:
        """Print the time of the drives."""
        trained_s = time.perf_counter() - self.started - self.spent_s
        if self.drives and trained_s > 0:
            self.cost = {
                "drives": self.drives,
                "seconds": self.spent_s,
                "share": self.spent_s / trained_s,
            }
            Console(soft_wrap=True).print(
                f"closed loop: {counted(self.drives, 'drive')} took {self.spent_s:.1f} s, "
                f"{self.cost['share']:.0%} of the {trained_s:.1f} s of training",
                highlight=False,
            )

    def drive(self, network: nn.Module, view: View, card: Mapping) -> dict[str, float]:
        """Drive a copy of the network; return its figures, equal for equal weights."""
        from zoo.checkpoints.checkpoint import Checkpoint
        from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
        from zoo.driving.interventions import driving_score
        from zoo.driving.run_drives import all_drives
        from zoo.driving.tally import autonomy

        began = time.perf_counter()
        copied, data = copy.deepcopy(network).cpu().float().eval(), card.get("data", {})
        policy = CheckpointPolicy(Checkpoint(copied, view, {}, data))
        world = self.world or self._open()
        track = world.simulated.track
        # On an open road the last start leaves room for a whole drive.
        spread = track.length if track.closed else max(track.length - self.metres, 0.0)
        scenario = replace(self.scenario, laps=self.metres / track.length)
        scenarios = [
            replace(scenario, start=number * spread / self.starts) for number in range(self.starts)
        ]
        drives = all_drives(policy, scenarios, world=world)
        error = np.abs(np.concatenate([drive.cross_track_m for drive in drives]))
        interventions = sum(int(drive.intervention.sum()) for drive in drives)
        driven_s = sum(float(drive.time_s[-1]) for drive in drives)
        self.last_s = time.perf_counter() - began
        self.spent_s += self.last_s
        self.drives += 1
        self.last_frames = len(error)
        self.frames += self.last_frames
        return {
            "autonomy": autonomy(interventions, driven_s),
            "interventions": interventions,
            "cte_mean": float(error.mean()),
            "cte_max": float(error.max()),
            "score": driving_score(interventions, driven_s, float(error.mean())),
        }

    def _due(self, epoch: int, images: int) -> bool:
        """Return whether to drive after an epoch, with so many images trained by its end."""
        if not self.figures:  # none is monitored yet, or an earlier version's checkpoint had none
            return True
        if epoch % self.every_n_epochs:
            return False
        work = FRAME_IMAGES * (self.frames + self.last_frames)
        return self.share is None or work <= self.share * images

    def _open(self) -> "EmbeddedWorld":
        from zoo.driving.embedded_world import open_embedded
        from zoo.driving.scenario import Scenario

        self.scenario = Scenario(self.track, speed=self.speed, quality=self.quality)
        self.world = open_embedded(self.scenario)
        return self.world


def best_drive(trainer: Trainer, module: RunModule, view: View) -> dict | None:
    """Drive the weights in `module` with the run's `ClosedLoop`.

    Return `closed_loop` of `metrics.json`; None without that callback, or where it could not drive.
    """
    from zoo.simulator.track_names import recorded_name

    for callback in callbacks_of(trainer):
        if isinstance(callback, ClosedLoop) and callback.world is not None:
            figures = callback.drive(module.network, view, module.card)
            callback.world.close()  # a sweep's next job opens another world
            callback.world = None
            return {
                "track": recorded_name(callback.track),
                "speed_mph": callback.speed,
                "metres": callback.starts * callback.metres,
                **figures,
                "in_training": callback.cost,
            }
    return None
