"""Draw the images of the README and the manual: `python docs/draw_images.py [RUN | laps | tracks]`.

Writes `docs/images/board.webp` from `docs/benchmark.csv`. RUN is a run's folder: its checkpoint
drives a lap of the embedded lake over the socket, while headless Chromium shows the live page. This
writes `lap.webp` (the lap as an animation), `live_page.webp`, `report.webp` and `edit_page.webp`
(the editing page, with a lap of the expert), in some four minutes on two cores.

With `laps` it writes `udacity_lake.webp`, `udacity_mountain.webp` and `udacity_jungle.webp`: laps
of the packaged both_tracks at 9 mph, twenty times as fast. With `tracks` it writes `tracks.webp`,
plan and views of each track, and `roads.webp`, the features of drawn roads: each family's roads
beside the originals' tracks, by the share of their length. It then prints each track's length,
tightest radius and grades, the figures of `docs/simulator.md`.
"""

import csv
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import imageio_ffmpeg
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from tests.zoo.server.browser import Browser
from zoo.driving.intervals import Estimate
from zoo.extras.research.paper import of_results
from zoo.results.differences import read_entries
from zoo.results.suite import OVERALL
from zoo.runs.plots import interval_panels
from zoo.simulator.centreline import STEP_M
from zoo.simulator.road_family import draw_road, find_family
from zoo.simulator.simulated_world import Start, open_world
from zoo.simulator.track import Track
from zoo.simulator.track_file import read_track
from zoo.simulator.track_names import track_names

ROOT = Path(__file__).parents[1]
IMAGES, BOARD = ROOT / "docs" / "images", ROOT / "benchmarks" / "board"
WIDTH, HEIGHT = 400, 200  # of the animation, pixels
FPS, FASTER = 8, 10  # it plays ten times as fast as driven
# What a visitor understands of the board's entries and axes.
NAMES = {
    "expert": "expert, who knows the road",
    "expert_late": "expert, 0.4 s late",
    "lenet": "LeNet",
    "lenet-bends": "LeNet, roads bent",
    "lenet-narrow": "LeNet, a quarter as wide",
    "lenet-poses": "LeNet, recipe for three tracks",
    "lenet-short": "LeNet, a quarter of the samples",
    "lenet-unflipped": "LeNet, images never mirrored",
    "lenet-unaugmented": "LeNet, brightness unchanged",
    "pilotnet": "PilotNet",
    "pilotnet-bends": "PilotNet, roads bent",
    "pilotnet-narrow": "PilotNet, a quarter as wide",
    "pilotnet-dagger": "PilotNet, corrected by the expert",
    "cnn_gru": "PilotNet with memory",
    "linear": "linear, 15 weights",
    "tiny41": "41 weights",
}
PANELS = {
    OVERALL: "clean drives, %",
    "geometry": "sharper bends",
    "dynamics": "speed and delay",
    "visibility": "fog, dark, noise",
    "camera": "camera moved",
}
PLACES = (0.04, 0.3, 0.62)  # shares of the lap
ORIGINALS = ("udacity_lake", "udacity_jungle", "research_mountain")
FAMILIES = ("alpine", "country", "lakeside")  # others are for the benchmark and a recipe
ROADS = 200
LEAST_CURVATURE = 1e-4  # 1/m; straights are drawn at it

FEATURES = {
    "|curvature|, 1/m": lambda road: np.maximum(np.abs(road.curvature), LEAST_CURVATURE),
    "|grade|, %": lambda road: 100 * np.abs(road.grade),
    "width, m": lambda road: road.widths,
    "length, m": lambda road: np.array([road.length]),
}


def serve(*command: str, folder: Path = ROOT) -> tuple[subprocess.Popen, str]:
    """Start a command that serves a page in a folder; return its process and the address."""
    process = subprocess.Popen(
        [sys.executable, "-m", *command], stdout=subprocess.PIPE, text=True, cwd=folder
    )
    for line in process.stdout:
        if line.startswith("open http"):
            return process, line.split()[1]
    raise SystemExit(f"{command[0]} did not start; the lines above say why")


def take_screenshot(
    url: str, size: tuple[int, int], path: Path, wait_s: float, ready: str = "true"
) -> None:
    """Keep what a browser shows of a page some seconds after a script's value is true."""
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile,
        Browser(Path(profile), *size) as browser,
    ):
        browser.open(url)
        browser.wait_for(ready, 120)
        time.sleep(wait_s)
        browser.value("document.documentElement.style.overflow = 'hidden'")  # no scroll bar
        browser.screenshot(path.with_suffix(".png"))
    with Image.open(path.with_suffix(".png")) as image:
        image.convert("RGB").save(path, quality=75, method=6)
    path.with_suffix(".png").unlink()


