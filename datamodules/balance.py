"""Which samples go in which batch: at most a set share of each is nearly straight."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from datamodules.errors import InputError
from datamodules.samples import Samples


@dataclass(frozen=True)
class BatchKey:
    """Names a batch: what is random in it is drawn from the seed and from this alone."""

    epoch: int
    number: int
    samples: np.ndarray  # int64 [batch_size]


def epoch_batches(
    samples: Samples,
    batch_size: int,
    epoch: int,
    seed: int,
    samples_per_epoch: int | None = None,
    straight_cap: float | None = 0.5,
    straight_threshold: float = 0.1,
) -> list[np.ndarray]:
    """The batches of an epoch, each int64 [batch_size] (the last may be shorter).

    Without `samples_per_epoch` every sample comes once, in a new order each epoch. With it, so many
    are drawn: a row at random, then one of its cameras. No batch has more than
    `floor(straight_cap * its size)` samples with |steering| below the threshold: those in excess
    are drawn again from the rest, so that a batch never shrinks.

    Raises:
        InputError: a cap that cannot be held, for want of samples that are not straight.
    """
    rng = np.random.default_rng([seed, epoch])
    if samples_per_epoch is None:
        order = rng.permutation(len(samples))
    else:
        order = _draw_rows_then_cameras(samples, samples_per_epoch, rng)
    batches = [order[start : start + batch_size] for start in range(0, len(order), batch_size)]
    if straight_cap is None:
        return batches

    straight = np.abs(samples.steering) < straight_threshold
    curved = np.flatnonzero(~straight)
    if not len(curved):
        raise InputError(
            f"data.straight_cap={straight_cap} cannot be held: no sample has |steering| >= "
            f"data.straight_threshold={straight_threshold}; set data.straight_cap=null"
        )
    for batch in batches:
        positions = np.flatnonzero(straight[batch])
        excess = len(positions) - int(straight_cap * len(batch))
        if excess > 0:
            replaced = rng.choice(positions, excess, replace=False)
            batch[replaced] = rng.choice(curved, excess)
    return batches


def _draw_rows_then_cameras(samples: Samples, count: int, rng: np.random.Generator) -> np.ndarray:
    """Rows with fewer cameras (or cameras with fewer rows) come as often as others."""
    _, sizes = np.unique(samples.row, return_counts=True)
    by_row = np.argsort(samples.row, kind="stable")
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    drawn = rng.integers(len(sizes), size=count)
    return by_row[first[drawn] + rng.integers(sizes[drawn])]


class BalancedBatches:
    """A sampler of `BatchKey`s for a DataLoader with `batch_size=None`.

    Several processes each take every n-th batch of the same epoch; where the number of batches does
    not divide, the first ones come again, so that all take as many steps.
    """

    def __init__(
        self, samples: Samples, batch_size: int, seed: int, rank: int = 0, world: int = 1, **balance
    ) -> None:
        self.samples, self.batch_size, self.seed = samples, batch_size, seed
        self.rank, self.world, self.balance = rank, world, balance
        self.epoch = 0

    def set_epoch(self, epoch: int) -> None:
        """Called by Lightning at the start of each epoch."""
        self.epoch = epoch

    def __len__(self) -> int:
        count = self.balance.get("samples_per_epoch") or len(self.samples)
        return -(-count // (self.batch_size * self.world))

    def __iter__(self) -> Iterator[BatchKey]:
        batches = epoch_batches(
            self.samples, self.batch_size, self.epoch, self.seed, **self.balance
        )
        for step in range(len(self)):
            number = step * self.world + self.rank
            yield BatchKey(self.epoch, number, batches[number % len(batches)])
