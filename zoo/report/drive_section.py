"""The section on how it drives: figures, film, where it went, its worst moments."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from zoo.drives.drive_film import APART_S, FILM_NAME, MOMENTS
from zoo.report.blocks import (
    Block,
    Film,
    Fold,
    Heading,
    Missing,
    MissingError,
    Picture,
    Pictures,
    Rows,
    Text,
    gather,
)
from zoo.report.report_images import jpeg, read_frame
from zoo.report.reported_run import Run

if TYPE_CHECKING:
    from zoo.drives.drive_record import Drive

FILMS_BYTES = 10_000_000  # of all that are put into the page: a third more as text
SLOW_MACS = 1_000_000_000  # multiply-adds above which a saliency takes half a second
FEW = 3  # worst moments of a network that slow


def drive_blocks(run: Run) -> list[Block]:
    """Figures of all drives, then each track's film, plots and worst moments."""
    return gather((_scores, _tracks, _in_training), run)


def _scores(run: Run) -> list[Block]:
    from zoo.evaluate.drives_table import drives_table

    if not run.tracks:
        if "score" in run.choices and run.choices["score"] == "none":
            raise MissingError("The run was not driven (score=none): its figures are open-loop.")
        raise MissingError(
            "Nothing was driven. python -m zoo.evaluate scores the checkpoint by driving."
        )
    scored = run.metrics.get("drive") or {}
    how = "In the embedded simulator, in simulated time"
    if scored.get("speed_mph"):
        laps, seeds = scored["laps"], scored["seeds"]
        how += (
            f", at {scored['speed_mph']:g} mph, {laps:g} lap{'' if laps == 1 else 's'} with "
            f"{seeds} start seed{'' if seeds == 1 else 's'}"
        )
    return [
        Text(
            f"{how}. Autonomy is NVIDIA's: 1 - 6 s x interventions / time driven; an intervention "
            "is a car that leaves its lane or stands still, and puts it back on the centre. "
            "A start seed draws the start and a random weather. ± is the sample standard deviation "
            "over the drives' start seeds: it says nothing on how much another training would "
            "change. In brackets, Wilson's 95 % interval. The same start seed gives the same "
            "figures to the digit, latency apart."
        ),
        Rows.of(drives_table(run.tracks), bold=frozenset({0})),
    ]


def _tracks(run: Run) -> list[Block]:
    blocks: list[Block] = [Missing(f"A drive cannot be read: {one}.") for one in run.damaged_drives]
    if run.tracks and not run.drives:
        missing = Missing("The drives themselves are not in the run's folder any more.")
        return blocks or [missing]
    left = FILMS_BYTES
    for track in dict.fromkeys(drive.summary["track"] for drive in run.drives):
        drives = [drive for drive in run.drives if drive.summary["track"] == track]
        first = drives[0]
        blocks.append(Heading(f"The drive on the {track}"))
        film = _film(run, first.folder / FILM_NAME, left)
        left -= len(film.data or b"") if isinstance(film, Film) else 0
        blocks.append(film)
        blocks += _plots(first)
        if drives[1:]:
            others: list[Block] = []
            for drive in drives[1:]:
                others += _plots(drive)
            blocks.append(Fold(f"The other start seeds: {len(drives) - 1}", others))
        try:
            blocks += _worst(run, track, drives)
        except MissingError as missing:
            blocks.append(Missing(str(missing)))
    return blocks


def _film(run: Run, path: Path, budget: int) -> Block:
    if not path.is_file():
        return Missing("The drive was not filmed (score.film=false, or film=true was not given).")
    speed = (run.config.get("score") or {}).get("film_speed") or 1
    said = "The drive, filmed while it was scored"
    if speed > 1:
        said += f"; it plays {speed:g} times as fast as it was driven"
    size = path.stat().st_size
    if size > budget:
        return Film(path, f"{said}. With {size / 1e6:.0f} MB it is kept beside this page.")
    return Film(path, f"{said}.", path.read_bytes())


