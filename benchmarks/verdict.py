"""Measure a first training from Enter to its verdict: `make bench ONLY=verdict`.

The whole command is compared with the sum of what no program can avoid: imports, decoding once and
rendering the lap, both on all cores, and the steps of a bare loop. The figures of the first row are
the stages of the command, from one line that it prints to the next.
"""

import itertools
import subprocess
import sys
import tempfile
import time
from multiprocessing.connection import Connection

import torch

from benchmarks.cache import decode_in_one_thread
from benchmarks.material import OUT, linked_recording, random_network
from benchmarks.measuring import Row, contestants, medians, ratios, seconds_of, take_turns
from benchmarks.start import IMPORTS, run_python
from benchmarks.training import BATCH, ROUND_S, answer, bare_step, rate
from zoo.base.machine import usable_cores
from zoo.base.rig import MPS_PER_MPH
from zoo.driving.open_world import open_world
from zoo.driving.scenario import Scenario
from zoo.simulator.simulated_world import Start

LAP, SAMPLES, AIM_S, FRAMES = OUT / "lap", 72_000, 25.0, 100  # a lap has some 2,700 rows
# Words that the command prints when a stage ends; the last one ends with the process.
STAGES = {
    "imports, reading s": "cameras, ",
    "network, plan s": "plan: ",
    "views, training s": "epoch   3/3",
    "candidates s": "best.ckpt is of epoch",
    "rows, plots s": "recovery response",
    "lap s": "drove ",
}
WHOLE, REPORT, BARE = "Enter to verdict s", "report, film s", "bare loop s"


def measure(short: bool) -> list[Row]:
    """Return the seconds of `experiment=first_try`, with decoding, relative to its parts and to 25.

    The recording is a lap of the lake by the expert, with three cameras.
    """
    folder, rounds = (linked_recording(200), 1) if short else (LAP, 3)
    if not (folder / "driving_log.csv").is_file():
        record = ["zoo.commands.simulator", "record", "track=lake", "laps=1", "speed=15"]
        subprocess.run([sys.executable, "-m", *record, f"out={folder}"], check=True)
    images = sorted(map(str, (folder / "IMG").iterdir()))
    words = ["experiment=first_try", f"data.root={folder}", *["quick=true"] * short]
    parts = {
        "imports s": lambda: run_python(["-c", IMPORTS])[0],
        "decoding s": lambda: seconds_of(lambda: decode_in_one_thread(images)) / usable_cores(),
        "rendering s": rendering,
    }
    with contestants({BARE: (run_lenet,)}, asleep=[BARE]) as bare:
        measures = {"stages": lambda: stages(words), **parts, **bare}
        turns = take_turns(measures, rounds)
    seconds: dict[str, list[float]] = {
        name: [stages[name] for stages in turns["stages"]] for name in turns["stages"][0]
    }
    apart = {name: turns[name] for name in (*parts, BARE)}
    sums = [sum(values) for values in zip(*apart.values(), strict=True)]
    what = "drivezoo train experiment=first_try, from Enter to the verdict"
    against = "imports + decoding + bare loop + rendering"
    whole = seconds[WHOLE]
    return [
        Row(what, against, ratios(whole, sums), None, False, medians(seconds | apart)),
        Row(what, f"{AIM_S:g} s", [medians(seconds)[WHOLE] / AIM_S], 1.0, False, {}),
    ]


def stages(words: list[str]) -> dict[str, float]:
    """Return the seconds of each stage of a training, and of the whole command."""
    times = [time.perf_counter()]
    with tempfile.TemporaryDirectory(dir=OUT) as folder:
        command = [sys.executable, "-m", "zoo", *words, f"data.cache={folder}/cache"]
        command.append(f"hydra.run.dir={folder}/run")
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            waiting = list(STAGES.values())
            for line in process.stdout or []:
                if waiting and waiting[0] in line:
                    times.append(time.perf_counter())
                    waiting.pop(0)
    if process.returncode or waiting:
        raise RuntimeError(f"{command}: exit status {process.returncode}; not printed: {waiting}")
    times.append(time.perf_counter())
    seconds = [after - before for before, after in itertools.pairwise(times)]
    return {WHOLE: times[-1] - times[0]} | dict(zip([*STAGES, REPORT], seconds, strict=True))


def run_lenet(pipe: Connection) -> None:
    """Send the seconds of a bare loop over as many samples of LeNet, at each request."""
    network, view, _ = random_network("lenet")
    images = torch.randint(0, 255, (BATCH, *view.shape), dtype=torch.uint8).permute(0, 3, 1, 2)
    batch = {"images": images, "targets": torch.rand(BATCH, 1)}
    step, feed = bare_step(network, fused=True), itertools.repeat(batch)
    answer(pipe, lambda: SAMPLES / rate(step, feed, ROUND_S))


def rendering() -> float:
    """Return the seconds that all cores need to render a lap's frames."""
    scenario = Scenario("lake", speed=15.0)
    world = open_world(scenario)
    simulated, seconds = world.simulated, 0.0
    for place in range(FRAMES):
        simulated.put_back(Start(simulated.track.length * place / FRAMES))
        seconds += seconds_of(world.frame)
    world.close()
    frames = simulated.track.length / (scenario.speed * MPS_PER_MPH) * scenario.frame_rate
    return frames * seconds / FRAMES / usable_cores()
