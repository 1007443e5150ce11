"""Measurements that the manual quotes: `python benchmarks/measurements.py NAME ...`.

Each is a function: of intervals, of policies, of recordings and the storage of images, of the
embedded world.
"""

import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import torch
from scipy.stats import spearmanr

from benchmarks.coverage import coverage, level_coverage
from benchmarks.exports import exports
from benchmarks.material import OUT, frames_of, linked_recording, pictures
from benchmarks.measuring import print_table, run_named
from benchmarks.replay_measurements import middle, replays, warp
from benchmarks.secret_suite import secret_suite
from benchmarks.worlds import qualities
from datamodules.image import decode_image, read_image
from datamodules.recording_format import read_recordings
from datamodules.view import View
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.driving.run_drives import all_drives
from zoo.simulator.expert import Expert, ExpertSettings
from zoo.simulator.road_family import draw_road, family_names, find_family
from zoo.simulator.simulated_world import World as Embedded
from zoo.simulator.simulated_world import open_world
from zoo.simulator.track import Track
from zoo.simulator.track_names import track_names

VIEW = View((40, 20), "rgb", (66, 200))
SLOWEST_MPS = 1.0  # a driver that is slower than this on average is stuck


def doubt(folder: str, *checkpoints: str) -> None:
    """Compare spread and error of policies: `doubt RECORDING CKPT...`.

    Over 300 frames of the centre camera: the mean absolute error of the steering, the mean spread,
    the share of frames whose recorded steering lies within 1.96 spreads of the mean (0.95 for a
    perfect spread), the rank correlation of spread and absolute error, and the CPU time of a frame
    on one thread.
    """
    torch.set_num_threads(1)
    frames, speeds, steering = frames_of(folder, 300)
    rows = []
    for checkpoint in checkpoints:
        policy = load_policy(find_checkpoint(checkpoint))
        for frame in frames[:5]:  # warms up
            policy(frame, 9.0)
        began = time.process_time()
        answers = [policy(*pair) for pair in zip(frames, map(float, speeds), strict=True)]
        took_ms = 1000 * (time.process_time() - began) / len(frames)
        spread = np.array([answer.spread for answer in answers], float)
        error = np.abs([answer.steering for answer in answers] - steering)
        means = [f"{error.mean():.3f}", f"{spread.mean():.3f}"]
        means.append(f"{(error <= 1.96 * spread).mean():.2f}")
        rows.append([policy.name, *means, f"{spearmanr(spread, error)[0]:.2f}", f"{took_ms:.1f}"])
    print_table(["policy", "error", "spread", "within", "correlation", "CPU ms"], rows)


def speeds(checkpoint: str, times: str) -> None:
    """Drive each whole speed of `drivezoo timing`, not its bisection alone: `speeds CKPT TIMES`.

    Prints how often a road is clean at a higher speed than one at which it is not.
    """
    from zoo.timing.loop_times import read_loop_times
    from zoo.timing.timing_options import TimingOptions

    options, driver = TimingOptions(), str(find_checkpoint(checkpoint))
    loop, tried = read_loop_times(times, options.rate).loop, range(5, 31)
    for road in options.scenarios():
        scenarios = [replace(road, loop=loop, speed=float(speed)) for speed in tried]
        drives = all_drives(driver, scenarios, first_only=True)
        clean = [not drive.intervention.any() for drive in drives]
        first = clean.index(False) if False in clean else len(clean)
        print(f"{road.track}: clean to {tried[0] + first - 1} mph, above: {sum(clean[first:])}")


def storage(folder: str | None = None) -> None:
    """Measure the bytes of an image and how fast a core decodes it: `storage [RECORDING]`.

    An image is stored as recorded, or as the view of `nvidia`.
    """
    files = sorted(Path(folder, "IMG").glob("*.jpg")) if folder else [*chain(*pictures().values())]
    random.Random(0).shuffle(files)
    cv2.setNumThreads(1)
    recorded = [np.frombuffer(file.read_bytes(), np.uint8) for file in files[:600]]
    views = [VIEW(decode_image(data.tobytes())) for data in recorded]

    def encoded(kind: str, *settings: int) -> list[np.ndarray]:
        return [cv2.imencode(kind, view[:, :, ::-1], settings)[1] for view in views]

    def decoded(data: np.ndarray) -> np.ndarray:
        return cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)

    kinds: dict[str, tuple[list, Callable]] = {
        "JPEG, as recorded": (recorded, lambda data: VIEW(decode_image(data.tobytes()))),
        "view, JPEG of quality 95": (encoded(".jpg", cv2.IMWRITE_JPEG_QUALITY, 95), decoded),
        "view, PNG": (encoded(".png"), decoded),
    }
    rows = []
    for name, (data, decode) in kinds.items():
        seconds = []
        for _ in range(5):
            began = time.process_time()
            for item in data:
                decode(item)
            seconds.append(time.process_time() - began)
        size = np.mean([item.nbytes for item in data])
        rows.append([name, f"{size:,.0f}", f"{len(data) / min(seconds):,.0f}"])
    print_table(["stored", "bytes", "images/s of a core, the best of five rounds"], rows)