def _plots(drive: "Drive") -> list[Block]:
    captions = {
        "track": "Where it drove, coloured by how far off the centreline; crosses: interventions.",
        "error": "How far off the centreline, metre by metre; the lane is shaded.",
    }
    pictures = []
    for plot, caption in captions.items():
        path = drive.folder / f"{plot}.png"
        if path.is_file():
            # Turned over for a dark page, large errors would be the darkest colours on the track.
            name = _name(drive, path.name)
            pictures.append(Picture(name, path.read_bytes(), caption, plot=plot != "track"))
    return [Pictures([one]) for one in pictures]


def _name(drive: "Drive", file: str) -> str:
    """A file of a drive, beside those of others: a track's own name may hold anything."""
    return f"{drive.folder.name}_{file}"


def _worst(run: Run, track: str, drives: "list[Drive]") -> list[Block]:
    """The worst moments of a track's drives, each beside what the network looks at."""
    from zoo.checkpoints.policy import Policy
    from zoo.models.network_facts import multiply_adds
    from zoo.saliency.visual_backprop import Saliency, overlay

    found = [(drive, row) for drive in drives for row in worst_rows(drive)]
    if not found:
        raise MissingError("The drive kept no picture of its worst moments.")
    found.sort(key=lambda one: _badness(*one), reverse=True)
    checkpoint = run.checkpoint
    height, width, channels = checkpoint.view.shape
    count = MOMENTS
    if multiply_adds(checkpoint.network, (channels, height, width)) > SLOW_MACS:
        count = FEW
    saliency = Saliency(Policy(checkpoint))
    pictures = []
    for number, (drive, row) in enumerate(found[:count], 1):
        frame = read_frame(drive.folder / str(drive.frame[row]))
        where = saliency(frame, float(drive.speed_mph[row]))
        pair = np.hstack([frame, overlay(frame, where)])
        name = _name(drives[0], f"worst_{number}.jpg")
        pictures.append(jpeg(name, pair, _moment(drive, row, len(drives))))
    return [
        Heading(f"The worst moments on the {track}"),
        Text(
            "Interventions first, then what was furthest from the centreline, "
            f"{APART_S:g} s apart or more. At the right, in green, what the steering depends on."
        ),
        Pictures(pictures, columns=2),
    ]


def worst_rows(drive: "Drive") -> list[int]:
    """Rows of a `Drive` whose picture was kept, the worst first, `APART_S` apart or more."""
    rows = [int(row) for row in np.flatnonzero(drive.frame != "")]
    rows = [row for row in rows if np.isfinite(drive.cross_track_m[row])]
    chosen: list[int] = []
    for row in sorted(rows, key=lambda one: _badness(drive, one), reverse=True):
        if all(abs(drive.time_s[row] - drive.time_s[other]) >= APART_S for other in chosen):
            chosen.append(row)
    return chosen[:MOMENTS]


def _badness(drive: "Drive", row: int) -> tuple[bool, float]:
    return bool(drive.intervention[row]), abs(float(drive.cross_track_m[row]))


def _moment(drive: "Drive", row: int, drives: int) -> str:
    error = float(drive.cross_track_m[row])
    said = [
        f"{drive.time_s[row]:.1f} s"
        + (f", start seed {drive.summary['seed']}" if drives > 1 else ""),
        f"{abs(error):.2f} m {'right' if error > 0 else 'left'}",
        f"steering {drive.steering[row] + 0.0:+.2f}",
        f"{drive.speed_mph[row]:.0f} mph",
    ]
    return ("Intervention. " if drive.intervention[row] else "") + ", ".join(said)


def _in_training(run: Run) -> list[Block]:
    found = run.metrics.get("closed_loop")
    if not found:
        return []
    return [
        Heading("While training"),
        Text(
            f"The closed-loop callback drove {found['metres']:g} m of the {found['track']} with "
            f"the best weights: autonomy {found['autonomy']:.1%}, {found['interventions']} "
            f"interventions, {found['cte_mean']:.2f} m off the centreline on average."
        ),
    ]
