"""Tables and lines that `drivezoo import` prints."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from zoo.base.terminal import command_line
from zoo.extras.keras.combinations import Combination
from zoo.extras.keras.judgement import Driven, Judgement
from zoo.extras.keras.keras_layers import LayerNote
from zoo.extras.keras.tied_drives import STRETCH
from zoo.extras.keras.trials import Trial
from zoo.runs.result_table import Table as Columns
from zoo.runs.result_table import fitted_table

SHOWN = 10  # most rows of the table of trials


def architecture_table(name: str, notes: Sequence[LayerNote], width: int) -> Table:
    """Return the file's layers, and what was understood of each."""
    total = sum(note.parameters for note in notes)
    rows = [
        (
            *(str(note.position), note.name, note.kind),
            note.understood.removeprefix(note.kind).strip(),
            " x ".join(map(str, note.shape)),
            f"{note.parameters:,}",
        )
        for note in notes
    ]
    columns = Columns.of(["", "name", "layer", "understood", "output", "parameters"], rows).columns
    title = f"{name}: {len(notes)} layers, {total:,} parameters"
    return fitted_table(title, columns[:4], columns[4:], width, first=2)[0]


def input_table(
    chosen: Combination, line: tuple[float, float] | None, sources: dict[str, str], width: int
) -> Table:
    """Return the parts of the network's input and the line of its output, with their origins."""
    view = chosen.view
    height, width_px, _ = view.shape
    divisor, less = chosen.scale
    values = {
        "colour": view.colour,
        "crop": f"{view.crop[0]} of 160 rows at the top, {view.crop[1]} at the bottom",
        "size": f"{height} x {width_px}",
        "resize": view.resize if view.size else "-",
        "scale": f"pixel / {divisor:g} - {less:g}",
    }
    if line is not None:
        values["steering"] = line_text(line)
    rows = [(key, value, sources[key]) for key, value in values.items()]
    columns = Columns.of(["input", "value", "from"], rows).columns
    return fitted_table("what the network sees", columns, [], width)[0]


def line_text(line: tuple[float, float]) -> str:
    """Return the formula of a straight line.

    >>> line_text((2.4, -1.2))
    '2.4 x output - 1.2'
    """
    factor, offset = line
    return f"{factor:.3g} x output {'-' if offset < 0 else '+'} {abs(offset):.3g}"


def trials_table(judged: Judgement, width: int) -> Table:
    """Return the best trials, the chosen one first, the others from the highest score."""
    others = [finalist for finalist in judged.trials.finalists if finalist is not judged.best]
    shown = [judged.best, *others][:SHOWN]
    rows = [
        (
            trial.combination.view.colour,
            "{},{}".format(*trial.combination.view.crop),
            trial.combination.view.resize if trial.combination.view.size else "-",
            "{:g},{:g}".format(*trial.combination.scale),
            *map(_figure, (trial.agreement, trial.correlation, trial.recovery)),
        )
        for trial in shown
    ]
    headings = ["colour", "crop", "resize", "scale", "agreement", "correlation", "recovery"]
    *names, scale, _, _, _ = columns = Columns.of(headings, rows).columns
    if len(set(scale.cells)) > 1:  # else the file or the user tells it
        names.append(scale)
    title = f"the best of the inputs tried, on {len(shown[0].steering)} frames in bends"
    return fitted_table(title, names, columns[4:], width, first=2)[0]


def print_judgement(
    judged: Judgement, line: tuple[float, float], again: Sequence[object], console: Console
) -> None:
    """Print what the network saw, how it drives, and which other inputs may be right.

    Args:
        judged: judgement of the search.
        line: straight line from the file's output to the recorded steering.
        again: words of the command, which a key for the line is added to.
        console: console to print on.
    """
    best = judged.best
    saw = f"what it saw: {best.combination.text()}"
    if judged.doubts:
        lines = [f"{saw}, the best of those tried, but not certain: {'; '.join(judged.doubts)}"]
    else:
        lines = [
            f"{saw}: correlation {best.correlation:.2f} with the recorded steering; by chance, "
            f"the best of all inputs reaches {judged.chance:.2f} (99 %)"
        ]
    lines.append(f"how it drives: {_drive(judged.driven[0]) if judged.driven else 'not tried'}")
    if abs(best.correlation) > judged.chance:
        lines.append(f"straight line to the recorded steering: steering = {line_text(line)}")
        if not best.means_steering:
            key = "steering=[{:.3g},{:.3g}]".format(*line)
            lines.append(
                "its output may mean something else than steering of -1..1, such as degrees or "
                "0..1: set steering=[factor,offset] as its program computes the steering from it, "
                f"or try the line: {command_line([*again, key])}"
            )
    if judged.doubts or not all(drive.kept for drive in judged.driven[:1]):
        lines.append(
            "was it trained to steer by one image, on a track as in this recording? Name a "
            "recording of that track, or set the keys that you know. No key cuts off columns, "
            "finds edges (Canny), blurs over more than 3 x 3 pixels or scales each image by its "
            "own pixels: what such a program computes must stand in a function of your own, "
            "given to drivezoo.evaluate"
        )
    if judged.next:
        lines.append(
            f"the next input that is worse for certain: {_difference(best, judged.next)}, "
            f"correlation of all cameras lower by {best.score - judged.next.score:.3f}"
        )
    for drive in judged.driven[1:]:
        lines.append(f"{_drive(drive)}: {drive.trial.combination.text()}")
    if judged.alike:
        alike = "; ".join(_difference(best, trial) for trial in judged.alike)
        lines.append(f"steers the same, so the difference does not matter: {alike}")
    if judged.tied:
        tied = "; ".join(_difference(best, trial) for trial in judged.tied)
        lines.append(f"too near to tell apart, but steers differently; try by driving: {tied}")
    for text in lines:
        console.print(text, highlight=False, markup=False, soft_wrap=True)


def _drive(driven: Driven) -> str:
    """Return a text on how well an input drove."""
    drove = "kept the lane over" if driven.kept else "left the lane after"
    return (
        f"{drove} {driven.driven_m:.0f} m of {STRETCH.track} at {STRETCH.speed:g} mph, "
        f"{driven.cte_mean_m:.2f} m from the centreline"
    )


def _difference(best: Trial, other: Trial) -> str:
    """Return the keys in which another combination differs from the best."""
    keys = best.combination.text().split()
    return " ".join(key for key in other.combination.text().split() if key not in keys)


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
