"""The figures of an entry as a table for the terminal and the page."""

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from zoo.base.terminal import printable
from zoo.benchmark.result import BenchmarkResult, DriveRecord, Interval
from zoo.benchmark.suite import LAPS
from zoo.runs.table_text import two_lines, with_interval

# Columns by key of a group's figures: heading, factor and format.
COLUMNS = {
    "autonomy": ("autonomy, %", 100, "{:.1f}"),
    "m_per_intervention": ("metres per intervention", 1, "{:,.0f}"),
    "cte_mean_m": ("mean error, m", 1, "{:.2f}"),
    "steering_per_s": ("steering change, 1/s", 1, "{:.2f}"),
    "without_intervention": ("drives without intervention (interval in %)", 100, "{:.0f}"),
}
DIFFERENCES = {
    "autonomy": ("autonomy, %-points", 100, "{:+.1f}"),
    "cte_mean_m": ("mean error, m", 1, "{:+.2f}"),
}

NAMES_WIDTH, GAP = 12, 3  # of the first column, and before every other one, in characters
INTERVALS = (
    "95 % interval. Means: bootstrap over roads and training seeds; counts: exact Poisson and "
    "Wilson. Fewer than 3 roads: no interval."
)
CAPTION = f"Below or behind each figure: its {INTERVALS}"


def print_result(result: BenchmarkResult, console: Console) -> None:
    """Print a table with a column for each group, the differences, headline and digest."""
    headings, rows = table_cells(result)
    columns = [[printable(name), *map(two_lines, cells)] for name, *cells in rows]
    tables = _side_by_side(columns, console.width - NAMES_WIDTH)
    for number, part in enumerate(tables, 1):
        title = f"{result.entry}, suite {result.suite}" if number == 1 else None
        shown = Table(
            title=None if title is None else Text(printable(title)),
            caption=CAPTION if number == len(tables) else " ",
            caption_justify="left",
            box=SIMPLE_HEAD,
            show_edge=False,
        )
        shown.pad_edge = False
        shown.add_column(headings[0], min_width=NAMES_WIDTH)
        for name, *_ in part:
            shown.add_column(Text(name), justify="right", no_wrap=True)
        for heading, *cells in zip(headings[1:], *(cells for _, *cells in part), strict=True):
            shown.add_row(heading, *cells)
        console.print(shown)
    lines = [
        *difference_lines(result),
        headline_line(result),
        f"digest of the drives: {result.digest}",
    ]
    for line in lines:
        console.print(printable(line), highlight=False, markup=False, soft_wrap=True)


def _side_by_side(columns: list[list[str]], width: int) -> list[list[list[str]]]:
    """Return columns in parts, each of which fits a width beside the names of its rows."""
    parts: list[list[list[str]]] = []
    room = 0
    for column in columns:
        wide = GAP + max(len(line) for cell in column for line in cell.split("\n"))
        if wide > room:
            parts.append([])
            room = width
        parts[-1].append(column)
        room -= wide
    return parts


def difference_lines(result: BenchmarkResult) -> list[str]:
    """Return a sentence for each shifted group: its difference to the clean partners."""
    lines = []
    for group, figures in result.differences.items():
        texts = [
            f"{heading}: {with_interval(figures[key], form, factor)}"
            for key, (heading, factor, form) in DIFFERENCES.items()
        ]
        line = f"{group} minus clean drives of the same roads: {'; '.join(texts)}"
        is_known = figures["autonomy"].low is not None
        lines.append(line if is_known else f"{line} (fewer than 3 roads: no interval)")
    return lines


def headline_line(result: BenchmarkResult) -> str:
    """Return the headline as a sentence."""
    seeds = len(result.checkpoints)
    trained = any(one.sha256 for one in result.checkpoints)
    by = f"{seeds} training seed{'' if seeds == 1 else 's'}"
    first = result.of_checkpoint(0)
    roads = sum(one.group != LAPS for one in first) or len(first)
    return (
        f"autonomy, interquartile mean over {roads} roads: "
        f"{with_interval(result.headline, '{:.1f}', 100)} %; "
        f"{by if trained else 'without training'}"
    )


def table_cells(result: BenchmarkResult) -> tuple[list[str], list[list[str]]]:
    """Return the headings, and a row of texts for each group."""
    headings = ["group", "drives", *(one for one, *_ in COLUMNS.values())]
    rows = []
    for group, figures in result.groups.items():
        drives = result.of_group(group)
        row = [group, str(len(drives))]
        row += [_cell(figures[key], key, drives) for key in COLUMNS]
        rows.append(row)
    return headings, rows


def _cell(figure: Interval, key: str, drives: Sequence[DriveRecord]) -> str:
    _, factor, form = COLUMNS[key]
    text = with_interval(figure, form, factor)
    if key != "without_intervention":
        return text
    kept = sum(not one.figures["interventions"] for one in drives)
    counted = f"{kept} of {len(drives)}"
    return counted if figure.low is None else f"{counted} ({text.partition('(')[2]}"
