"""The result of an entry as one self-contained HTML page."""

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from zoo.benchmark.result import BenchmarkResult, DriveRecord
from zoo.benchmark.table import CAPTION, difference_lines, headline_line, table_cells
from zoo.report.report_page import hash_source
from zoo.runs.whole_file import write_whole

NAME = "benchmark.html"


def write_page(folder: Path, result: BenchmarkResult) -> Path:
    """Write `benchmark.html` and return its path."""
    parts = Path(__file__).parent / "static"
    environment = Environment(
        loader=FileSystemLoader(parts), autoescape=True, undefined=StrictUndefined
    )
    style = (parts / "style.css").read_text()
    headings, rows = table_cells(result)
    page = environment.get_template("page.html").render(
        policy=f"default-src 'none'; style-src {hash_source(style)}; "
        "base-uri 'none'; form-action 'none'",
        style=style,
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
