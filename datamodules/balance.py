"""Batches of training: their keys of `data`, and samplers that limit the nearly straight share."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from datamodules.driving_log import CAMERAS
from datamodules.format_options import ReadOptions
from datamodules.samples import Samples
from zoo.base.command_keys import Untyped
from zoo.base.errors import InputError

Share = Annotated[float, Field(ge=0, le=1)]
Least0 = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=1)]


@dataclass(frozen=True, kw_only=True)
class BatchOptions(ReadOptions):
    """How training batches are drawn from samples, and what prepares them.

    Args:
        weights: [1, 4]: draw the second of two recordings four times as often
        cameras: cameras whose images are samples
        flip: mirrored samples: probability; or both: each sample as it is and flipped
        straight_cap: largest share of nearly straight samples; null: no limit
        straight_threshold: |steering| below it is nearly straight
        samples_per_epoch: number of samples drawn for an epoch; null: each sample once
        batch_size: samples in a batch, total of all ranks
        augment_on: cpu, device, or auto: on the device if it is not a CPU
        window_shards: shards whose images are mixed with each other
        workers: processes that prepare batches
        seed: random seed of order, draws, flips and augmentation
    """

    weights: Sequence[Any] | None = None
    cameras: Sequence[str] = CAMERAS
    flip: Share | Literal["both"] = 0.5
    straight_cap: Share | None = 0.5
    straight_threshold: Least0 = 0.1
    samples_per_epoch: Count | None = None
    batch_size: Count = 64
    augment_on: Literal["auto", "cpu", "device"] = "auto"
    window_shards: Count = 64
    workers: Annotated[int, Field(ge=0, le=256)] = 0
    seed: Annotated[int, Untyped()] = 1

    @property
    def cache_folder(self) -> Path | None:
        """Return the folder of decoded views and features; None to keep them in memory."""
        return Path(self.cache).expanduser() if self.cache else None


@dataclass(frozen=True)
class BatchKey:
    """The key of a batch, or of one rank's shard of it.

    Random values are drawn for the whole batch and depend only on seed, epoch and number: all
    shards together are the batch that one process would have.

    Attributes:
        epoch: epoch, from 0.
        number: batch of the epoch, from 0.
        samples: sample numbers of the whole batch, int64 [N].
        rank: rank of this process.
        world: number of processes.
    """

    epoch: int
    number: int
    samples: np.ndarray
    rank: int = 0
    world: int = 1

    @property
    def share(self) -> slice:
        """Return this rank's slice of `samples`, which may be empty."""
        return share_of(len(self.samples), self.rank, self.world)

    @property
    def own(self) -> np.ndarray:
        """Return this rank's samples, int64 [n]."""
        return self.samples[self.share]


