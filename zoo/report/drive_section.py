"""The section on driving: figures, film, path and worst moments."""

import numpy as np

from datamodules.image import read_image
from zoo.base.errors import InputError
from zoo.checkpoints.policy import CheckpointPolicy
from zoo.drives.drive_film import APART_S, FILM_NAME, MOMENTS
from zoo.drives.drive_record import Drive
from zoo.drives.drives_table import drives_table
from zoo.drives.intervals import ONE_TRACK
from zoo.report.blocks import Block, Film, Fold, Heading, Image, Images, Missing, Rows, Text
from zoo.report.reported_run import ReportedRun
from zoo.saliency.visual_backprop import Saliency, overlay
from zoo.verdict.evidence import no_verdict, source_of

FILMS_BYTES = 10_000_000  # total of films embedded in the page; base64 adds a third
PLOTS = {
    "track": "The car's path, coloured by cross-track error. Crosses mark interventions.",
    "error": "Cross-track error along the track. The lane is shaded.",
}


def scores(run: ReportedRun) -> list[Block]:
    """Return the figures of all drives."""
    if not run.tracks:
        source = source_of(run.metrics.get("data"))
        remedy = no_verdict(source) if source else "drive its checkpoint with drivezoo evaluate"
        why = run.metrics.get("not_replayed") or "score=none"
        raise InputError(f"Not driven, only open-loop figures ({why}); {remedy}.")
    scored = run.metrics.get("drive") or {}
    keys = [f"{key}={scored[key]:g}" for key in ("speed_mph", "laps", "seeds") if scored.get(key)]
    where = f"Driven in the embedded simulator, in simulated time: {', '.join(keys)}."
    if run.replayed:
        where = f"Judged by NVIDIA's method: {run.replayed}, each frame warped to the steered car."
    return [
        Text(
            f"{where} Autonomy is NVIDIA's measure: 1 - 6 s x interventions / driving time. An "
            "intervention puts a car that left its lane (in a replay, the recorded path) or stands "
            "still back on the centreline. ± is the sample standard deviation over start seeds, "
            f"not over trainings. {ONE_TRACK}"
        ),
        Rows(drives_table(run.tracks), bold=frozenset({0})),
    ]


def tracks(run: ReportedRun) -> list[Block]:
    """Return each track's film, plots and worst moments."""
    blocks: list[Block] = [Missing(f"A drive cannot be read: {one}.") for one in run.damaged_drives]
    if run.tracks and not run.drives and not blocks:
        raise InputError("The run's folder no longer holds the drives.")
    left = FILMS_BYTES
    for track in dict.fromkeys(drive.track for drive in run.drives):
        drives = [drive for drive in run.drives if drive.track == track]
        film = _film(drives[0], left)
        left -= len(film.data or b"") if isinstance(film, Film) else 0
        blocks += [Heading(f"Drive on the {track}"), film, *_plots(drives[0])]
        if others := [block for drive in drives[1:] for block in _plots(drive)]:
            blocks.append(Fold(f"Drives with other start seeds: {len(drives) - 1}", others))
        try:
            blocks += _worst(run, track, drives)
        except (InputError, OSError) as missing:
            blocks.append(Missing(str(missing)))
    return blocks


def _film(drive: Drive, budget: int) -> Block:
    path = drive.folder / FILM_NAME
    if not path.is_file():
        return Missing("The drive was not filmed (score.film; film=true in drivezoo evaluate).")
    is_small = path.stat().st_size <= budget
    link = f"../drives/{drive.folder.name}/{FILM_NAME}"
    return Film(link, "Film of the scored drive.", path.read_bytes() if is_small else None)


def _plots(drive: Drive) -> list[Block]:
    images = []
    for plot, caption in PLOTS.items():
        path = drive.folder / f"{plot}.png"
        if path.is_file():
            # Inverted for a dark page, large errors would have the darkest colours.
            name = f"{drive.folder.name}_{path.name}"  # unique among the drives
            images.append(Image(name, path.read_bytes(), caption, plot=plot != "track"))
    return [Images([one]) for one in images]


def _worst(run: ReportedRun, track: str, drives: list[Drive]) -> list[Block]:
    """Return the worst moments of a track's drives, each with its saliency map."""
    found = [
        (drive, row)
        for drive in drives
        for row in np.flatnonzero((drive.frame != "") & np.isfinite(drive.cross_track_m)).tolist()
    ]
    if not found:
        raise InputError("The drive saved no images of its worst moments.")
    found.sort(key=lambda one: _badness(*one), reverse=True)
    saliency = Saliency(CheckpointPolicy(run.checkpoint))
    images = []
    for number, (drive, row) in enumerate(found[:MOMENTS], 1):
        frame = read_image(drive.folder / str(drive.frame[row]))
        where = saliency(frame, float(drive.speed_mph[row]))
        pair = np.hstack([frame, overlay(frame, where)])
        lost = "Intervention. " if drive.intervention[row] else ""
        caption = (
            f"{lost}{drive.time_s[row]:.1f} s, start seed {drive.seed}, "
            f"cross-track error {drive.cross_track_m[row]:+.2f} m, steering "
            f"{drive.steering[row] + 0.0:+.2f}, {drive.speed_mph[row]:.0f} mph"
        )
        name = f"{drives[0].folder.name}_worst_{number}.jpg"
        images.append(Image.jpeg(name, pair, caption))
    return [
        Heading(f"Worst moments on the {track}"),
        Text(
            "Interventions come first, then the largest cross-track errors, at least "
            f"{APART_S:g} s apart. The right half shows in green what the steering depends on."
        ),
        Images(images, columns=2),
    ]


def _badness(drive: Drive, row: int) -> tuple[bool, float]:
    return bool(drive.intervention[row]), abs(float(drive.cross_track_m[row]))
