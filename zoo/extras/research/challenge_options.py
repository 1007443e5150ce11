"""Keys of `drivezoo evaluate challenge=ch2`."""

from dataclasses import dataclass

from zoo.runs.table_files import TableFiles
from zoo.scoring.evaluate_options import ReplayMph


@dataclass(frozen=True, kw_only=True)
class ChallengeOptions(TableFiles):
    """Keys of a score on a published test.

    Args:
        split: file of image,part rows, such as a run's split.csv, whose test rows are scored; null:
            all rows, which a network that was trained on some of them may not have.
        speed: mph that a network is told, since the test has no speed.
        out: output folder; null: named by date and time.
    """

    split: str | None = None
    speed: ReplayMph = 30.0
    out: str | None = None
