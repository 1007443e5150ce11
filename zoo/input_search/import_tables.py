"""Tables and lines that `drivezoo import` prints."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from zoo.checkpoints.keras_layers import LayerNote
from zoo.cli.fitted_table import Cells, fitted_table
from zoo.input_search.combinations import Combination
from zoo.input_search.judgement import Judgement
from zoo.input_search.trials import Trial, Trials

SHOWN = 10  # most rows of the table of trials


def architecture_table(name: str, notes: Sequence[LayerNote], width: int) -> Table:
    """Return the file's layers, and what was understood of each."""
    total = sum(one.parameters for one in notes)
    names = [
        Cells("", tuple(str(one.position) for one in notes), "right"),
        Cells("name", tuple(one.name for one in notes)),
        Cells("layer", tuple(one.kind for one in notes)),
        Cells("understood", tuple(one.understood.removeprefix(one.kind).strip() for one in notes)),
    ]
    figures = [
        Cells("output", tuple(" x ".join(map(str, one.shape)) for one in notes), "right"),
        Cells("parameters", tuple(f"{one.parameters:,}" for one in notes), "right"),
    ]
    title = f"{name}: {len(notes)} layers, {total:,} parameters"
    return fitted_table(title, names, figures, width, first=2)[0]


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
    names = [
        Cells("input", tuple(values)),
        Cells("value", tuple(values.values())),
        Cells("from", tuple(sources[key] for key in values)),
    ]
    return fitted_table("what the network sees", names, [], width)[0]


def trials_table(trials: Trials, judged: Judgement, width: int) -> Table:
    """Return the best trials, the chosen one first, the others from the highest score."""
    others = [one for one in trials.finalists if one is not judged.best]
    shown = [judged.best, *others][:SHOWN]
    names = [
        Cells("colour", tuple(one.combination.view.colour for one in shown)),
        Cells("crop", tuple("{},{}".format(*one.combination.view.crop) for one in shown)),
        Cells("resize", tuple(_resize(one) for one in shown)),
    ]
    scales = tuple("{:g},{:g}".format(*one.combination.scale) for one in shown)
    if len(set(scales)) > 1:  # else the file or the user tells it
        names.append(Cells("scale", scales))
    figures = [
        _figures("agreement", [one.score for one in shown]),
        _figures("correlation", [one.correlation for one in shown]),
        _figures("recovery", [one.recovery for one in shown]),
    ]
    frames = len(shown[0].steering)
    title = f"the best of {len(trials.coarse)} inputs tried, on {frames} frames in bends"
    return fitted_table(title, names, figures, width, first=2)[0]


def print_judgement(judged: Judgement, console: Console) -> None:
    """Print whether the best input is convincing, and which others may be right."""
    best = judged.best
    if judged.doubts:
        lines = ["no input is convincing; the best is taken, but", *_bullets(judged.doubts)]
        lines += [
            "was the network trained to steer by one image, on a track as in this recording? Name "
            "a recording of that track, or set colour=, crop= and scale= if you know them"
        ]
    else:
        lines = [
            f"convincing: correlation {best.correlation:.2f} with the recorded steering; "
            f"by chance, the best of all inputs reaches {judged.chance:.2f} (99 %)"
        ]
    if judged.next:
        margin = best.score - judged.next.score
        lines.append(
            f"the next input that is worse for certain: {_difference(best, judged.next)}, "
            f"agreement lower by {margin:.3f}"
        )
    if judged.alike:
        alike = "; ".join(_difference(best, one) for one in judged.alike)
        lines.append(f"steers the same, so the difference does not matter: {alike}")
    if judged.tied:
        tied = "; ".join(_difference(best, one) for one in judged.tied)
        lines.append(f"too near to tell apart, but steers differently; try by driving: {tied}")
    for line in lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def _bullets(texts: Sequence[str]) -> list[str]:
    return [f"- {one}" for one in texts]


def _difference(best: Trial, other: Trial) -> str:
    """Return the keys in which another combination differs from the best."""
    own = best.combination.text().split()
    return " ".join(one for one in other.combination.text().split() if one not in own)


def _resize(trial: Trial) -> str:
    return trial.combination.view.resize if trial.combination.view.size else "-"


def _figures(heading: str, values: Sequence[float | None]) -> Cells:
    cells = tuple("-" if one is None else f"{one:.3f}" for one in values)
    return Cells(heading, cells, "right")
