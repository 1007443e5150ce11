"""Drives the weights while they learn: how far off the road is the figure that counts."""

import copy
import time
from pathlib import Path

import lightning
import numpy as np
import torch
from rich.console import Console
from torch import nn

from datamodules.errors import InputError
from datamodules.view import View

MONITORED = "drive/"
DRIVEN = "driven.ckpt"


class ClosedLoop(lightning.Callback):
    """Drives in the embedded world after an epoch, and logs what it came to.

    Logs `drive/autonomy` (0..1), `drive/interventions`, `drive/cte_mean` and `drive/cte_max`
    (metres), and `drive/score` (see `zoo.drives.driving_score`), which checkpoints and early
    stopping can monitor. They keep their last value through epochs that are not driven.

    The weights with the highest `drive/score` are kept as `checkpoints/driven.ckpt`: a candidate
    for `best.ckpt` at the end of the run.

    Drives a copy of the network on the CPU: training goes on as if nothing had been. Under several
    processes the first one drives, the others wait for its figures.

    Args:
        track: a name or a file.
        every_n_epochs: the first is driven in any case, then every so many.
        starts: so many drives from places evenly spaced along the lap, on the centre.
        metres: driven from each.
        speed: miles per hour to hold.
        share: of the training's own time, which all driving but the first and the best
            checkpoint's stays below by skipping epochs; null drives whatever it takes. What is
            skipped depends on the machine's speed; with null, runs repeat.
        quality: full, or simple pictures, which are a little quicker.
    """

    def __init__(
        self,
        track: str = "lake",
        every_n_epochs: int = 1,
        starts: int = 4,
        metres: float = 150.0,
        speed: float = 20.0,
        share: float | None = 0.2,
        quality: str = "full",
    ) -> None:
        for name, value, least in (
            ("every_n_epochs", every_n_epochs, 1),
            ("starts", starts, 1),
            ("metres", metres, 1),
            ("speed", speed, 1),
            ("share", share or 0.0, 0.0),
        ):
            if not value >= least:
                raise InputError(f"callbacks.closed_loop.{name}={value}: must be {least} or more")
        self.track, self.every_n_epochs, self.starts = track, every_n_epochs, starts
        self.metres, self.speed, self.share, self.quality = metres, speed, share, quality
        self.world = None
        self.drives, self.spent_s, self.last_s = 0, 0.0, 0.0
        self.best_score = float("-inf")
        self.cost: dict[str, float] | None = None  # of all drives in training, once it is over

    def on_fit_start(self, trainer: lightning.Trainer, module: lightning.LightningModule) -> None:
        said = self._open() if trainer.is_global_zero else None
        said = trainer.strategy.broadcast(said)
        if said is None:
            return
        for callback in trainer.callbacks:
            monitor = getattr(callback, "monitor", None) or ""
            if monitor.startswith(MONITORED):
                raise InputError(f"{type(callback).__name__} monitors {monitor}, but {said}")
        if trainer.is_global_zero:
            line = f"closed loop: not driven: {said}"
            Console(soft_wrap=True).print(line, highlight=False, markup=False)

    def on_train_start(self, trainer: lightning.Trainer, module: lightning.LightningModule) -> None:
        self.started = time.perf_counter()

    def on_train_epoch_end(
        self, trainer: lightning.Trainer, module: lightning.LightningModule
    ) -> None:
        figures = None
        if trainer.is_global_zero and self.world is not None and self._due(trainer.current_epoch):
            figures = self.drive(module.network, trainer.datamodule.view)
            Console(soft_wrap=True).print(
                f"           drove {self.starts} x {self.metres:g} m: autonomy "
                f"{figures['autonomy']:.1%}, {figures['interventions']} interventions, mean error "
                f"{figures['cte_mean']:.2f} m ({self.last_s:.1f} s)",
                highlight=False,
            )
        figures = trainer.strategy.broadcast(figures)
        if figures is not None:
            logged = {f"{MONITORED}{key}": float(value) for key, value in figures.items()}
            module.log_dict(logged, on_step=False, on_epoch=True, sync_dist=True)
            if figures["score"] > self.best_score:
                self.best_score = figures["score"]
                trainer.save_checkpoint(Path(trainer.default_root_dir) / "checkpoints" / DRIVEN)

    def state_dict(self) -> dict:
        return {"best_score": self.best_score}

    def load_state_dict(self, state: dict) -> None:
        self.best_score = state.get("best_score", float("-inf"))

    def on_train_end(self, trainer: lightning.Trainer, module: lightning.LightningModule) -> None:
        trained_s = self._trained_s()
        if self.drives and trained_s > 0:
            self.cost = {
                "drives": self.drives,
                "seconds": self.spent_s,
                "share": self.spent_s / trained_s,
            }
            count = f"{self.drives} drive{'' if self.drives == 1 else 's'}"
            Console(soft_wrap=True).print(
                f"closed loop: {count} took {self.spent_s:.1f} s, {self.cost['share']:.0%} of the "
                f"{trained_s:.1f} s of training",
                highlight=False,
            )

    def drive(self, network: nn.Module, view: View) -> dict[str, float]:
        """What a copy of the network comes to; the same for the same weights."""
        from simulator.world import Start
        from zoo.checkpoints.checkpoint import Checkpoint
        from zoo.checkpoints.policy import Policy
        from zoo.drives.driving_score import driving_score
        from zoo.drives.tally import autonomy
        from zoo.evaluate.embedded_drive import drive_closed_loop
        from zoo.evaluate.many_drives import speed_controller

        began, threads = time.perf_counter(), torch.get_num_threads()
        torch.set_num_threads(1)  # a single picture is too little for two
        try:
            policy = Policy(Checkpoint(copy.deepcopy(network).cpu().eval(), view, {}, {}))
            length = self.world.track.length
            drives = [
                drive_closed_loop(
                    policy,
                    self.world,
                    speed_controller(self.speed),
                    seed=0,
                    laps=self.metres / length,
                    start=Start(number * length / self.starts, speed_mph=self.speed),
                )
                for number in range(self.starts)
            ]
        finally:
            torch.set_num_threads(threads)
        error = np.abs(np.concatenate([one.cross_track_m for one in drives]))
        interventions = sum(int(one.intervention.sum()) for one in drives)
        driven_s = sum(float(one.time_s[-1]) for one in drives)
        self.last_s = time.perf_counter() - began
        self.spent_s += self.last_s
        self.drives += 1
        return {
            "autonomy": autonomy(interventions, driven_s),
            "interventions": interventions,
            "cte_mean": float(error.mean()),
            "cte_max": float(error.max()),
            "score": driving_score(interventions, driven_s, float(error.mean())),
        }

    def _trained_s(self) -> float:
        """Seconds of training so far, validation and all else but driving included."""
        return time.perf_counter() - self.started - self.spent_s

    def _due(self, epoch: int) -> bool:
        if not self.drives:
            return True
        if epoch % self.every_n_epochs:
            return False
        return self.share is None or self.spent_s + self.last_s <= self.share * self._trained_s()

    def _open(self) -> str | None:
        """Open the world; what hinders that, in a line."""
        from simulator.errors import SimulatorError
        from simulator.world import open_world

        try:
            self.world = open_world(self.track, "auto", self.quality)
        except SimulatorError as error:
            return str(error)
        return None


def best_drive(
    trainer: lightning.Trainer, module: lightning.LightningModule, view: View
) -> dict | None:
    """For `metrics.json`: how the weights in `module` drive, where `ClosedLoop` is among the
    callbacks and could drive; and what its drives have cost."""
    for callback in trainer.callbacks:
        if isinstance(callback, ClosedLoop) and callback.world is not None:
            figures = callback.drive(module.network, view)
            callback.world.pictures.close()  # a sweep's next job opens its own
            callback.world = None
            return {
                "track": callback.track,
                "speed_mph": callback.speed,
                "metres": callback.starts * callback.metres,
                **figures,
                "in_training": callback.cost,
            }
    return None
