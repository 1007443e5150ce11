"""The one LightningModule that trains every network of the zoo."""

import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor, nn

from datamodules.batches import Batch
from zoo.base.errors import InputError
from zoo.models.layers import piece_length
from zoo.models.memory import Memory
from zoo.training.batch_outputs import predictor, true_outputs
from zoo.training.batch_step import BatchLoss, BatchStep, as_group
from zoo.training.open_loop import open_loop_metrics
from zoo.training.optimizer_groups import optimizer_groups
from zoo.training.precision import clip_gradients
from zoo.training.rank_step import RankStep, all_rows
from zoo.training.run_module import RunModule

if TYPE_CHECKING:
    from lightning.pytorch.core.optimizer import LightningOptimizer
    from lightning.pytorch.utilities.types import LRSchedulerConfigType, OptimizerLRScheduler

OWN = "zoo.training.steering_module.SteeringModule"
NEVER = sys.maxsize  # frequency of a schedule that Lightning does not step
CHECK_EVERY = 20  # steps between checks of the loss: each check waits for the device


class SteeringModule(RunModule):
    """A LightningModule that trains a network of the zoo on batches of `DrivingData`.

    A subclass in a user's part, chosen with `module=NAME`, replaces `make_optimizer`,
    `make_schedule` or `targets_of`, or any method of Lightning's. Each of its batches is a step of
    Lightning's, and is not compiled.

    Args:
        network: network from uint8 images (and speed) to steering (and throttle).
        loss: loss of predicted and true outputs, float32 [N, outputs] each.
        optimizer: function from parameter groups to a torch optimizer.
        schedule: function from an optimizer to a torch scheduler, stepped each epoch.
        l2: factor of the sum of squared weights (not biases) in the loss, as Keras' `l2(...)`.
        backbone_lr: learning rate of the network's backbone, if it has one.
        seed: random seed of dropout in each epoch: a resumed run repeats an uninterrupted one.
        card: plain containers that every checkpoint holds (see `zoo.checkpoints.checkpoint`).
        skips_front: whether batches hold features of the frozen layers in place of images.
        compile_loss: function that compiles the loss of a batch; None without compilation.
        make_step: constructor of what a step does, see `zoo.training.batch_step`; several
            processes always have `RankStep`.

    Logs `train/loss` (mean over the epoch, of the loss without l2) and, over the validation rows,
    `val/mse`, `val/mae`, `val/balanced_mae`, `val/bias` (see `zoo.training.open_loop`).
    """

    def __init__(
        self,
        network: nn.Module,
        loss: nn.Module,
        optimizer: Callable[[list[dict]], torch.optim.Optimizer],
        schedule: Callable | None = None,
        l2: float = 0.0,
        backbone_lr: float | None = None,
        seed: int = 1,
        card: dict | None = None,
        skips_front: bool = False,
        compile_loss: Callable[[BatchLoss], BatchLoss] | None = None,
        make_step: Callable[["SteeringModule", BatchLoss], BatchStep] = BatchStep,
    ) -> None:
        super().__init__(network, card)
        self.loss = loss
        self.optimizer, self.schedule = optimizer, schedule
        self.l2, self.backbone_lr, self.seed = l2, backbone_lr, seed
        self.skips_front, self._make_step = skips_front, make_step
        self._predict, self._true = predictor(network, skips_front), true_outputs(network)
        self._loss = compile_loss(self._plain_loss()) if compile_loss else self._plain_loss()
        self._step = BatchStep(self, self._loss)
        self._samples_before = 0

    def forward(self, batch: Batch) -> Tensor:
        """Return the outputs, float32 [N, outputs], steering first; of a window's newest frame."""
        # A training's normalization and dropout need the whole batch.
        size = len(batch["images"]) or 1 if self.training else piece_length(batch["images"])
        pieces = [
            dict(zip(batch, tensors, strict=True))
            for tensors in zip(*(tensor.split(size) for tensor in batch.values()), strict=True)
        ]
        predicted = torch.cat([self._predict(piece) for piece in pieces])
        return self.network.newest(predicted) if isinstance(self.network, Memory) else predicted

    def _plain_loss(self) -> BatchLoss:
        """Return a function from a batch to its loss, without `self`, to compile."""
        predict, loss, has_memory = self._predict, self.loss, isinstance(self.network, Memory)
        targets_of = self._true if type(self) is SteeringModule else self.targets_of

        def batch_loss(batch: Batch) -> Tensor:
            predicted, targets = predict(batch), targets_of(batch)
            rows = predicted.flatten(0, 1) if has_memory else predicted
            if targets.ndim != 2 or targets.shape[1] > rows.shape[1]:  # they would be broadcast
                raise InputError(f"targets_of: {[*targets.shape]} for outputs of {[*rows.shape]}")
            value = loss(rows, targets)
            is_mean = isinstance(value, Tensor) and value.numel() == 1
            if not is_mean or value.requires_grad != torch.is_grad_enabled():
                raise InputError(
                    f"loss: {type(loss).__name__} must return a mean with its gradient"
                )
            return value

        return batch_loss

    def targets_of(self, batch: Batch) -> Tensor:
        """Return the targets of the loss, [rows, columns of the network in training]."""
        return self._true(batch)

    def on_save_checkpoint(self, checkpoint: dict) -> None:
        """Add the card, and what was trained so far, to the checkpoint."""
        super().on_save_checkpoint(checkpoint)
        checkpoint["begun"] = int(self._step.samples), float(self._step.loss_sum)
        checkpoint["trained"] = [self.train_epochs, self._samples_before, self.train_seconds]

    def on_load_checkpoint(self, checkpoint: dict) -> None:
        """Restore what the resumed run had trained; checkpoints of before do not hold it."""
        trained = checkpoint.get("trained", [0, 0, 0.0])
        self.train_epochs, self._samples_before, self.train_seconds = trained
        self._step.samples, self._step.loss_sum = checkpoint.get("begun", (0, 0.0))
        loop = checkpoint["loops"]["fit_loop"]
        epochs, batches = loop["epoch_progress"], loop["epoch_loop.batch_progress"]
        ended = 0 < epochs["current"]["started"] == epochs["current"]["processed"]
        left = checkpoint["global_step"] != self.trainer.max_steps
        # max_steps or max_time ended this epoch early: Lightning would skip the rest of its data.
        # Without a step left it would not count the epoch.
        if ended and not (left and batches["is_last_batch"]):
            for count in (epochs["current"], epochs["total"]):
                count["processed"] = count["completed"] = count["started"] - left
            self.train_epochs -= left
        # A schedule that counts the steps lets Lightning ask for batches before it restores this.
        self.trainer.fit_loop.load_state_dict(loop)

    def on_train_start(self) -> None:
        """Start the clock: an epoch that is resumed inside has no start."""
        self._clock = time.perf_counter()
        make_step = RankStep if self.trainer.world_size > 1 else self._make_step
        begun, self._step = self._step, make_step(self, self._loss)
        self._step.samples, self._step.loss_sum = begun.samples, begun.loss_sum

    def on_train_epoch_start(self) -> None:
        """Start counting samples and loss of the epoch."""
        self._samples_before = self.train_samples
        self._step.start_epoch()
        self._clock = time.perf_counter()

    def on_train_batch_start(self, batch: Batch | list[Batch], number: int) -> None:
        """Seed dropout at the epoch's start; take the steps before Lightning's own."""
        if number == 0:
            # Dropout depends on the epoch alone, so that a resumed run repeats it. Not earlier:
            # creating a loader's iterator draws too, and a resumed run creates it before.
            torch.manual_seed(self.seed * 1_000_003 + self.current_epoch * 1_009 + self.global_rank)
        self._step.step_ahead(as_group(batch))

    def training_step(self, batch: Batch | list[Batch], number: int) -> Tensor | None:
        """Return the loss of Lightning's step; None if it takes none."""
        loss = self._step.loss(as_group(batch))
        if number % CHECK_EVERY == 0:
            self._check_finite()
        return loss

    def optimizer_step(
        self,
        epoch: int,
        batch_idx: int,
        optimizer: "torch.optim.Optimizer | LightningOptimizer",
        optimizer_closure: Callable[[], Any] | None = None,
    ) -> None:
        """Take Lightning's step by the loss of `training_step`, which the closure calls."""
        if self._step.by_lightning:
            super().optimizer_step(epoch, batch_idx, optimizer, optimizer_closure)
        elif optimizer_closure is not None:
            optimizer_closure()

    @property
    def train_samples(self) -> int:  # type: ignore[override]  # counted on the device
        """Return the number of samples that all processes have trained on."""
        return self._samples_before + int(self._step.samples)

    def on_train_batch_end(self, *_: object) -> None:
        """Count the time of the step."""
        if self.trainer.is_last_batch:
            self._step.is_finite()  # waits for the steps that a GPU has not yet taken
        # From the end of a step to the end of the next: validation and plots do not count.
        before, self._clock = self._clock, time.perf_counter()
        self.train_seconds += self._clock - before

    def on_validation_start(self) -> None:
        """Check that the loss and the weights are finite."""
        # Before this epoch is saved: the last checkpoint stays finite.
        if not self.trainer.sanity_checking:
            self._check_finite(weights=True)

    def on_train_epoch_end(self) -> None:
        """Check that all is finite, log the mean loss, and step a schedule by a figure."""
        self._check_finite(weights=True)
        self.train_epochs += 1
        self.log("train/loss", self.mean_loss(), sync_dist=True)
        # Lightning would step after the checkpoint of the epoch: a resumed run would lose the step.
        for config in self.trainer.lr_scheduler_configs:
            figure = self.trainer.callback_metrics.get(config.monitor or "")
            is_late = config.reduce_on_plateau and config.interval == "epoch"
            if is_late and figure is not None and self.trainer.is_last_batch:
                every = config.frequency % NEVER or self.trainer.check_val_every_n_epoch or 1
                config.frequency = NEVER + every
                if (self.current_epoch + 1) % every == 0:
                    self.lr_scheduler_step(config.scheduler, figure)

    def mean_loss(self) -> float:
        """Return the mean loss of the epoch so far, over all processes' samples."""
        return float(self._step.mean_loss())

    def _check_finite(self, weights: bool = False) -> None:
        """Check the loss, and the weights: the last loss was computed before the last step."""
        what = None
        if not self._step.is_finite():
            what = "the loss is"
        elif weights and not all(bool(w.isfinite().all()) for w in self.network.parameters()):
            what = "the weights are"
        if what:
            raise InputError(
                f"{what} not finite in epoch {self.current_epoch + 1}: training stopped, the "
                "checkpoints of the epochs before are kept; lower optim.lr, or set "
                "trainer.gradient_clip_val=1"
            )

    def configure_gradient_clipping(
        self,
        optimizer: torch.optim.Optimizer,
        gradient_clip_val: float | None = None,
        gradient_clip_algorithm: str | None = None,
    ) -> None:
        """Clip the gradients, also in bfloat16 with a fused optimizer."""
        clip_gradients(self, optimizer, gradient_clip_val, gradient_clip_algorithm)

    def on_validation_epoch_start(self) -> None:
        """Start with no predictions."""
        # Numbers, not tensors: small tensors between the batches' activations fragment the heap.
        self._predicted: list[float] = []
        self._actual: list[float] = []

    def validation_step(self, batch: Batch, _: int) -> None:
        """Collect predicted and true steering."""
        if not len(batch["targets"]):  # this rank has no rows
            return
        self._predicted += self(batch)[:, 0].float().tolist()
        self._actual += batch["targets"][:, 0].tolist()

    def on_validation_epoch_end(self) -> None:
        """Log the figures of all validation rows."""
        columns = [np.array(column, np.float32) for column in (self._predicted, self._actual)]
        predicted, true = self.validation = all_rows(self.trainer, columns)
        # Processes on other machines may sum in another order; decisions by these figures must be
        # the same everywhere.
        metrics = self.trainer.strategy.broadcast(open_loop_metrics(predicted, true))
        self.log_dict({f"val/{name}": value for name, value in metrics.items()})

    def configure_optimizers(self) -> "OptimizerLRScheduler":
        """Return the optimizer and its scheduler, as Lightning expects them."""
        optimizer = self.make_optimizer(self.parameter_groups())
        name = type(optimizer).__name__  # LBFGS computes the loss within a step
        if not isinstance(optimizer, torch.optim.Optimizer) or name == "LBFGS":
            raise InputError(f"optim: {name} cannot train; name one of torch.optim (not LBFGS)")
        if (schedule := self.make_schedule(optimizer)) is None:
            return {"optimizer": optimizer}
        return {"optimizer": optimizer, "lr_scheduler": schedule}

    def make_optimizer(self, groups: list[dict]) -> torch.optim.Optimizer:
        """Return the optimizer of parameter groups, see `parameter_groups`."""
        return self.optimizer(groups)

    def make_schedule(self, optimizer: torch.optim.Optimizer) -> "LRSchedulerConfigType | None":
        """Return Lightning's `lr_scheduler`; its `interval` is `epoch`, or `step` for batches."""
        if self.schedule is None:
            return None
        entry: LRSchedulerConfigType = {"scheduler": self.schedule(optimizer), "interval": "epoch"}
        if isinstance(entry["scheduler"], torch.optim.lr_scheduler.ReduceLROnPlateau):
            entry |= {"monitor": "val/mse", "frequency": NEVER}  # see `on_train_epoch_end`
        return entry

    def parameter_groups(self) -> list[dict]:
        """Return the parameter groups of the optimizer, see `optimizer_groups`."""
        return optimizer_groups(self.network, self.l2, self.backbone_lr)
