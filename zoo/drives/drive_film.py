"""Images kept from a scored drive: frames of its worst moments, and a film."""

from pathlib import Path

import cv2
import numpy as np

from datamodules.formats.recording_writer import write_frame
from simulator.film import Film
from zoo.drives.drive_record import DriveRow
from zoo.drives.film_overlay import draw_overlay
from zoo.drives.tally import autonomy

FILM_NAME = "film.mp4"
FILM_SIZE = (640, 320)  # twice the camera's size; at 960 x 480 a lap takes twice the bytes
MOMENTS, APART_S = 10, 2.0


class WorstMoments:
    """Frames of a drive's worst moments, chosen while it runs, so that memory stays small.

    An intervention is worse than any other moment. Otherwise the moment farther from the
    centreline is worse.

    Args:
        count: greatest number of frames to keep.
        apart_s: least time between two kept moments, in seconds; the worse of two is kept.
    """

    def __init__(self, count: int = MOMENTS, apart_s: float = APART_S) -> None:
        self.count, self.apart_s = count, apart_s
        self.moments: list[tuple[int, DriveRow, np.ndarray]] = []  # in the order of time
        self._number = -1

    def __call__(self, frame: np.ndarray, row: DriveRow) -> None:
        """Take the next frame, uint8 [H, W, 3] RGB, and its row."""
        self._number += 1
        if self.moments and row.time_s - self.moments[-1][1].time_s < self.apart_s:
            if badness(row) <= badness(self.moments[-1][1]):
                return
            self.moments.pop()
        elif len(self.moments) >= self.count:
            least = min(self.moments, key=lambda one: badness(one[1]))
            if badness(least[1]) >= badness(row):
                return
            self.moments.remove(least)
        self.moments.append((self._number, row, frame.copy()))

    def write(self, folder: Path) -> dict[int, str]:
        """Write the frames as JPEG; return their paths within the folder by row number."""
        names = {}
        (folder / "frames").mkdir(parents=True, exist_ok=True)
        for number, _, frame in self.moments:
            names[number] = f"frames/{number:06d}.jpg"
            write_frame(frame, folder / names[number])
        return names


def badness(row: DriveRow) -> tuple[bool, float]:
    """Return a sort key of a moment; the worst moment has the greatest."""
    return row.intervention, abs(row.cross_track_m)


class DriveFilm(Film):
    """Writer of `film.mp4` during a drive; steering, speed and autonomy are drawn in.

    Args:
        folder: folder of the drive.
        frame_rate: frames per second of simulated time.
        speed: playing speed as a multiple of the driven speed; 3 writes every third frame.

    Raises:
        InputError: the film cannot be written.
    """

    def __init__(self, folder: Path, frame_rate: float, speed: float = 1.0) -> None:
        self.every = max(1, round(speed))
        self.number = self.interventions = 0
        super().__init__(folder / FILM_NAME, frame_rate * speed / self.every)

    def __call__(self, frame: np.ndarray, row: DriveRow) -> None:
        """Take the next frame, uint8 [160, 320, 3] RGB, and its row."""
        self.interventions += row.intervention
        self.number += 1
        if (self.number - 1) % self.every:
            return
        share = autonomy(self.interventions, row.time_s)
        image = draw_overlay(
            frame,
            row.steering,
            row.throttle,
            row.speed_mph,
            share,
            row.cross_track_m,
            spread=row.spread,
        )
        self.add(cv2.resize(image, FILM_SIZE, interpolation=cv2.INTER_AREA))
