"""What a guard prevented: the same drives with it and without it."""

from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np

from zoo.drives.bootstrap import Estimate, bootstrap, mean
from zoo.runs.table import with_interval
from zoo.worlds.scenario import Scenario


def unguarded(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """Return scenarios without their guard; none where there is no guard."""
    return [replace(one, guard=None) for one in scenarios if one.guard]


def guard_effect(guard: str, guarded: Sequence[dict], without: Sequence[dict]) -> dict:
    """Return the effect of a guard.

    Args:
        guard: path of the guard file.
        guarded: figures of the drives with the guard.
        without: figures of the same drives without it.

    Returns:
        Alarms, interventions and mean speed with and without the guard, and the interventions that
        it prevented per drive, with a 95 % interval over three tracks or more.
    """
    lost, lost_without = (
        np.array([one["interventions"] for one in drives], float) for drives in (guarded, without)
    )
    tracks = np.array([one["track"] for one in guarded])
    by_track = [(lost_without - lost)[tracks == one].mean() for one in dict.fromkeys(tracks)]
    return {
        "guard": guard,
        "alarms": sum(one["guard_alarms"] for one in guarded),
        "interventions": int(lost.sum()),
        "interventions_without": int(lost_without.sum()),
        "prevented_per_drive": asdict(bootstrap(np.array([by_track]), mean)),
        "speed_mph": float(np.mean([one["speed_mph"] for one in guarded])),
        "speed_mph_without": float(np.mean([one["speed_mph"] for one in without])),
    }


def guard_line(effect: dict) -> str:
    """Return a sentence about the effect of a guard."""
    prevented = with_interval(Estimate(**effect["prevented_per_drive"]), "{:.2f}")
    return (
        f"guard: {effect['alarms']} alarms; interventions {effect['interventions']} with it, "
        f"{effect['interventions_without']} without it; prevented per drive: {prevented}; mean "
        f"speed {effect['speed_mph']:.1f} instead of {effect['speed_mph_without']:.1f} mph"
    )
