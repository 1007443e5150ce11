"""How a recording is written in a format: keys of `drivezoo convert`, and what a writer returns."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

Side = Annotated[int, Field(ge=1, le=4096)]
Progress = Callable[[float], None]  # function called with the finished share, 0..1


@dataclass(frozen=True, kw_only=True)
class WriteOptions:
    """What a user says about the recording to write; a format uses what concerns it.

    Args:
        fps: LeRobot: frames per second to write; null: the recording's mean.
        crf: LeRobot: quality of the videos, of which 1 is the best and the largest.
        task: LeRobot: the task in words.
        keep: rows to write, 120-180,2600-, from 1; null: all.
        size: rows and columns of the written images, such as [96,96]; null: as they are.
        fit: keep: images as they are; pad: with black bars, twice as wide as high, as the
            simulator's frames are.
        quality: quality of JPEGs written from videos, resized or padded.
        shard_mb: shards: MB of each.
    """

    fps: Annotated[int, Field(ge=1, le=1000)] | None = None
    crf: Annotated[int, Field(ge=1, le=51)] = 18
    task: str = "follow the road"
    keep: str | None = None
    size: tuple[Side, Side] | None = None
    fit: Literal["keep", "pad"] = "keep"
    quality: Annotated[int, Field(ge=1, le=100)] = 95
    shard_mb: Annotated[float, Field(gt=0, le=4000)] = 128


@dataclass(frozen=True)
class Converted:
    """A converted recording.

    Attributes:
        folder: folder that was written.
        rows: number of rows in it.
        drives: number of continuous drives.
        notes: a line on each loss or assumption.
        following: words of the command to type next; empty for `drivezoo check FOLDER`.
        purpose: where or why to type it.
    """

    folder: Path
    rows: int
    drives: int
    notes: tuple[str, ...] = ()
    following: tuple[str, ...] = ()
    purpose: str = ""
