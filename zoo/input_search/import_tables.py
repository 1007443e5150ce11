"""Tables and lines that `drivezoo import` prints."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from zoo.input_search.combinations import Combination
from zoo.input_search.judgement import Judgement
from zoo.input_search.tied_drives import STRETCH
from zoo.input_search.trials import Trial
from zoo.keras.keras_layers import LayerNote
from zoo.runs.fitted_table import fitted_table
from zoo.runs.table import Table as Columns

SHOWN = 10  # most rows of the table of trials


def architecture_table(name: str, notes: Sequence[LayerNote], width: int) -> Table:
    """Return the file's layers, and what was understood of each."""
    total = sum(one.parameters for one in notes)
    rows = [
        (
            *(str(one.position), one.name, one.kind),
            one.understood.removeprefix(one.kind).strip(),
            " x ".join(map(str, one.shape)),
            f"{one.parameters:,}",
        )
        for one in notes
    ]
    columns = Columns.of(["", "name", "layer", "understood", "output", "parameters"], rows).columns
    title = f"{name}: {len(notes)} layers, {total:,} parameters"
    return fitted_table(title, columns[:4], columns[4:], width, first=2)[0]


def input_table(found: Combination, sources: dict[str, str], width: int) -> Table:
    """Return the parts of the network's input, and where each came from."""
    view = found.view
    height, columns, _ = view.shape
    divisor, less = found.scale
    values = {
        "colour": view.colour,
        "crop": f"{view.crop[0]} rows at the top, {view.crop[1]} at the bottom",
        "size": f"{height} x {columns}",
        "resize": view.resize if view.size else "-",
        "scale": f"pixel / {divisor:g} - {less:g}",
    }
    rows = [(key, value, sources[key]) for key, value in values.items()]
    columns = Columns.of(["input", "value", "from"], rows).columns
    return fitted_table("what the network sees", columns, [], width)[0]


def trials_table(judged: Judgement, width: int) -> Table:
    """Return the best trials, the chosen one first, the others from the highest score."""
    others = [one for one in judged.trials.finalists if one is not judged.best]
    shown = [judged.best, *others][:SHOWN]
    rows = [
        (
            one.combination.view.colour,
            "{},{}".format(*one.combination.view.crop),
            one.combination.view.resize if one.combination.view.size else "-",
            "{:g},{:g}".format(*one.combination.scale),
            *map(_figure, (one.agreement, one.correlation, one.recovery)),
        )
        for one in shown
    ]
    headings = ["colour", "crop", "resize", "scale", "agreement", "correlation", "recovery"]
    *names, scale, _, _, _ = columns = Columns.of(headings, rows).columns
    if len(set(scale.cells)) > 1:  # else the file or the user tells it
        names.append(scale)
    frames = len(shown[0].steering)
    title = f"the best of the inputs tried, on {frames} frames in bends"
    return fitted_table(title, names, columns[4:], width, first=2)[0]


def print_judgement(judged: Judgement, console: Console) -> None:
    """Print whether the best input is convincing, and which others may be right."""
    best = judged.best
    if judged.doubts:
        lines = [
            "no input is convincing; the best is taken, but",
            *(f"- {one}" for one in judged.doubts),
            "was the network trained to steer by one image, on a track as in this recording? Name "
            "a recording of that track, or set colour=, crop= and scale= if you know them",
        ]
    else:
        lines = [
            f"convincing: correlation {best.correlation:.2f} with the recorded steering; "
            f"by chance, the best of all inputs reaches {judged.chance:.2f} (99 %)"
        ]
    if judged.next:
        margin, what = best.score - judged.next.score, "agreement"
        what = "correlation of all cameras" if best.free_scale else what
        lines.append(
            f"the next input that is worse for certain: {_difference(best, judged.next)}, "
            f"{what} lower by {margin:.3f}"
        )
    for one in judged.driven:
        drove = "drove" if one.kept else "left the lane after"
        lines.append(
            f"{drove} {one.driven_m:.0f} m of {STRETCH.track} at {STRETCH.speed:g} mph, "
            f"{one.cte_mean_m:.2f} m from the centreline: {one.trial.combination.text()}"
        )
    if judged.alike:
        alike = "; ".join(_difference(best, one) for one in judged.alike)
        lines.append(f"steers the same, so the difference does not matter: {alike}")
    if judged.tied:
        tied = "; ".join(_difference(best, one) for one in judged.tied)
        lines.append(f"too near to tell apart, but steers differently; try by driving: {tied}")
    for line in lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def _difference(best: Trial, other: Trial) -> str:
    """Return the keys in which another combination differs from the best."""
    own = best.combination.text().split()
    return " ".join(one for one in other.combination.text().split() if one not in own)


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
