"""Several batches in a step of Lightning's, with an optimizer step for each."""

from torch import Tensor

from datamodules.batches import Batch
from zoo.training.batch_step import BatchStep


class GroupStep(BatchStep):
    """The optimizer steps of a group of batches; Lightning takes the last one.

    Lightning's own work for a step takes as long as two batches of a small network, see
    `datamodules.batches`.
    """

    def step_ahead(self, group: list[Batch]) -> None:
        """Step for each batch but the last."""
        for batch in group[:-1]:
            self.count(self.whole_step(batch), len(batch["images"]))

    def whole_step(self, batch: Batch) -> Tensor:
        """Step the optimizer by a batch's loss; return it."""
        trainer = self.module.trainer
        optimizer = trainer.optimizers[0]
        with trainer.precision_plugin.train_step_context():
            loss = self.batch_loss(batch)
        for group in optimizer.param_groups:  # zero_grad() takes longer than tiny's relu
            for parameter in group["params"]:
                parameter.grad = None
        loss.backward()
        optimizer.step()
        return loss.detach()
