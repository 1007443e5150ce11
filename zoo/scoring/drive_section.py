"""The section on driving: figures, film, path and worst moments."""

import math
import os
from collections import Counter
from pathlib import Path

import numpy as np

from datamodules.image import read_image
from zoo.base.errors import InputError
from zoo.driving.drive_film import APART_S, FILM_NAME, Overlay, badness, draw_overlay
from zoo.driving.drive_log import read_drive
from zoo.driving.drive_record import EMBEDDED, Drive, DriveRow, WrittenDrive
from zoo.driving.drives_table import drives_table
from zoo.driving.intervals import ONE_TRACK
from zoo.driving.interventions import INFRACTIONS
from zoo.runs.result_table import Table
from zoo.scoring.blocks import Block, Film, Fold, Heading, Image, Images, Missing, Rows, Text
from zoo.scoring.evidence import no_verdict, source_of
from zoo.scoring.reported_run import ReportedDrives
from zoo.scoring.visual_backprop import Saliency, overlay

SHOWN, OTHERS = 6, 5  # worst moments of a track, and drives with other start seeds
FAILURE_S = 5.0  # longest film of a failure
FILMS_BYTES = 10_000_000  # total of films embedded in the page; base64 adds a third
PLOTS = {
    "track": "The car's path, coloured by cross-track error. Crosses mark interventions.",
    "error": "Cross-track error along the track. The lane is shaded.",
}


def scores(run: ReportedDrives) -> list[Block]:
    """Return the figures of all drives."""
    if not run.tracks:
        source = source_of(run.metrics.get("data"))
        remedy = no_verdict(source) if source else "drive its checkpoint with drivezoo evaluate"
        why = run.metrics.get("not_replayed") or "score=none"
        raise InputError(f"Not driven, only open-loop figures ({why}); {remedy}.")
    scored = run.metrics.get("drive") or run.metrics.get("settings") or {}
    keys = [f"{key}={value}" for key, value in scored.items() if type(value) in (str, int, float)]
    world = run.metrics.get("world") or EMBEDDED
    where = f"Driven in the {'embedded simulator' if world == EMBEDDED else f'world {world}'}, in "
    where += f"simulated time{': ' if keys else ''}{', '.join(keys)}."
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


def tracks(run: ReportedDrives) -> list[Block]:
    """Return each track's film, plots and worst moments."""
    blocks: list[Block] = []
    blocks += [Missing(f"A drive cannot be read: {line}.") for line in run.damaged_drives]
    if run.tracks and not run.drives and not blocks:
        raise InputError("The run's folder no longer holds the drives.")
    left = FILMS_BYTES
    for track in dict.fromkeys(drive.track for drive in run.drives):
        drives = [drive for drive in run.drives if drive.track == track]
        film = _film(run, drives[0], left)
        left -= len(film.data or b"") if isinstance(film, Film) else 0
        blocks += [Heading(f"Drive on the {track}"), film, *_plots(drives[0])]
        others = sorted(drives[1:], key=_lost, reverse=True)[:OTHERS]
        if plots := [block for drive in others for block in _plots(drive)]:
            title = f"Drives with other start seeds: the {len(others)} worst of {len(drives) - 1}"
            blocks.append(Fold(title, plots))
        try:
            blocks += _worst(run, track, drives)
        except (InputError, OSError) as missing:
            blocks.append(Missing(str(missing)))
    return blocks


def infractions(run: ReportedDrives) -> list[Block]:
    """Return for each track what its interventions corrected; nothing without any."""
    counts: dict[str, Counter] = {track: Counter() for track in run.tracks}
    for drive in run.drives:
        counts.setdefault(drive.track, Counter()).update(drive.summary.get("infractions") or {})
    if not any(counts.values()):
        return []
    rows = [
        [words, *(str(count[key]) for count in counts.values())]
        for key, words in INFRACTIONS.items()
    ]
    return [Heading("Interventions of all drives"), Rows(Table.of(["cause", *counts], rows))]


