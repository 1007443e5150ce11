"""One progress bar for the whole training, and a line per epoch."""

import time
from typing import Any

from lightning import Callback, LightningModule, Trainer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from zoo.base.terminal import is_quiet


class TrainingProgress(Callback):
    """A callback that shows epoch, samples per second, training loss and validation MSE.

    A step costs one reading of the clock: another thread draws the bar.

    Args:
        refresh_s: seconds between two updates of the bar.
    """

    validated = -1  # epoch of the newest validation

    def __init__(self, refresh_s: float = 0.2) -> None:
        self.refresh_s = refresh_s
        self.progress: Progress | None = None
        self.next_refresh = 0.0

    def on_train_start(self, trainer: Trainer, module: LightningModule) -> None:
        """Show the bar on a terminal."""
        self.console = Console(soft_wrap=True)
        self.started, self.done = time.perf_counter(), 0
        self.steps = int(trainer.num_training_batches)
        if trainer.is_global_zero and self.console.is_terminal and not is_quiet():
            self.progress = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.fields[figures]}"),
                TimeRemainingColumn(),
                console=self.console,
                transient=True,
            )
            total = (trainer.max_epochs or 0) * self.steps or None
            self.task = self.progress.add_task("training", total=total, figures="")
            self.progress.start()

    def on_train_batch_end(
        self,
        trainer: Trainer,
        module: LightningModule,
        outputs: object,
        batch: dict | list[dict],
        number: int,
    ) -> None:
        """Count the samples and update the bar."""
        group = batch if isinstance(batch, list) else [batch]
        self.done += sum(len(part["images"]) for part in group) * trainer.world_size
        now = time.perf_counter()
        if self.progress is None or now < self.next_refresh:
            return
        self.next_refresh = now + self.refresh_s
        self.progress.update(
            self.task,
            completed=trainer.current_epoch * self.steps + number + 1,
            description=f"epoch {trainer.current_epoch + 1}/{trainer.max_epochs}",
            figures=f"{self.done / (now - self.started):,.0f} samples/s",
        )

    def on_validation_end(self, trainer: Trainer, module: LightningModule) -> None:
        """Note the epoch: Lightning keeps the figures until the next validation."""
        self.validated = trainer.current_epoch

    def on_train_epoch_end(self, trainer: Trainer, module: Any) -> None:
        """Print the epoch's line."""
        if not trainer.is_global_zero or is_quiet():
            return
        metrics = trainer.callback_metrics
        line = f"epoch {trainer.current_epoch + 1:>3}/{trainer.max_epochs}"
        line += f"  train/loss {float(module.mean_loss()):.4f}"
        for name in ("val/mse", "val/mae"):
            if name in metrics and self.validated == trainer.current_epoch:
                line += f"  {name} {float(metrics[name]):.4f}"
        if module.train_seconds:
            line += f"  {module.train_samples / module.train_seconds:,.0f} samples/s"
        self.console.print(line, highlight=False)

    def teardown(self, trainer: Trainer, module: LightningModule, stage: str) -> None:
        """Remove the bar."""
        if self.progress is not None:
            self.progress.stop()
            self.progress = None
