"""The one LightningModule that trains every network of the zoo."""

import time
from collections.abc import Callable

import numpy as np
import torch
from lightning.pytorch.plugins import Precision
from lightning.pytorch.utilities import GradClipAlgorithmType
from torch import Tensor, nn

from datamodules.batches import Batch
from zoo.base.errors import InputError
from zoo.models.layers import piece_length
from zoo.models.memory import Memory
from zoo.models.network_facts import facts_of, loss_facts_of
from zoo.training.batch_outputs import predictor, true_outputs
from zoo.training.captured_step import CapturedStep
from zoo.training.open_loop import open_loop_metrics
from zoo.training.run_module import RunModule

OWN = "zoo.training.steering_module.SteeringModule"
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
        backbone_lr: learning rate of the network's `backbone`, if it has one.
        seed: random seed of dropout in each epoch: a resumed run repeats an uninterrupted one.
        card: plain containers that every checkpoint holds (see `zoo.checkpoints.checkpoint`).
        skips_front: whether batches hold features of the frozen layers in place of images.
        compile_loss: function that compiles the loss of a batch; None without compilation.
        compiled_batch: size of the batches whose loss is compiled.
        capture: function from a step and an optimizer to a `CapturedStep`, for groups on a GPU.

    A step of Lightning's may take a list of batches, one optimizer step each (see
    `datamodules.batches`).

    With several processes, each rank has a shard of each batch, which may be empty.
    Each rank's loss is weighted by its part of the whole batch's divisor: the mean gradient is that
    of the whole batch's loss.

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
        compile_loss: Callable[[Callable], Callable] | None = None,
        compiled_batch: int | None = None,
        capture: Callable[..., CapturedStep] | None = None,
    ) -> None:
        super().__init__(network, card)
        self.loss = loss
        self.optimizer, self.schedule = optimizer, schedule
        self.l2, self.backbone_lr, self.seed = l2, backbone_lr, seed
        self._samples_before = 0
        self._loss_sum: Tensor | float = 0.0
        self._loss_count: Tensor | int = 0
        self.skips_front, self._compiled_batch = skips_front, compiled_batch
        self._predict, self._targets = predictor(network, skips_front), true_outputs(network)
        self._loss = self._plain_loss()
        self._compiled = compile_loss(self._loss) if compile_loss else None
        self._capture, self._captured = capture, None

    def forward(self, batch: Batch) -> Tensor:
        """Return the outputs, float32 [N, outputs], steering first; of a window's newest frame."""
        # A training's normalization and dropout need the whole batch.
        size = len(batch["images"]) or 1 if self.training else piece_length(batch["images"])
        pieces = [
            dict(zip(batch, tensors, strict=True))
            for tensors in zip(*(one.split(size) for one in batch.values()), strict=True)
        ]
        predicted = torch.cat([self._predict(piece) for piece in pieces])
        return self.network.newest(predicted) if isinstance(self.network, Memory) else predicted

    def _plain_loss(self) -> Callable[[Batch], Tensor]:
        """Return a function from a batch to its loss, without `self`, to compile."""
        predict, loss, has_memory = self._predict, self.loss, isinstance(self.network, Memory)
        targets_of = self._targets if type(self) is SteeringModule else self.targets_of

        def batch_loss(batch: Batch) -> Tensor:
            predicted = predict(batch)
            rows = predicted.flatten(0, 1) if has_memory else predicted
            return loss(rows, targets_of(batch))

        return batch_loss

    def targets_of(self, batch: Batch) -> Tensor:
        """Return the targets of the loss, [rows, columns of the network in training]."""
        return self._targets(batch)

    def on_train_start(self) -> None:
        """Start the clock: an epoch that is resumed inside has no start."""
        self._clock = time.perf_counter()
        if self._capture:
            self._captured = self._capture(self._whole_step, self.trainer.optimizers[0])

    def on_train_epoch_start(self) -> None:
        """Start counting samples and loss of the epoch."""
        self._samples_before = self.train_samples
        self._loss_sum, self._loss_count = 0.0, 0
        self._clock = time.perf_counter()

    def on_train_batch_start(self, batch: Batch | list[Batch], number: int) -> None:
        """Keep the group's first batches; seed dropout at the epoch's start."""
        self._ahead = batch[:-1] if isinstance(batch, list) else []
        if number == 0:
            # Dropout depends on the epoch alone, so that a resumed run repeats it. Not earlier:
            # creating a loader's iterator draws too, and a resumed run creates it before.
            torch.manual_seed(self.seed * 1_000_003 + self.current_epoch * 1_009 + self.global_rank)

    def training_step(self, batch: Batch | list[Batch], number: int) -> Tensor | None:
        """Return the loss of the batch, or of a group's last batch; None of captured steps."""
        if self._captured and isinstance(batch, list):
            loss = None
            for part in batch:
                self._count(self._captured(part), len(part["images"]))
        else:
            loss = self._counted_loss(batch[-1] if isinstance(batch, list) else batch)
        if number % CHECK_EVERY == 0:
            self._check_finite()
        return loss

    def optimizer_step(self, epoch: int, number: int, optimizer: object, closure: Callable) -> None:
        """Step for each batch of the group but the last; then take Lightning's step."""
        if self._captured:
            closure()
            return
        for batch in self._ahead:
            self._count(self._whole_step(batch), len(batch["images"]))
        super().optimizer_step(epoch, number, optimizer, closure)

    def _whole_step(self, batch: Batch) -> Tensor:
        """Step the optimizer by a batch's loss; return it."""
        optimizer = self.trainer.optimizers[0]
        with self.trainer.precision_plugin.train_step_context():
            loss = self._loss_of(batch)
        for group in optimizer.param_groups:  # zero_grad() takes longer than tiny's relu
            for parameter in group["params"]:
                parameter.grad = None
        loss.backward()
        optimizer.step()
        return loss.detach()

    def _loss_of(self, batch: Batch) -> Tensor:
        compiled = self._compiled and len(batch["images"]) == self._compiled_batch
        return (self._compiled if compiled else self._loss)(batch)

    def _count(self, loss: Tensor, count: int) -> None:
        # Not summed in place: a compiled step owns the loss that it returns.
        self._loss_sum = self._loss_sum + loss * count
        self._loss_count += count

    def _counted_loss(self, batch: Batch) -> Tensor:
        count = len(batch["images"])
        if not count:  # a rank without samples returns a zero loss
            loss = sum(0.0 * p.sum() for p in self.network.parameters() if p.requires_grad)
        else:
            loss = self._loss_of(batch)
        if self.trainer.world_size > 1:
            return self._rank_loss(loss, self.targets_of(batch), count)
        self._count(loss.detach(), count)
        return loss

    def _rank_loss(self, loss: Tensor, targets: Tensor, count: int) -> Tensor:
        """Return this rank's loss, weighted so that the ranks' mean is the whole batch's loss.

        All ranks sum the whole loss: if it is not finite, all stop.
        """
        divisor = loss_facts_of(self.loss).divisor
        share = loss.new_tensor(count) if divisor is None else divisor(targets).to(loss)
        # In double precision, in which a sum of counts is exact.
        sums = torch.stack([loss.detach() * share, share, loss.new_tensor(count)]).double()
        torch.distributed.all_reduce(sums)
        whole, divided_by, samples = sums
        self._loss_sum = self._loss_sum + whole / divided_by * samples
        self._loss_count = self._loss_count + samples
        return loss * (share * self.trainer.world_size / divided_by).to(loss)

    @property
    def train_samples(self) -> int:
        """Return the number of samples that all processes have trained on."""
        return self._samples_before + int(self._loss_count)

    def on_train_batch_end(self, *_: object) -> None:
        """Count the time of the step."""
        if self.trainer.is_last_batch:
            float(self._loss_sum)  # waits for the steps that a GPU has not yet taken
        # From the end of a step to the end of the next: validation and plots do not count.
        now = time.perf_counter()
        self.train_seconds += now - self._clock
        self._clock = now

    def on_validation_start(self) -> None:
        """Check that the loss and the weights are finite."""
        # Before this epoch is saved: the last checkpoint stays finite.
        if not self.trainer.sanity_checking:
            self._check_finite(weights=True)

    def on_train_epoch_end(self) -> None:
        """Check that all is finite, and log the mean loss."""
        self._check_finite(weights=True)
        self.train_epochs += 1
        self.log("train/loss", float(self.mean_loss()), sync_dist=True)

    def mean_loss(self) -> Tensor:
        """Return the mean loss of the epoch so far, over all processes' samples."""
        return self._loss_sum / self._loss_count

    def _check_finite(self, weights: bool = False) -> None:
        """Check the loss, and the weights: the last loss was computed before the last step."""
        what = None
        if not np.isfinite(float(self._loss_sum)):
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
        """Clip the gradients, also in bfloat16 with a fused optimizer.

        Lightning refuses this, as in 16 bits with scaled gradients, which such an optimizer takes.
        In bfloat16 gradients are not scaled.
        """
        plugin = self.trainer.precision_plugin
        if not gradient_clip_val or getattr(plugin, "scaler", None):
            self.clip_gradients(optimizer, gradient_clip_val, gradient_clip_algorithm)
            return
        algorithm = GradClipAlgorithmType(gradient_clip_algorithm or "norm")
        Precision.clip_gradients(plugin, optimizer, gradient_clip_val, algorithm)

    def on_validation_epoch_start(self) -> None:
        """Start with no predictions."""
        # Numbers, not tensors: small tensors between the batches' activations fragment the heap.
        self._predicted: list[float] = []
        self._true: list[float] = []

    def validation_step(self, batch: Batch, _: int) -> None:
        """Collect predicted and true steering."""
        if not len(batch["targets"]):  # this rank has no rows
            return
        self._predicted += self(batch)[:, 0].float().tolist()
        self._true += batch["targets"][:, 0].tolist()

    def on_validation_epoch_end(self) -> None:
        """Log the figures of all validation rows."""
        own = [np.array(column, np.float32) for column in (self._predicted, self._true)]
        self.validation = predicted, true = self._all_rows(own)
        # Processes on other machines may sum in another order; decisions by these figures must be
        # the same everywhere.
        metrics = self.trainer.strategy.broadcast(open_loop_metrics(predicted, true))
        self.log_dict(
            {f"val/{name}": value for name, value in metrics.items()}, rank_zero_only=False
        )

    def _all_rows(self, own: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return predicted and true steering of all processes, float32 [N], in order of rows.

        Each rank has contiguous rows, in order of ranks.
        """
        shares = [own]
        if self.trainer.world_size > 1:
            shares = [None] * self.trainer.world_size
            torch.distributed.all_gather_object(shares, own)
        predicted, true = (np.concatenate(column) for column in zip(*shares, strict=True))
        return predicted, true

    def configure_optimizers(self) -> dict:
        """Return the optimizer and its scheduler, as Lightning expects them."""
        optimizer = self.make_optimizer(self.parameter_groups())
        schedule = self.make_schedule(optimizer)
        return {"optimizer": optimizer} | ({"lr_scheduler": schedule} if schedule else {})

    def make_optimizer(self, groups: list[dict]) -> torch.optim.Optimizer:
        """Return the optimizer of parameter groups, see `parameter_groups`."""
        return self.optimizer(groups)

    def make_schedule(self, optimizer: torch.optim.Optimizer) -> dict | None:
        """Return Lightning's `lr_scheduler`; its `interval` is `epoch`, or `step` for batches."""
        if self.schedule is None:
            return None
        schedule = {"scheduler": self.schedule(optimizer), "interval": "epoch"}
        if isinstance(schedule["scheduler"], torch.optim.lr_scheduler.ReduceLROnPlateau):
            schedule["monitor"] = "val/mse"
        return schedule

    def parameter_groups(self) -> list[dict]:
        """Return parameter groups: weights decay, biases do not; a backbone may have its own rate.

        Without `l2` no group has a `weight_decay`: the optimizer's own counts for all.
        Each group costs a call of the optimizer, so there are as few as possible.
        """
        backbone = facts_of(self.network).backbone
        slow = {id(p) for p in backbone.parameters()} if backbone is not None else set()
        groups: dict[tuple[bool, bool], list[nn.Parameter]] = {}
        for parameter in self.network.parameters():
            if parameter.requires_grad:
                own_rate = id(parameter) in slow and self.backbone_lr is not None
                key = own_rate, parameter.ndim > 1 and self.l2 > 0
                groups.setdefault(key, []).append(parameter)
        if not groups:
            raise InputError("no parameter can be trained; set model.trainable_blocks above 0")
        return [
            {
                "params": parameters,
                # The gradient of l2 * w^2 is 2 * l2 * w; torch's weight_decay w adds w itself.
                **({"weight_decay": 2 * self.l2 if decays else 0.0} if self.l2 else {}),
                **({"lr": self.backbone_lr} if is_backbone else {}),
            }
            for (is_backbone, decays), parameters in groups.items()
        ]