def share_of(count: int, rank: int, world: int) -> slice:
    """Return one rank's shard of `count` items; all shards together are all items.

    >>> [share_of(7, rank, 3) for rank in range(3)]
    [slice(0, 2, None), slice(2, 4, None), slice(4, 7, None)]
    """
    return slice(rank * count // world, (rank + 1) * count // world)


def epoch_batches(
    samples: Samples,
    batch_size: int,
    epoch: int,
    seed: int,
    samples_per_epoch: int | None = None,
    straight_cap: float | None = BatchOptions.straight_cap,
    straight_threshold: float = BatchOptions.straight_threshold,
    weights: np.ndarray | None = None,
    shard: np.ndarray | None = None,
    window_shards: int = BatchOptions.window_shards,
    world: int = 1,
) -> list[np.ndarray]:
    """Return the batches of an epoch, each int64 [batch_size] (the last may be shorter).

    Without `samples_per_epoch` each sample occurs once, in a new order each epoch. With it, that
    many are drawn: a random row, then one of its cameras. No batch has more than
    `floor(straight_cap * its size)` samples with |steering| below the threshold: the excess is
    replaced by random samples with more steering, so that batches keep their size.

    With `weights`, float64 [samples] above 0, a sample occurs that many times instead of once; with
    2.5, two or three times. Random draws, also those for the cap, are by weight.

    With `shard`, int64 [samples], the order walks over windows of `window_shards` random shards,
    and the cap draws from the window of the replaced sample, unless that has no curve. Each of
    `world` processes walks over windows of its own.

    Raises:
        InputError: the cap cannot be kept because every sample is nearly straight.
    """
    rng = np.random.default_rng([seed, epoch])
    if samples_per_epoch is not None:
        order = _draw_rows_then_cameras(samples, samples_per_epoch, rng, weights)
    elif weights is not None:
        order = _repeat_by_weight(weights, rng)
    else:
        order = rng.permutation(len(samples))
    window = np.zeros(len(samples), np.int64)
    if shard is not None:
        window = shard_windows(shard, window_shards, seed, epoch)
        walked = order[np.argsort(window[order], kind="stable")]
        order[np.argsort(_ranks(len(order), batch_size, world), kind="stable")] = walked
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
    by_window = curved[np.argsort(window[curved], kind="stable")]
    windows, first = np.unique(window[by_window], return_index=True)
    pools = dict(zip(windows.tolist(), np.split(by_window, first[1:]), strict=True))
    for batch in batches:
        positions = np.flatnonzero(straight[batch])
        excess = len(positions) - int(straight_cap * len(batch))
        if excess > 0:
            replaced = rng.choice(positions, excess, replace=False)
            windows = window[batch[replaced]]
            for number in np.unique(windows).tolist():
                at, pool = replaced[windows == number], pools.get(number, curved)
                chances = None if weights is None else _chances(weights[pool])
                batch[at] = rng.choice(pool, len(at), p=chances)
    return batches


def shard_windows(shard: np.ndarray, window_shards: int, seed: int, epoch: int) -> np.ndarray:
    """Return the window of each sample in an epoch, int64 [samples], by its shard."""
    shards, index = np.unique(shard, return_inverse=True)
    rank = np.random.default_rng([seed, epoch, len(shards)]).permutation(len(shards))
    return rank[index] // window_shards


def _ranks(count: int, batch_size: int, world: int) -> np.ndarray:
    """Return the rank whose shard of a batch each position of an order is in, see `share_of`.

    >>> _ranks(10, 7, 3)
    array([0, 0, 1, 1, 2, 2, 2, 0, 1, 2])
    """
    start = np.arange(count) // batch_size * batch_size
    size = np.minimum(batch_size, count - start)
    return ((np.arange(count) - start + 1) * world - 1) // size


def _draw_rows_then_cameras(
    samples: Samples, count: int, rng: np.random.Generator, weights: np.ndarray | None = None
) -> np.ndarray:
    """Draw rows first: a row with fewer cameras is drawn as often as another."""
    _, sizes = np.unique(samples.row, return_counts=True)
    by_row = np.argsort(samples.row, kind="stable")
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    if weights is None:
        drawn = rng.integers(len(sizes), size=count)
    else:  # all samples of a row weigh the same
        drawn = rng.choice(len(sizes), count, p=_chances(weights[by_row[first]]))
    return by_row[first[drawn] + rng.integers(sizes[drawn])]


def _repeat_by_weight(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Repeat each sample by its weight, in random order: `weighted_count` samples total."""
    order = rng.permutation(len(weights))
    # Systematic resampling, in random order: else a weight of 1/3 would always pick one camera.
    ends = np.cumsum(weights[order]) * (weighted_count(weights) / weights.sum())
    ends[-1] = weighted_count(weights)  # the sum of many fractions can differ in the last bit
    times = np.diff(np.floor(ends + rng.random()), prepend=0.0).astype(np.int64)
    return rng.permutation(np.repeat(order, times))


def weighted_count(weights: np.ndarray) -> int:
    """Return the number of samples in an epoch that repeats each by its weight."""
    return max(1, round(float(weights.sum())))


def _chances(weights: np.ndarray) -> np.ndarray:
    return weights / weights.sum()


class BalancedBatches:
    """A sampler of `BatchKey`s for a DataLoader with `batch_size=None`.

    With several processes each takes its shard of every batch: an epoch has the same steps,
    and each step the same samples, as with one process.

    Args:
        samples: samples to draw from.
        batch_size: samples in a batch, of all processes together.
        seed: random seed of order and draws.
        rank: rank of this process.
        world: number of processes.
        balance: other arguments of `epoch_batches`.

    Attributes:
        start: batches that are skipped once, of an epoch that is resumed.
        fetch_ahead: function from shards to nothing, which starts to fetch them; or None.
        windows_ahead: windows that are fetched while one is trained on.
    """

    start = 0
    fetch_ahead: Callable[[np.ndarray], None] | None = None
    windows_ahead = 1

    def __init__(
        self,
        samples: Samples,
        batch_size: int,
        seed: int,
        rank: int = 0,
        world: int = 1,
        **balance: Any,
    ) -> None:
        self.samples, self.batch_size, self.seed = samples, batch_size, seed
        self.rank, self.world, self.balance = rank, world, balance
        self.epoch = 0

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch; Lightning calls this at the start of each."""
        self.epoch = epoch

    def __len__(self) -> int:
        weights = self.balance.get("weights")
        whole = len(self.samples) if weights is None else weighted_count(weights)
        count = self.balance.get("samples_per_epoch") or whole
        return -(-count // self.batch_size)

    def __iter__(self) -> Iterator[BatchKey]:
        balance, shard, reached = self.balance, self.balance.get("shard"), -1
        if shard is not None:
            balance = {**balance, "world": self.world}
            window = shard_windows(shard, balance["window_shards"], self.seed, self.epoch)
        batches = epoch_batches(self.samples, self.batch_size, self.epoch, self.seed, **balance)
        start, self.start = self.start, 0
        for number, samples in enumerate(batches[start:], start):
            key = BatchKey(self.epoch, number, samples, self.rank, self.world)
            if self.fetch_ahead and shard is not None and len(key.own):
                newest = int(np.median(window[key.own]))  # the cap can draw from elsewhere
                if newest > reached:
                    reached = newest
                    for ahead in range(newest, newest + self.windows_ahead + 1):
                        self.fetch_ahead(np.unique(shard[window == ahead]))
            yield key