def formats(rows: str = "20000") -> None:
    """Measure how fast a recording is read and its images are decoded in order: `formats [ROWS]`.

    Each format has the same images of 320 x 160, in files, in a video, in HDF5 and in Parquet. The
    seconds are those of the processor, ffmpeg's included.
    """
    count, said = int(rows), {"unit": "share", "full": 1.0}
    columns = {"image": "image", "steering": "turn"}
    named = {"format": "table", "columns": columns, "steering": said}
    others: dict[str, tuple[Callable[[Path, int], object], dict]] = {
        "Motion JPEG video (DeepPicar)": (_video, {}),
        "HDF5 (comma.ai, 2016)": (_hdf5, {"steering": said}),
        "Parquet (table with JPEGs)": (_parquet, named),
    }
    log = linked_recording(count, ("center",))
    table = [_read_rates("JPEG files (Udacity's log)", log, {})]
    for name, (write, keys) in others.items():
        with TemporaryDirectory(dir=log.parent) as folder:
            write(Path(folder), count)
            table.append(_read_rates(name, Path(folder), keys))
    print_table(["recording", "rows", "s to read the rows", "images/s decoded in order"], table)


def tub(rows: str = "1000000") -> None:
    """Measure the seconds of a core and the memory of `drivezoo check` on a long tub: `tub [ROWS]`.

    Its records name the same few images. Not on Windows.
    """
    import resource

    from datamodules.formats.donkeycar import write_catalogs

    files = pictures()["center"]
    with TemporaryDirectory(dir=OUT) as place:
        folder = Path(place)
        (folder / "images").mkdir()
        for file in files:
            (folder / "images" / file.name).hardlink_to(file)
        records = (
            {
                "cam/image_array": files[row % len(files)].name,
                "user/angle": turn,
                "user/throttle": 0.5,
                "_timestamp_ms": 1_600_000_000_000 + 50 * row,
            }
            for row, turn in enumerate(_turns(int(rows)))
        )
        write_catalogs(folder, [f"{json.dumps(one)}\n" for one in records], ["20-09-13_0"], 1.6e9)
        command = [sys.executable, "-m", "zoo.commands.check", str(folder)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    unit = 1e6 if sys.platform == "darwin" else 1e3
    figures = [f"{used.ru_utime + used.ru_stime:.0f}", f"{used.ru_maxrss / unit:,.0f}"]
    print_table(["rows", "s of a core", "MB at most"], [[f"{int(rows):,}", *figures]])


def _read_rates(name: str, folder: Path, keys: dict) -> list[str]:
    began = sum(os.times()[:4])
    recording = read_recordings(str(folder), **keys)
    read_s = sum(os.times()[:4]) - began
    for image in recording.images[:, 0]:
        read_image(image)
    rows = len(recording)
    del recording, image  # ends ffmpeg, whose time then counts
    decoded_s = sum(os.times()[:4]) - began - read_s
    return [name, f"{rows:,}", f"{read_s:.2f}", f"{rows / decoded_s:,.0f}"]


def _drawn(count: int) -> Iterator[bytes]:
    """Return the JPEGs of the centre camera, again and again."""
    files = [file.read_bytes() for file in pictures()["center"]]
    return (files[row % len(files)] for row in range(count))


def _turns(count: int) -> list[float]:
    return np.sin(np.arange(count) / 40).tolist()


def _video(folder: Path, count: int) -> None:
    video, motion_jpeg = str(folder / "out-video.avi"), cv2.VideoWriter_fourcc(*"MJPG")
    writer = cv2.VideoWriter(video, cv2.CAP_OPENCV_MJPEG, motion_jpeg, 20.0, (320, 160))
    for data in _drawn(count):
        writer.write(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))
    writer.release()
    lines = [f"{50 * row},{row + 1},{turn / 2}" for row, turn in enumerate(_turns(count))]
    (folder / "out-key.csv").write_text("\n".join(["ts_micro,frame,wheel", *lines, ""]))


