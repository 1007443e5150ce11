"""Batches that several processes share: each rank has a part, which may be empty."""

from collections.abc import Sequence

import lightning
import numpy as np
import torch
from torch import Tensor

from datamodules.batches import Batch
from zoo.models.network_facts import loss_facts_of
from zoo.training.batch_step import BatchStep


class RankStep(BatchStep):
    """A step by a rank's part of a batch, weighted by the part's share of the loss's divisor.

    The ranks' mean gradient is then that of the whole batch's loss. All ranks sum the whole loss:
    if it is not finite, all stop.
    """

    def loss(self, group: list[Batch]) -> Tensor:
        """Return this rank's loss, so weighted; zero for no samples."""
        module, (batch,) = self.module, group
        samples = len(batch["images"])
        if samples:
            loss = self.batch_loss(batch)
        else:
            trained = (p for p in module.network.parameters() if p.requires_grad)
            loss = sum((0.0 * p.sum() for p in trained), torch.zeros(()))
        divisor, true = loss_facts_of(module.loss).divisor, module.targets_of(batch)
        share = loss.new_tensor(samples) if divisor is None else divisor(true).to(loss)
        # In double precision, in which a sum of counts is exact.
        sums = torch.stack([loss.detach() * share, share, loss.new_tensor(samples)]).double()
        torch.distributed.all_reduce(sums)
        whole, divided_by, all_samples = sums
        self.count(whole / divided_by, all_samples)
        return loss * (share * module.trainer.world_size / divided_by).to(loss)


def all_rows(trainer: lightning.Trainer, columns: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return columns of all processes' rows, in order of rows.

    Each rank has contiguous rows, in order of ranks.
    """
    shares = [columns]
    if trainer.world_size > 1:
        shares = [[]] * trainer.world_size
        torch.distributed.all_gather_object(shares, columns)
    return [np.concatenate(parts) for parts in zip(*shares, strict=True)]
