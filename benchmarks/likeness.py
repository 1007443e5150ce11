"""Compare our frames with the original simulator's: `python benchmarks/likeness.py RECORDING`.

RECORDING is from the original simulator's lake track. The script prints for rows of pixels the mean
colour, the road's colour, its grain, and the saturation, of both simulators. It also writes
`outputs/likeness/sheet.png`: left, centre and right camera at eight places, the original's frames
above ours.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from datamodules.image import decode_image
from datamodules.recording import read_recordings
from simulator.rig import CAMERAS
from simulator.world import Start, World, open_world

EVERY = 20  # every 20th row of the recording
PLACES = 120  # of our frames, along the lap
ROWS = (0, 10, 20, 30, 40, 50, 60, 68, 76, 84, 92, 100, 108, 116, 124, 132, 140, 148, 156)
ROAD = slice(130, 190)  # columns that show only road below the horizon
# Places matched by eye: a row as a share of the recording, and metres along our lap.
PAIRS = (
    (0.0, 0),
    (0.13, 320),
    (0.2186, 460),
    (0.2685, 700),
    (0.0433, 120),
    (0.411, 800),
    (0.348, 845),
    (0.4345, 1000),
)


def our_frames(world: World) -> np.ndarray:
    """Return uint8 [PLACES, 160, 320, 3], half of them backward, slightly off the centreline."""
    frames = []
    for number in range(PLACES):
        world.direction = 1 if number % 2 else -1
        start = Start(number * world.track.length / PLACES, 0.6 * np.sin(number))
        world.reset(0, start)
        frames.append(world.frame())
    world.direction = 1
    return np.stack(frames)


def saturation(frames: np.ndarray) -> np.ndarray:
    """Return each row's mean saturation, float64 [160], 0..255."""
    return np.mean([cv2.cvtColor(f, cv2.COLOR_RGB2HSV)[..., 1].mean(1) for f in frames], 0)


def main(root: str) -> None:
    """Print the table and write the sheet."""
    console = Console()
    recording = read_recordings([root])
    theirs = np.stack(
        [decode_image(Path(paths[0]).read_bytes()) for paths in recording.images[::EVERY]]
    )
    world = open_world("lake", renderer="software")
    ours = our_frames(world)
    table = Table(
        "row", "mean RGB", "ours", "road RGB", "ours", "grain", "ours", "saturation", "ours"
    )
    saturations = [saturation(frames) for frames in (theirs, ours)]
    for row in ROWS:
        cells = [str(row)]
        both = [frames[:, row].astype(float) for frames in (theirs, ours)]
        cells += [_rgb(pixels.mean((0, 1))) for pixels in both]
        cells += [_rgb(np.median(pixels[:, ROAD], (0, 1))) for pixels in both]
        cells += [f"{pixels[:, ROAD].std(1).mean():.0f}" for pixels in both]
        cells += [f"{one[row]:.0f}" for one in saturations]
        table.add_row(*cells)
    console.print(table)
    apart = np.abs(theirs.mean((0, 2)) - ours.mean((0, 2))).mean(0)
    console.print(f"rows' mean colours differ by {_rgb(apart)} (RGB, mean over 160 rows)")
    rows = []
    for share, distance in PAIRS:
        index = round(share * (len(recording) - 1))
        world.reset(0, Start(distance))
        order = ("left", "center", "right")
        original = [
            decode_image(Path(recording.images[index][CAMERAS.index(c)]).read_bytes())
            for c in order
        ]
        rows += [np.hstack(original), np.hstack([world.frame(c) for c in order])]
        rows.append(np.zeros((6, 960, 3), np.uint8))
    sheet = Path("outputs/likeness/sheet.png")
    sheet.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(sheet), cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR))
    console.print(str(sheet), highlight=False)


def _rgb(colour: np.ndarray) -> str:
    return " ".join(f"{value:.0f}" for value in colour)


if __name__ == "__main__":
    main(sys.argv[1])
