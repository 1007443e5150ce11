"""The result of one job of a sweep as a line."""

from pathlib import Path

from zoo.leaderboard.ranking import read_run
from zoo.runs.status import read_status


def result_text(folder: Path) -> str:
    """Return how the job in a folder ended: its figures, or the reason of its failure."""
    status = read_status(folder)
    run = read_run(folder) if status.get("status") == "finished" else None
    if run is None:
        return ": ".join(filter(None, [status.get("status"), status.get("reason")]))
    figures = [] if run.autonomy is None else [f"autonomy {run.autonomy:.1%}"]
    figures += [] if run.val_mse is None else [f"val MSE {run.val_mse:.4f}"]
    return f"finished in {run.wall_s:.0f} s" + "".join(f", {one}" for one in figures)