def animate(folder: Path, path: Path) -> None:
    """Make an animation of a drive's frames, with the overlay of `zoo.commands.film`."""
    film = folder.with_suffix(".mp4")
    subprocess.run(
        [sys.executable, "-m", "zoo.commands.film", str(folder), f"out={film}", "fps=30"],
        check=True,
    )
    with (folder / "drive.csv").open() as file:
        driven_s = float([row["time_s"] for row in csv.DictReader(file)][-1])
    _, film_s = imageio_ffmpeg.count_frames_and_secs(str(film))
    write_animation(film, driven_s / film_s / FASTER, path)


def write_animation(film: Path, slower: float, path: Path) -> None:
    """Write a film as an animation that takes so many times as long."""
    faster = f"setpts=PTS*{slower:.4f}"
    frames = imageio_ffmpeg.read_frames(
        str(film), output_params=["-vf", f"{faster},fps={FPS},scale={WIDTH}:{HEIGHT}"]
    )
    next(frames)  # what is known of the film
    images = [Image.frombytes("RGB", (WIDTH, HEIGHT), frame) for frame in frames]
    images[0].save(
        path,
        save_all=True,
        append_images=images[1:],
        duration=1000 // FPS,
        loop=0,
        quality=40,
        method=6,
        minimize_size=False,
    )


