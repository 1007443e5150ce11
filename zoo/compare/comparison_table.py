"""A comparison as a table and lines for the terminal."""

from collections.abc import Mapping

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from zoo.base.terminal import printable
from zoo.compare.differences import A_BETTER, CANNOT_TELL, OVERALL, Comparison, Needed, verdict_on
from zoo.compare.paired_drives import Entry
from zoo.drives.bootstrap import Estimate
from zoo.runs.table_text import known, two_lines, with_interval

INTERVALS = (
    "95 % interval (bootstrap over roads and training seeds), from three roads on. Each verdict "
    "is by autonomy and for its row alone: one of 20 equal pairs is told apart by chance. To tell: "
    "training seeds of each entry that would decide with a probability of 80 %."
)
CAPTION = f"Below each figure: its {INTERVALS}"
HEADINGS = {
    "group": "group",
    "roads": "drives",
    "autonomy": "autonomy,\npoints",
    "cte_mean_m": "mean error,\nm",
    "a_better": "A better,\n%",
    "verdict": "verdict,\nto tell",
}
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
    "roads": "to tell: more roads, three or more, because the difference varies too much between "
    "these; more training seeds would not decide",
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
    first, *figures, last = HEADINGS.values()
    table.add_column(first, no_wrap=True)
    for heading in figures:
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column(last, justify="right", min_width=10)
    for group, *cells in comparison_cells(comparisons):
        table.add_row(Text(printable(group)), *map(two_lines, cells))
    for name, entry in (("A", a), ("B", b)):
        seeds = f"{entry.seeds} training seed{'' if entry.seeds == 1 else 's'}"
        how = seeds if entry.is_trained else "a baseline without training"
        _print(f"{name}: {entry.result.entry}, {how} ({entry.path})", console)
    console.print(table)
    for line in conclusion(a, b, comparisons):
        _print(line, console)


def comparison_cells(comparisons: Mapping[str, Comparison]) -> list[list[str]]:
    """Return the texts of each group's row."""
    return [
        [
            group,
            str(one.roads),
            _estimate(one.autonomy, "{:+.1f}", 100),
            _estimate(one.cte_mean_m, "{:+.2f}"),
            _estimate(one.a_better, "{:.0f}", 100),
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
        metres = two_lines(_estimate(overall.cte_mean_m, "{:+.2f}"))
        metres = metres.replace("\n", " m, 95 %: ")
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


def _estimate(figure: Estimate, form: str, factor: float = 1) -> str:
    """Return a figure, multiplied by a factor, with its interval."""
    text = with_interval(figure, form, factor)
    return f"{text} (no interval)" if known(figure.low) is None else text


def percent(figures: Mapping[str, float]) -> str:
    """Return the autonomy in percent."""
    return f"{figures['autonomy']:.1%}"


def _print(line: str, console: Console) -> None:
    console.print(printable(line), highlight=False, markup=False, soft_wrap=True)
