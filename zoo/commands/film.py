"""`drivezoo film`: film a drive, a recording or a folder of images."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from pydantic import Field
from rich.console import Console

from datamodules.format_options import ReadOptions
from datamodules.formats.udacity import times_from_names
from datamodules.image import AnyImage, read_image
from datamodules.known_formats import known_format
from datamodules.recording import LOG_NAME
from datamodules.recording_format import read_recordings
from zoo.base.command import command
from zoo.base.console_progress import loading, progress_bar
from zoo.base.errors import InputError, UsageError
from zoo.base.output_files import checked_file
from zoo.base.rig import UDACITY
from zoo.base.terminal import counted, print_line, print_written
from zoo.checkpoints.checkpoint_path import find_driver
from zoo.checkpoints.policy_base import Policy, read_as_trained
from zoo.driving import drive_log
from zoo.driving.drive_film import MOMENTS, Overlay, draw_overlay
from zoo.driving.drive_record import EMBEDDED, FALLBACK, PERSON, REPLAY, SOCKET
from zoo.driving.tally import LONGEST_STEP_S, autonomy

USUAL_FPS = 15.0  # the simulator's recorder; used if the images have no times
MOST_FPS = 60.0
SHOWN_S = 1.0  # in which a film says that there was an intervention
MOST_PILOTS = 4
SUFFIXES = (".jpg", ".jpeg", ".png")


@dataclass(frozen=True)
class Shot:
    """A frame of a film: its image, and the drive's state at that time."""

    path: AnyImage
    time_s: float
    state: Overlay = field(default_factory=Overlay)


def read_shots(folder: Path, faults: list[str], **said: Any) -> list[Shot]:
    """Return the frames of a drive, a recording or a folder of images, in the order of time.

    Args:
        folder: folder to film.
        faults: list to which a line is added for each row of a recording without its image.
        **said: fields of `ReadOptions`, for a recording.

    Raises:
        InputError: the folder does not exist or has no images, or its log cannot be read.
    """
    if folder.exists() and folder.name in (LOG_NAME, drive_log.LOG_NAME):
        folder = folder.parent
    is_recording = "format" in said or (folder.exists() and known_format(folder) is not None)
    if not folder.is_dir() and not is_recording:
        raise InputError(f"{folder}: no such folder; usage: {film.usage}")
    # A log that is not a regular file, such as a pipe, is reported when it is opened.
    if (folder / drive_log.LOG_NAME).exists() and (shots := _shots_of_drive(folder)):
        return shots  # each simulator has times of its own
    shots = _shots_of_recording(folder, faults, said) if is_recording else _shots_of_images(folder)
    if not shots:
        raise InputError(f"{folder}: has no {LOG_NAME}, JPEG or PNG; name another folder")
    times = np.array([shot.time_s for shot in shots])
    order = np.argsort(times, kind="stable") if np.isfinite(times).all() else range(len(shots))
    return [shots[index] for index in order]


def real_fps(shots: list[Shot]) -> float:
    """Return the frames per second of the recording, 1..60; 15 if unknown."""
    steps = np.diff([shot.time_s for shot in shots])
    forward = steps[steps > 0]  # drops NaN
    if not len(forward):
        return USUAL_FPS
    # The mean without pauses; the median is wrong: 15 Hz in steps of 0.02 s has a median of 0.06 s.
    usual = steps[(steps >= 0) & (steps < 3 * np.median(forward))]
    return float(np.clip(round(1 / float(usual.mean()), 1), 1.0, MOST_FPS))


def _load_pilots(names: list[str]) -> dict[str, Policy]:
    """Return the policies that steer in a film, by name.

    Raises:
        InputError: a checkpoint cannot be used.
        UsageError: there are more than four.
    """
    if len(names) > MOST_PILOTS:
        raise UsageError(f"ckpt: names {len(names)}; a film shows {MOST_PILOTS} at most")
    drivers = {name: find_driver(name) for name in names}
    with loading():
        from zoo.checkpoints.checkpoint_policy import load_policy
    return {name: load_policy(driver) for name, driver in drivers.items()}


def _pilots(pilots: dict[str, Policy], shots: list[Shot]) -> Callable[[np.ndarray, Shot], Any]:
    """Return the function that lets pilots steer on a frame, and draws them into it.

    Raises:
        InputError: the frames have no recorded steering.
    """
    if any(shot.state.steering is None for shot in shots):
        raise InputError("ckpt=: these frames have no steering; name the folder of a recording")
    from zoo.driving.pilot_film import Pilots
    from zoo.driving.run_drives import one_thread

    rig, last_s = shots[0].state.rig, math.inf
    policies = [policy.in_car(rig) for policy in pilots.values()]
    drawing = Pilots(list(pilots), rig, [])

    def draw(frame: np.ndarray, shot: Shot) -> np.ndarray:
        nonlocal last_s
        if shot.time_s < last_s or shot.time_s - last_s > LONGEST_STEP_S:
            for policy in policies:
                policy.reset()
        last_s, speed = shot.time_s, shot.state.speed_mph or 0.0
        with one_thread():
            steering = [policy(frame, speed).steering for policy in policies]
        drawing.steering.append([shot.state.steering or 0.0, *steering])
        return drawing.draw(frame)

    return draw