def draw_board() -> None:
    """Draw clean drives of the board's entries by axis, the best entry first, and by level."""
    with (ROOT / "docs" / "benchmark.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["entry"] in NAMES]
    name = "without_intervention"
    best = sorted(rows, key=lambda row: -float(row[name]))
    order = [NAMES[row["entry"]] for row in best if row["group"] == OVERALL]
    panels = {}
    for group, label in PANELS.items():
        figures = {
            NAMES[row["entry"]]: Estimate(
                *(float(row[f"{name}{end}"] or "nan") for end in ("", "_low", "_high"))
            )
            for row in rows
            if row["group"] == group
        }
        panels[label] = {name: figures[name] for name in order}, 100
    entries = read_entries(
        *(BOARD / name for name in ("lenet-bends", "lenet", "pilotnet", "linear"))
    )
    figures = {"board": interval_panels(panels), "profiles": of_results(entries).plots["profiles"]}
    for axis in figures["board"].axes:
        axis.set_xlim(-3, 103)
    for name, figure in figures.items():
        path = IMAGES / f"{name}.png"
        figure.savefig(path, dpi=110, bbox_inches="tight")
        with Image.open(path) as image:
            image.convert("RGB").save(path.with_suffix(".webp"), quality=85, method=6)
        path.unlink()


def draw_laps() -> None:
    """Draw a lap of each of the course's tracks."""
    names = ("udacity_lake", "udacity_mountain", "udacity_jungle")
    with tempfile.TemporaryDirectory() as scratch:
        keys = [f"track={','.join(names)}", "speed=9", "film=true", "film_speed=20", "page=false"]
        command = ["-m", "zoo.commands.evaluate", "both_tracks", *keys, f"out={scratch}/drives"]
        subprocess.run([sys.executable, *command], check=True)
        for name in names:
            film = Path(scratch, "drives", f"{name}-0", "film.mp4")
            write_animation(film, 1.0, IMAGES / f"{name}.webp")


def track_views(names: list[str]) -> plt.Figure:
    """Return a row for each track: its plan with the places of the views, and the views."""
    figure, rows = plt.subplots(
        len(names),
        1 + len(PLACES),
        figsize=(12, 2.0 * len(names)),
        width_ratios=[1.3, *[1.6] * len(PLACES)],
        squeeze=False,
        layout="constrained",
    )
    for name, (plan, *views) in zip(names, rows, strict=True):
        world = open_world(name)
        track = world.track
        plan.plot(*track.at(np.linspace(0, track.length, 1200))[:, :2].T, color="#555555", lw=3)
        plan.set_aspect("equal")
        plan.axis("off")
        plan.set_title(f"{name}, {track.length:,.0f} m")
        for number, (share, view) in enumerate(zip(PLACES, views, strict=True), 1):
            start = Start(distance=share * track.length)
            world.reset(0, start)
            place = track.at(start.distance)[:2]
            plan.plot(*place, "o", color="#c0392b", ms=4)
            plan.annotate(str(number), place, xytext=(4, 3), textcoords="offset points")
            view.imshow(world.frame())
            view.set_title(f"{number}: at {start.distance:,.0f} m")
            view.axis("off")
    return figure


def figures_of(name: str) -> str:
    """Return a track's length, tightest radius, grades, range of heights and bridge in a line."""
    track = read_track(name)
    return (
        f"{name}: {track.length:,.0f} m, radius {1 / np.abs(track.curvature).max():.1f} m or more, "
        f"grades {track.grade.min():+.0%} to {track.grade.max():+.0%}, "
        f"{np.ptp(track.xyz[:, 2]):.1f} m high, {track.bridge.sum() * STEP_M:.0f} m of bridge"
    )


def road_features() -> plt.Figure:
    """Return a panel for each feature: the share of road (of roads, for the length) below a value.

    Solid lines have the families' roads, dashed lines the originals' tracks.
    """
    figure, axes = plt.subplots(2, 2, figsize=(10, 6.4), layout="constrained")
    groups: list[tuple[str, list[Track], str, str]] = [
        (name, [draw_road(find_family(name), seed) for seed in range(ROADS)], colour, "-")
        for name, colour in zip(FAMILIES, ("#2a6fbb", "#d9822b", "#3a9a5b"), strict=True)
    ]
    groups += [
        (name, [read_track(name)], colour, "--")
        for name, colour in zip(ORIGINALS, ("#c0392b", "#8a5bb0", "#222222"), strict=True)
    ]
    for axis, (feature, measure) in zip(axes.flat, FEATURES.items(), strict=True):
        for name, roads, colour, style in groups:
            values = np.sort(np.concatenate([measure(road) for road in roads]))
            if values[0] == values[-1]:  # one width along the road, or one road
                axis.axvline(values[0], color=colour, ls=style, lw=1.4, label=name)
                continue
            shares = np.linspace(0, 100, len(values))
            axis.plot(values, shares, color=colour, ls=style, lw=1.6, label=name)
        axis.set(xlabel=feature, ylabel="below the value, %", ylim=(-2, 102))
        axis.spines[["top", "right"]].set_visible(False)
    axes.flat[0].set_xscale("log")
    axes.flat[0].legend(frameon=False, fontsize="small")
    figure.suptitle(f"{ROADS} roads of each family (solid) and the originals' tracks (dashed)")
    return figure


def draw_tracks() -> None:
    """Draw tracks and roads, and print the tracks' figures."""
    print(*map(figures_of, track_names()), sep="\n")
    settings = {"pil_kwargs": {"quality": 85}}
    track_views(track_names()).savefig(IMAGES / "tracks.webp", dpi=110, **settings)
    road_features().savefig(IMAGES / "roads.webp", dpi=100, **settings)


def main(run: Path) -> None:
    """Draw all but the board."""
    report = run / "report" / "index.html"
    if not report.is_file():
        raise SystemExit(f"{report}: no such file; name a finished run")
    with tempfile.TemporaryDirectory() as scratch:
        drive, lap = Path(scratch) / "drive", Path(scratch) / "my_lap"
        keys = ["drive.sim=lake", "drive.laps=1", "drive.port=0", "drive.speed.set_mph=20"]
        process, url = serve(
            "zoo.commands.drive", str(run.resolve()), *keys, f"drive.record={drive}"
        )
        drives = "!document.body.innerText.includes('Waiting for a simulator')"
        take_screenshot(url, (1280, 800), IMAGES / "live_page.webp", wait_s=10, ready=drives)
        process.communicate()
        animate(drive, IMAGES / "lap.webp")
        record = ["-m", "zoo.commands.simulator", "record", "track=lake", "laps=1", f"out={lap}"]
        subprocess.run([sys.executable, *record], check=True)
        edits = ["drop=150-240", "mirror=700-860", "split=1000", "port=0", f"ckpt={run.resolve()}"]
        process, url = serve("zoo.commands.edit", lap.name, *edits, folder=lap.parent)
        take_screenshot(f"{url}#420", (1400, 890), IMAGES / "edit_page.webp", wait_s=20)
        process.terminate()
        process.communicate()
    take_screenshot(report.resolve().as_uri(), (1000, 1100), IMAGES / "report.webp", wait_s=3)


if __name__ == "__main__":
    IMAGES.mkdir(exist_ok=True)
    if sys.argv[1:] == ["laps"]:
        draw_laps()
    elif sys.argv[1:] == ["tracks"]:
        draw_tracks()
    else:
        draw_board()
        if len(sys.argv) > 1:
            main(Path(sys.argv[1]))
