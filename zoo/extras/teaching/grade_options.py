"""Keys of `drivezoo grade`."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from zoo.runs.table_files import TableFiles


@dataclass(frozen=True, kw_only=True)
class GradeOptions(TableFiles):
    """Keys of a class's marks.

    Args:
        suite: suite of roads with marks: a name in conf/suite, or a .yaml file.
        seed: secret number that draws unknown roads of the same families; random: a long one, which
            the output folder keeps in seed.txt; null: the suite's own roads, which everybody can
            drive.
        roads: drawn roads in place of each road of the suite; more make narrower intervals.
        recording: recording of the course, on which networks must have been trained; null: any.
        points: points of a student who passes all marks; others get their share.
        minutes: longest time of a submission; it is then stopped, and not marked.
        jobs: submissions that are driven at the same time.
        out: output folder; null: named by date and time.
    """

    suite: str = "course"
    seed: Annotated[int, Field(ge=0)] | Literal["random"] | None = None
    roads: Annotated[int, Field(ge=1, le=20)] = 1
    recording: str | None = None
    points: Annotated[float, Field(gt=0)] = 10.0
    minutes: Annotated[float, Field(gt=0)] = 15.0
    jobs: Annotated[int, Field(ge=1)] = 1
    out: str | None = None
