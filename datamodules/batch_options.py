"""How training batches are drawn and fed: keys of `data` that the datamodule reads."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from datamodules.driving_log import CAMERAS
from datamodules.read_options import ReadOptions
from zoo.base.command_keys import Untyped

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
    workers: Annotated[int, Field(ge=0)] = 0
    seed: Annotated[int, Untyped()] = 1

    @property
    def cache_folder(self) -> Path | None:
        """Return the folder of decoded views and features; None to keep them in memory."""
        return Path(self.cache).expanduser() if self.cache else None
