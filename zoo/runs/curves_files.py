"""Read `metrics*.csv`: a run's losses and driving figures by epoch."""

import csv
import itertools
from collections.abc import Iterable
from pathlib import Path

from zoo.base.errors import InputError
from zoo.base.regular_file import open_text

MOST_BYTES = 64_000_000


def read_curves(folder: Path, names: Iterable[str]) -> dict[str, dict[int, float]]:
    """Return the named columns of a run's `metrics*.csv` by epoch; 1 is the first epoch.

    A resumed run repeats an interrupted epoch; the later figure counts.

    Raises:
        InputError: a file cannot be read, or a row is damaged.
    """
    curves: dict[str, dict[int, float]] = {}
    numbered = [
        path for path in folder.glob("metrics.*.csv") if path.stem.split(".")[1].isdecimal()
    ]
    earlier = sorted(numbered, key=lambda path: int(path.stem.split(".")[1]))
    for path in [*earlier, folder / "metrics.csv"]:
        if path.exists():
            _add_file(path, names, curves)
    return curves


def _add_file(path: Path, names: Iterable[str], curves: dict[str, dict[int, float]]) -> None:
    with open_text(path, MOST_BYTES) as file:
        rows = csv.DictReader(file)
        for line in itertools.count(2):
            try:
                row = next(rows, None)
                if row is None:
                    return
                for name in names:
                    if row.get(name):
                        epoch = int(row.get("epoch") or "none") + 1
                        curves.setdefault(name, {})[epoch] = float(row[name])
            except (csv.Error, ValueError, TypeError) as error:
                reason = " ".join(str(error).split())[:80]
                raise InputError(f"{path}, row {line}: cannot be read ({reason})") from None
