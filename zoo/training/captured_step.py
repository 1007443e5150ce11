"""A training step on a GPU as one CUDA graph.

A batch of PilotNet takes some 250 operations of a few microseconds each, and a Python program takes
longer to start one. A graph starts all of them with one call
(https://pytorch.org/docs/stable/notes/cuda.html#cuda-graphs).
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch
from rich.console import Console
from torch import Tensor
from torch.optim import Optimizer

from datamodules.batches import Batch
from zoo.base.errors import InputError
from zoo.base.terminal import print_line
from zoo.training.batch_step import BatchLoss, StepModule
from zoo.training.group_step import GroupStep

REPLACED = ("lr", "capturable")  # settings of a group that differ within a step
PLAIN_STEPS = 3  # in which libraries choose and allocate what a capture must not


class CapturedStep:
    """An optimizer step that is captured once, and replayed from then on.

    The weights are those of the same steps without a graph, but for the rounding of the learning
    rate to 32 bits. Where a step cannot be captured, all steps are plain, and a line says why.

    Args:
        step: function from a batch to its loss, detached, which steps the optimizer.
        optimizer: optimizer of this step.
        size: number of samples of a batch that is captured; other batches take a plain step.
        console: console for that line.
    """

    def __init__(
        self,
        step: Callable[[Batch], Tensor],
        optimizer: Optimizer,
        size: int,
        console: Console,
    ) -> None:
        self.step, self.optimizer, self.size, self.console = step, optimizer, size, console
        self.graph: torch.cuda.CUDAGraph | None = None
        self.plain_steps, self.failed = 0, False
        self.lr: list[float] = []
        device = optimizer.param_groups[0]["params"][0].device
        self.rates = [torch.zeros((), device=device) for _ in optimizer.param_groups]

    def __call__(self, batch: Batch) -> Tensor:
        """Step; return the loss, which the next step overwrites."""
        if self.failed:
            return self.step(batch)
        if self.lr != (lr := [group["lr"] for group in self.optimizer.param_groups]):
            self.lr = lr
            for rate, value in zip(self.rates, lr, strict=True):
                rate.fill_(torch.tensor(value, dtype=torch.float32).item())  # inf beyond
        whole = len(batch["images"]) == self.size
        graph = self.graph
        if graph is not None and self.settings != self._settings():
            graph = self.graph = None  # a schedule changed more than the learning rate
        try:
            with self._capturable():
                if whole and graph is None and self.plain_steps >= PLAIN_STEPS:
                    graph = self._capture(batch)
                elif graph is None or not whole:
                    self.plain_steps += whole
                    return self._beside(batch)
        except InputError:
            raise
        except Exception as error:  # of any library: most need the CPU to wait for the GPU
            self.failed, self.graph = True, None
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            print_line(self.console, f"steps are not replayed as a CUDA graph: {reason}")
            return self.step(batch)
        for name, tensor in batch.items():
            self.batch[name].copy_(tensor)
        graph.replay()
        return self.loss

    def _capture(self, batch: Batch) -> torch.cuda.CUDAGraph:
        """Record a step on tensors of its own; nothing is computed."""
        if (device := self.rates[0].device.type) != "cuda":
            raise RuntimeError(f"the weights are on the {device}")  # a capture would be empty
        self.batch = {name: tensor.clone() for name, tensor in batch.items()}
        self.settings, graph = self._settings(), torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            self.loss = self.step(self.batch)
        self.graph = graph
        return graph

    def _beside(self, batch: Batch) -> Tensor:
        """Take a plain step on another stream, as a capture does: gradients keep their stream."""
        if batch["images"].device.type != "cuda":
            return self.step(batch)
        current, stream = torch.cuda.current_stream(), torch.cuda.Stream()
        stream.wait_stream(current)
        with torch.cuda.stream(stream):
            loss = self.step(batch)
        current.wait_stream(stream)
        return loss

    @contextmanager
    def _capturable(self) -> Iterator[None]:
        """Let the optimizer read its learning rates from the device, where a graph finds them."""
        groups = self.optimizer.param_groups
        kept = [{key: group[key] for key in REPLACED if key in group} for group in groups]
        try:
            for group, rate in zip(groups, self.rates, strict=True):
                group["lr"] = rate
                if "capturable" in group:
                    group["capturable"] = True
            yield
        finally:
            for group, before in zip(groups, kept, strict=True):
                group.update(before)

    def _settings(self) -> list[dict]:
        """Return what a capture fixes: all settings but the learning rate."""
        return [
            {key: value for key, value in group.items() if key not in ("params", *REPLACED)}
            for group in self.optimizer.param_groups
        ]


class CapturedGroup(GroupStep):
    """The optimizer steps of a group of batches, each a `CapturedStep`; Lightning takes none.

    Args:
        module, batch_loss: see `BatchStep`.
        size, console: see `CapturedStep`.
    """

    by_lightning = False

    def __init__(
        self, module: StepModule, batch_loss: BatchLoss, size: int, console: Console
    ) -> None:
        super().__init__(module, batch_loss)
        self.captured = CapturedStep(self.whole_step, module.trainer.optimizers[0], size, console)

    def step_ahead(self, group: list[Batch]) -> None:
        """Take no step: `loss` takes all."""

    def loss(self, group: list[Batch]) -> None:
        """Step for each batch of the group."""
        for batch in group:
            self.count(self.captured(batch), len(batch["images"]))
