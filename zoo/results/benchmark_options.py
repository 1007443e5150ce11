"""Keys of `drivezoo benchmark`, and the names of its drivers that are not checkpoints."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from zoo.base.process_pool import PROCESSES, Executor
from zoo.runs.table_files import ResultFiles

# Steering of 0; mean steering of the training data; the expert; the expert with late commands.
BASELINES = ("zero", "mean", "expert", "expert_late")
HUMAN = "human"  # a person at keyboard, mouse or gamepad
NO_CHECKPOINT = (*BASELINES, HUMAN)


@dataclass(frozen=True, kw_only=True)
class BenchmarkOptions(ResultFiles):
    """Keys of a benchmark.

    Args:
        suite: suite of roads: a name in conf/suite, or a .yaml file.
        split: test: the groups of the suite; dev: its roads to tune on.
        entry: name of the entry; null: the name of the network or of the baseline.
        out: output folder; null: named by date and time.
        workers: processes that drive; 0: one per core.
        executor: processes; ray or slurm: each drive is a task of a cluster.
        drives: drives that verify repeats, chosen by the digest; 0: all.
        plot: file to draw each group's autonomy in: .pdf, .svg or .png.
    """

    suite: str = "v3"
    split: Literal["test", "dev"] = "test"
    entry: str | None = None
    out: str | None = None
    workers: Annotated[int, Field(ge=0)] = 0
    executor: Executor = PROCESSES
    drives: Annotated[int, Field(ge=0)] = 5
