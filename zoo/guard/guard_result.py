"""What a guard command found, before it is written and printed."""

from dataclasses import dataclass, field

from zoo.drives.bootstrap import Estimate
from zoo.guard.conditions import Condition
from zoo.guard.guard_drives import Driven, ScoredDrive
from zoo.guard.guard_options import GuardOptions
from zoo.monitor.scores import Score, Threshold

NOMINAL = "nominal"  # group of conditions


@dataclass(frozen=True)
class Fitted:
    """Scores and thresholds of the methods, and the nominal drives that count false alarms."""

    scores: dict[str, Score]
    thresholds: dict[str, Threshold]
    signal_ms: dict[str, float]
    nominal: list[ScoredDrive]


@dataclass(frozen=True)
class Pairs:
    """Drives of the same conditions without a guard, with it, and at the same mean speed.

    Attributes:
        conditions: conditions; those of nominal drives have the group NOMINAL.
        without: figures without a guard.
        guarded: figures with the guard.
        slower: figures without a guard at the mean speed of the guarded drive.
    """

    conditions: list[Condition]
    without: list[Driven]
    guarded: list[Driven]
    slower: list[Driven]


@dataclass(frozen=True)
class GuardResult:
    """Result of the command.

    Attributes:
        checkpoint: checkpoint file.
        options: options of the command.
        fitted: scores and thresholds.
        shifted: drives of the conditions.
        figures: by group, method and lead in seconds, the figures of `warning_figures`.
        shifted_alarms: by group and method, the share of the conditions' normal windows with an
            alarm.
        method: method of the guard file.
        pairs: paired drives; None if there were none.
        notes: lines about what could not be measured.
    """

    checkpoint: str
    options: GuardOptions
    fitted: Fitted
    shifted: list[ScoredDrive]
    figures: dict[str, dict[str, dict[int, dict[str, Estimate]]]]
    shifted_alarms: dict[str, dict[str, float]]
    method: str
    pairs: Pairs | None = None
    notes: list[str] = field(default_factory=list)


def of_group(drives: list[ScoredDrive], group: str) -> list[ScoredDrive]:
    """Return the drives of a group of conditions."""
    return [one for one in drives if one.condition and one.condition.group == group]
