"""The result of an entry as one self-contained HTML page."""

from pathlib import Path

from zoo.base.whole_file import write_whole
from zoo.benchmark.result import BenchmarkResult, DriveRecord
from zoo.benchmark.table import CAPTION, difference_lines, headline_line, table_cells
from zoo.runs.page import Page

NAME = "benchmark.html"


def write_page(folder: Path, result: BenchmarkResult) -> Path:
    """Write `benchmark.html` and return its path."""
    headings, rows = table_cells(result)
    page = Page(Path(__file__).parent / "static").render(
        result=result,
        lead=headline_line(result),
        headings=headings,
        rows=rows,
        differences=difference_lines(result),
        caption=CAPTION,
        drives=[_drive_cells(one) for one in result.drives],
    )
    return write_whole(folder / NAME, page)


def _drive_cells(drive: DriveRecord) -> list[str]:
    figures = drive.figures
    settings = ", ".join(f"{key}: {value}" for key, value in drive.settings.items())
    return [
        drive.group,
        drive.track,
        settings.replace("{", "").replace("}", "").replace("'", ""),
        str(drive.checkpoint + 1),
        f"{figures['autonomy']:.1%}",
        f"{figures['interventions']:.0f}",
        f"{figures['cte_mean_m']:.2f}",
        f"{figures['steering_per_s']:.2f}",
        drive.digest,
    ]
