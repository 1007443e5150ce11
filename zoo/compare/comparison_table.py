"""A comparison as a table and lines for the terminal."""

import math
from collections.abc import Mapping

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from datamodules.terminal import printable
from zoo.compare.differences import A_BETTER, CANNOT_TELL, OVERALL, Comparison, Needed, verdict_on
from zoo.compare.paired_drives import Entry
from zoo.drives.bootstrap import Estimate

CAPTION = (
    "Below each figure: its 95 % interval (bootstrap over roads and training seeds). Each verdict "
    "is by autonomy and for its row alone: one of 20 equal pairs is told apart by chance. To tell: "
    "training seeds of each entry that would decide with a probability of 80 %."
)
HEADINGS = (
    "group",
    "drives",
    "autonomy,\npoints",
    "mean error,\nm",
    "A better,\n%",
    "verdict,\nto tell",
)
NEEDED = {
    "decided": "",
    "equal": "equal",
    "roads": "more roads",
    "many": ">100 seeds",
    "unknown": "more seeds",
}
ADVICE = {
    "equal": "both have the same autonomy, so no number of training seeds can be named; use a "
    "suite of harder roads",
    "roads": "to tell: more roads, because the difference varies too much between these; more "
    "training seeds would not decide",
    "many": "more than 100 training seeds of each entry would be needed to tell",
    "unknown": (
        "how many training seeds would be needed cannot be estimated from one training seed; "
        "benchmark three or more of each entry"
    ),
}


def print_comparison(
    a: Entry, b: Entry, comparisons: Mapping[str, Comparison], console: Console
) -> None:
    """Print a row for each group, then the verdict, its limits and the training seeds needed."""
    table = Table(title="A minus B", caption=CAPTION, box=SIMPLE_HEAD, show_edge=False)
    table.caption_justify = "left"
    first, *figures, last = HEADINGS
    table.add_column(first, no_wrap=True)
    for heading in figures:
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column(last, justify="right", min_width=10)
    for group, *cells in comparison_cells(comparisons):
        table.add_row(Text(printable(group)), *cells)
    for name, entry in (("A", a), ("B", b)):
        seeds = f"{entry.seeds} training seed{'' if entry.seeds == 1 else 's'}"
        how = seeds if entry.is_trained else "a baseline without training"
        _print(f"{name}: {entry.result.entry}, {how} ({entry.path})", console)
    console.print(table)
    for line in conclusion(a, b, comparisons):
        _print(line, console)


def comparison_cells(comparisons: Mapping[str, Comparison]) -> list[list[str]]:
    """Return the texts of each group's row, those of figures in two lines."""
    return [
        [
            group,
            str(one.roads),
            two_lines(one.autonomy, "{:+.1f}", 100),
            two_lines(one.cte_mean_m, "{:+.2f}"),
            two_lines(one.a_better, "{:.0f}", 100),
            f"{one.verdict.replace(' drives', '')}\n{needed_text(one.needed)}",
        ]
        for group, one in comparisons.items()
    ]


def conclusion(a: Entry, b: Entry, comparisons: Mapping[str, Comparison]) -> list[str]:
    """Return the verdict over all groups, what limits it, and the training seeds needed."""
    name, overall = next(reversed(comparisons.items()))
    where = f"{overall.roads} roads" + ("" if name == OVERALL else f" of group {name}")
    figures = f"autonomy {percent(overall.a)} and {percent(overall.b)} on {where}"
    lines = [f"verdict: {overall.verdict} ({figures})"]
    if (nearer := verdict_on(overall.cte_mean_m)) != CANNOT_TELL:
        name = "B" if nearer == A_BETTER else "A"  # A_BETTER: A's error is greater
        metres = two_lines(overall.cte_mean_m, "{:+.2f}").replace("\n", " m, 95 %: ")
        lines.append(f"mean error: {name} stays nearer to the centre ({metres} m)")
    if single := [one for one in (a, b) if one.seeds == 1 and one.is_trained]:
        named = " and ".join(one.result.entry for one in single)
        lines.append(
            f"{named}: one training seed: the intervals leave out how trainings differ, so another "
            "training may drive better or worse"
        )
    if a.result.code.get("hash") != b.result.code.get("hash"):
        lines.append("A and B were driven by different versions of the code; drive both with one")
    if overall.verdict == CANNOT_TELL:
        lines.append(advice(overall.needed))
    return lines


def advice(needed: Needed) -> str:
    """Return a sentence on the training seeds needed.

    >>> advice(Needed(7, "seeds"))
    'to tell: about 7 training seeds of each entry, a rough number from the variance of these'
    """
    if needed.seeds is None:
        return ADVICE[needed.reason]
    return (
        f"to tell: about {needed.seeds} training seeds of each entry, a rough number from the "
        "variance of these"
    )


def needed_text(needed: Needed) -> str:
    """Return what would decide, in a few words; nothing where it is decided."""
    return NEEDED[needed.reason] if needed.seeds is None else f"{needed.seeds} seeds"


def two_lines(figure: Estimate, form: str, factor: float = 1) -> str:
    r"""Return a figure, multiplied by a factor, with its interval in a second line.

    >>> two_lines(Estimate(0.1, -0.05, 0.25), "{:+.0f}", 100)
    '+10\n-5..+25'
    """
    value, low, high = (
        form.format(factor * one) for one in (figure.value, figure.low, figure.high)
    )
    return f"{value}\n{'no interval' if math.isnan(figure.low) else f'{low}..{high}'}"


def percent(figures: Mapping[str, float]) -> str:
    """Return the autonomy in percent."""
    return f"{figures['autonomy']:.1%}"


def _print(line: str, console: Console) -> None:
    console.print(printable(line), highlight=False, markup=False, soft_wrap=True)