def _film(run: ReportedDrives, drive: WrittenDrive, budget: int) -> Block:
    path = drive.folder / FILM_NAME
    if not path.is_file():
        return Missing("The drive was not filmed (score.film; film=true in drivezoo evaluate).")
    link = Path(os.path.relpath(path, run.folder / "report")).as_posix()
    data = path.read_bytes() if path.stat().st_size <= budget else None
    return Film(link, "Film of the scored drive.", data, worst_moment(drive))


def failure(folder: Path, with_path: bool) -> list[Block]:
    """Return the embedded film of a drive that ended where it left the road, and its path.

    Args:
        folder: folder of the drive, which was filmed; without it there is no block.
        with_path: whether the path on the road is shown.
    """
    if not (folder / FILM_NAME).is_file():
        return []
    drive = read_drive(folder)
    length_s = min(FAILURE_S, float(drive.time_s[-1]))
    caption = f"The last {length_s:.2g} s before the car left the road, and where it did."
    film = Film(FILM_NAME, caption, (folder / FILM_NAME).read_bytes(), worst_moment(drive))
    return [film, *(_plots(drive)[:1] if with_path else [])]


def worst_moment(drive: WrittenDrive) -> Image | None:
    """Return the worst moment as the film shows it; None if its frame was not kept."""
    worst = max(_moments(drive), key=badness, default=None)
    if worst is None:
        return None
    state = Overlay(worst.steering, worst.throttle, worst.speed_mph, cte_m=worst.cross_track_m)
    pixels = draw_overlay(read_image(drive.folder / worst.frame), state)
    lost = ": an intervention" if worst.intervention else ""
    caption = f"The worst moment, after {worst.time_s:.1f} s{lost}."
    return Image.jpeg(f"{drive.folder.name}_poster.jpg", pixels, caption)


def _plots(drive: WrittenDrive) -> list[Block]:
    images = []
    for plot, caption in PLOTS.items():
        path = drive.folder / f"{plot}.png"
        if path.is_file():
            # Inverted for a dark page, large errors would have the darkest colours.
            name = f"{drive.folder.name}_{path.name}"  # unique among the drives
            images.append(Image.read(path, caption, name, plot=plot != "track"))
    return [Images([image]) for image in images]


def _worst(run: ReportedDrives, track: str, drives: list[WrittenDrive]) -> list[Block]:
    """Return the worst moments of a track's drives, each with its saliency map if there is one."""
    moments = [(drive, row) for drive in drives for row in _moments(drive)]
    if not moments:
        raise InputError("No worst moments: the drive saved no images, or no cross-track error.")
    moments.sort(key=lambda moment: badness(moment[1]), reverse=True)
    saliency, why = None, "The right half shows in green what the steering depends on."
    try:
        saliency = Saliency(run.policy)
    except InputError as error:
        why = f"Without saliency: {error}."
    images = []
    for number, (drive, row) in enumerate(moments[:SHOWN], 1):
        frame = read_image(drive.folder / row.frame)
        if saliency is not None:
            frame = np.hstack([frame, overlay(frame, saliency(frame, row.speed_mph))])
        lost = "Intervention. " if row.intervention else ""
        speed = "speed unknown" if math.isnan(row.speed_mph) else f"{row.speed_mph:.0f} mph"
        caption = (
            f"{lost}{row.time_s:.1f} s, start seed {drive.seed}, cross-track error "
            f"{round(row.cross_track_m, 2) + 0.0:+.2f} m, steering "
            f"{round(row.steering, 2) + 0.0:+.2f}, {speed}"
        )
        images.append(Image.jpeg(f"{drives[0].folder.name}_worst_{number}.jpg", frame, caption))
    return [
        Heading(f"Worst moments on the {track}"),
        Text(
            "Interventions come first, then the largest cross-track errors, at least "
            f"{APART_S:g} s apart. {why}"
        ),
        Images(images, columns=2),
    ]


def _moments(drive: Drive) -> list[DriveRow]:
    """Return the rows of a drive's kept frames."""
    return [row for row in drive.rows if row.frame and math.isfinite(row.cross_track_m)]


def _lost(drive: Drive) -> tuple[float, float]:
    return drive.summary.get("interventions") or 0, drive.summary.get("cte_max_m") or 0