def _hdf5(folder: Path, count: int) -> None:
    import h5py

    for name in ("camera", "log"):
        (folder / name).mkdir()
    with h5py.File(folder / "camera/a.h5", "w") as file:
        images = file.create_dataset("X", (count, 3, 160, 320), np.uint8, chunks=(1, 3, 160, 320))
        for row, data in enumerate(_drawn(count)):
            images[row] = decode_image(data).transpose(2, 0, 1)
    with h5py.File(folder / "log/a.h5", "w") as file:
        file["cam1_ptr"], file["steering_angle"] = np.arange(count), np.array(_turns(count))
        file["speed"], file["times"] = np.full(count, 9.0), np.arange(count) / 20


def _parquet(folder: Path, count: int) -> None:
    import pyarrow.parquet

    columns = pyarrow.table({"image": list(_drawn(count)), "turn": _turns(count)})
    pyarrow.parquet.write_table(columns, folder / "a.parquet")


def roads(count: str = "1000") -> int:
    """Draw roads of each family and let the expert drive them: `roads [ROADS]`.

    It prints the roads drawn per second on one core, and how many of the first roads the expert
    completes without leaving the road. No images are rendered. Seconds are processor time, so that
    other processes do not change them. 1,000 roads of three families take 15 minutes.
    """
    rows, failures = [], []
    for name in family_names():
        family, seeds = find_family(name), range(int(count))
        began = time.process_time()
        drawn = [draw_road(family, seed) for seed in seeds]
        per_second = len(drawn) / (time.process_time() - began)
        # Drawn again, because a driven road keeps a table of its samples, up to 1 MB.
        drives = [drive_road(draw_road(family, seed)) for seed in seeds]
        failed = [
            f"{road.name}: not completed, {most_m:.2f} m off the centreline"
            for road, (complete, most_m) in zip(drawn, drives, strict=True)
            if not complete
        ]
        cells = [name, f"{per_second:.0f}", f"{sum(road.length for road in drawn) / 1000:,.0f}"]
        cells.append(f"{np.mean([road.closed for road in drawn]):.0%}")
        cells.append(f"{len(drawn) - len(failed):,} of {len(drawn):,}")
        rows.append([*cells, f"{max(most_m for _, most_m in drives):.2f}"])
        failures += failed
    print_table(["family", "roads/s", "km", "loops", "expert completes", "max cte, m"], rows)
    print(*failures, sep="\n")
    return int(bool(failures))


def drive_road(road: Track) -> tuple[bool, float]:
    """Let the expert drive a road; return whether it completes it, and its largest error in m."""
    world, expert, most_m = Embedded(road), Expert(road), 0.0
    while not world.is_complete(1.0):
        world.step(*expert(world))
        most_m = max(most_m, abs(world.cte))
        if world.off_road or world.time > road.length / SLOWEST_MPS:
            return False, most_m
    return True, most_m


def expert(*tracks: str) -> None:
    """Measure how well the expert drives: `expert [TRACK...]`.

    It drives ten laps of each track in both directions, without noise and with three seeds of
    noise.
    """
    rows, laps = [], 10
    for track in tracks or track_names():
        for way in (1, -1):
            for noise, seed in ((0.0, 0), (1.0, 1), (1.0, 2), (1.0, 3)):
                world = open_world(track, "none", direction=way)
                driver = Expert(world.track, ExpertSettings(noise=noise, seed=seed))
                world.reset(seed)
                driver.reset(seed)
                errors, off = [], 0
                while not world.is_complete(laps):
                    world.step(*driver(world))
                    errors.append(abs(world.cte))
                    off += world.off_road
                cells = [f"{np.mean(errors):.3f}", f"{max(errors):.2f}", f"{world.time / laps:.1f}"]
                rows.append([track, f"{way:+d}", f"{noise:g}", seed, *cells, off])
    head = ["track", "direction", "noise", "seed", "mean cte, m", "max cte, m", "lap, s"]
    print_table([*head, "off road"], rows)


if __name__ == "__main__":
    run_named(
        exports,
        coverage,
        level_coverage,
        doubt,
        expert,
        formats,
        middle,
        qualities,
        replays,
        roads,
        secret_suite,
        speeds,
        storage,
        tub,
        warp,
    )