def _shots_of_drive(folder: Path) -> list[Shot]:
    drive = drive_log.read_drive(folder)
    notes = {PERSON: "a person drives", FALLBACK: "trouble: braking"}
    # One client after the other: a film that alternates between clients would flicker.
    rows = np.argsort(drive.client, kind="stable")
    rows = rows[np.isin(drive.client[rows], drive.client[drive.frame != ""])]
    client, times = drive.client[rows], drive.time_s[rows]
    steps = np.where(np.diff(client, prepend=0), 0.0, np.diff(times, prepend=times[:1]))
    # Without cross-track errors and interventions, the autonomy is unknown.
    judged = np.isin(client, client[np.isfinite(drive.cross_track_m[rows])]).all()
    driven_s = np.cumsum(np.where((steps > 0) & (steps <= LONGEST_STEP_S), steps, 0.0))
    interventions = np.cumsum(drive.intervention[rows])
    shots, last, lost, lost_s = [], "", 0, -math.inf
    for number, row in enumerate(rows):
        frame = str(drive.frame[row])
        if not frame or frame == last:  # the old client's two loops send most frames twice
            continue
        lost_s = float(drive.time_s[row]) if int(interventions[number]) > lost else lost_s
        last, lost = frame, int(interventions[number])
        time_s = float(drive.time_s[row])
        lately = "intervention" if 0 <= time_s - lost_s < SHOWN_S else None
        state = Overlay(
            float(drive.steering[row]),
            float(drive.throttle[row]),
            float(drive.speed_mph[row]),
            autonomy(lost, driven_s[number]) if judged or lost else None,
            float(drive.cross_track_m[row]),
            notes.get(str(drive.driver[row]), lately),
            float(drive.spread[row]),
            # In other worlds it is any car, whose steering range the drive does not have.
            rig=UDACITY if drive.source in ("", EMBEDDED, SOCKET) else None,
            recorded=float(drive.expert_steering[row]) if drive.source == REPLAY else None,
            time_s=time_s,
        )
        shots.append(Shot(folder / frame, time_s, state))
    if not shots or len(shots) <= MOMENTS < len(drive) / 10:
        if (folder / LOG_NAME).is_file():  # of evaluate record=true: the recording has all frames
            return []
        raise InputError(
            f"{folder}: has no frames, or only its worst moments; drive with record=FOLDER, or "
            "film while it is scored: drivezoo evaluate CKPT film=true"
        )
    return shots


def _shots_of_recording(folder: Path, faults: list[str], said: dict) -> list[Shot]:
    log = read_recordings(str(folder), **said | {"on_bad_image": "skip"})
    faults += log.bad_images
    columns = log.time_s, log.steering, log.throttle - log.brake, log.known_speed_mph
    states = np.stack(columns, axis=1).tolist()
    return [
        Shot(path, time_s, Overlay(steering, throttle, mph, rig=log.rig))
        for path, (time_s, steering, throttle, mph) in zip(log.images[:, 0], states, strict=True)
    ]


def _shots_of_images(folder: Path) -> list[Shot]:
    """Return images with the time in their names, as the course's drive.py writes them.

    Other names have no time; their order is alphabetical.
    """
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    times = times_from_names([path.name for path in paths])
    return [Shot(path, float(time)) for path, time in zip(paths, times, strict=True)]


@command(outputs=True)
def film(
    folder: str,
    *,
    out: str | None = None,
    fps: Annotated[float, Field(gt=0, le=1000)] | None = None,
    ckpt: str | None = None,
    read: ReadOptions,
) -> Path:
    """Film a drive, a recording or a folder of images.

    Writes an H.264 .mp4 that plays in a browser. Each frame shows steering, throttle and speed;
    frames of a drive (a folder with drive.csv) also show autonomy and the distance from the
    centreline. With ckpt=A,B each checkpoint steers on the frames of a recording: their wheels are
    drawn beside the recorded one, and how far each is off over time. Images that cannot be read
    are left out and counted.

    Args:
        folder: folder of a drive, a recording or images.
        out: .mp4 file to write; null: FOLDER.mp4, next to the folder.
        fps: frames per second; null plays as fast as it was driven.
        ckpt: up to four checkpoints, A,B, that steer on the frames of a recording; null for none.
        read: see `ReadOptions`; not given: as the first of ckpt that trained on this recording.
    """
    # Imported late: imageio-ffmpeg (30 MB) is needed only for films.
    from zoo.base.video import FILMS, Film

    console, path = Console(soft_wrap=True), Path(folder).expanduser()
    film_path = checked_file(out or f"{path.absolute()}.mp4", FILMS, "out" if out else "")
    pilots = {} if ckpt is None else _load_pilots(ckpt.split(","))
    faults: list[str] = []
    shots = read_shots(path, faults, **read_as_trained(pilots.values(), path, read))
    draw = _pilots(pilots, shots) if pilots else None
    rate = real_fps(shots) if fps is None else fps
    images = len(shots) + len(faults)
    size: tuple[int, int] | None = None  # of the first frame, in which all are filmed
    try:
        with Film(film_path, rate) as film, progress_bar("filming", console) as report:
            for number, shot in enumerate(shots):
                report(number / len(shots))
                try:
                    frame = read_image(shot.path)
                except (OSError, ValueError) as error:
                    faults.append(f"{shot.path}: {getattr(error, 'strerror', None) or error}")
                else:
                    image = draw(frame, shot) if draw else draw_overlay(frame, shot.state)
                    size = size or image.shape[1::-1]
                    film.add(cv2.resize(image, size))
    except InputError as error:
        raise InputError(f"{error}; or name another file with out=") from None
    drawn = images - len(faults)
    if not drawn:
        raise InputError(f"{faults[0]}; none of {images} images can be read")
    if faults:
        print_line(console, f"{counted(len(faults), 'image')} left out: {faults[0]}")
    print_line(console, f"{counted(drawn, 'frame')} at {rate:g} per second, {drawn / rate:.1f} s")
    print_written([film_path], console=console)
    return film_path


if __name__ == "__main__":
    film.run()
