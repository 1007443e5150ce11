"""The highest speed at which a network drives with the times of a loop, and what would help."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from statistics import median

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from zoo.base.console_progress import progress_bar
from zoo.base.file_text import plot_text
from zoo.base.new_folder import command_folder
from zoo.base.process_pool import Pool, opened_pool
from zoo.base.terminal import print_line, print_written, printable
from zoo.base.whole_file import json_text, write_whole
from zoo.checkpoints.checkpoint_path import short_name
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.driving.intervals import Estimate, median_interval
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.extras.car.loop_times import LoopTimes
from zoo.extras.car.timing_options import TimingOptions
from zoo.runs.plots import BLUE, GREY, ORANGE, NotebookFigure, plain_axis, save_figure
from zoo.runs.result_table import Column, Table, interval_column, number_column, with_interval
from zoo.runs.table_files import Result
from zoo.scoring.evidence import other_car_line

VERSION = 1  # of timing.json
RESULT, PLOT = "timing.json", "timing.png"
MEASURED = "as measured"
COLUMNS = ("times", "rate_hz", "delay_ms", "speed_mph", "gain_mph", "every_road_mph")


@dataclass(frozen=True, repr=False)
class Timing(Result):
    """Highest speeds without an intervention, with measured and with improved loop times.

    Attributes:
        checkpoint: name of the checkpoint.
        options: options of the search.
        times: loop times by what was improved; the first are those measured.
        speeds: highest clean speed of each road, in whole mph, by the same names; one less than
            the lowest speed that was tried where none was clean.
        written: paths of the files written.
    """

    checkpoint: str
    options: TimingOptions
    times: Mapping[str, LoopTimes]
    speeds: Mapping[str, Sequence[int]]
    written: list[Path] = field(default_factory=list)

    @property
    def lines(self) -> list[str]:
        """Return the highest speed and what would help most, in sentences."""
        options, measured = self.options, self.speeds[MEASURED]
        by_road = zip(*self.speeds.values(), strict=True)
        bounds = sum(min(road) < options.least or max(road) == options.most for road in by_road)
        bounded = (
            f"on {bounds} of {options.roads} roads a speed is only known to be below "
            f"{options.least} or at least {options.most} mph: gains there may be larger"
        )
        return [
            f"{self.checkpoint} drives without an intervention up to {self._speed(MEASURED)} on "
            f"the median of {options.roads} {options.family} roads, and up to "
            f"{self._mph(min(measured))} on each of them",
            self.advice,
            *([bounded] if bounds and min(measured) < options.most else []),
        ]

    @property
    def advice(self) -> str:
        """Return which one improvement raises the speed most, if any surely does."""
        if min(self.speeds[MEASURED]) >= self.options.most:
            return "it drives the highest speed that was tried on each road: nothing to improve"
        gains = {name: self.gain(name) for name in self.speeds if name != MEASURED}
        surely = {name: gain for name, gain in gains.items() if gain.low > 0 and name != "both"}
        both = f"; both, as of a computer twice as fast: {_difference(gains['both'])}"
        if not surely:
            return f"no single improvement raises the speed on nearly all roads{both}"
        best = max(surely, key=lambda name: surely[name].value)
        return f"what helps most: {best}, {_difference(surely[best])}{both}"

    def gain(self, name: str) -> Estimate:
        """Return the median gain of an improvement over the roads, in mph."""
        pairs = zip(self.speeds[name], self.speeds[MEASURED], strict=True)
        return _median([mph - measured for mph, measured in pairs])

    def __repr__(self) -> str:
        return "\n".join([f"Timing of {self.checkpoint}", *(f"  {line}" for line in self.lines)])

    def show(self) -> None:
        """Print the table, the sentences and what was written."""
        console = Console(emoji=False, soft_wrap=True)
        console.print(self.result_table().narrow().printed(left=1))
        for line in self.lines:
            print_line(console, printable(line))
        print_written(self.written, console=console)

    def result_table(self) -> Table:
        """Return a row for the measured times, and for each improvement."""
        names, times = list(self.speeds), self.times.values()
        delays = [time.delay_ms + 1000 * self.options.delay_s for time in times]
        speeds = [_median(speed) for speed in self.speeds.values()]
        gains = [self.gain(name) for name in names]
        least = [min(speed) for speed in self.speeds.values()]
        highest = interval_column("speed_mph", "highest speed, mph", speeds, "{:g}")
        every = number_column("every_road_mph", "every road, mph", least)
        columns = [
            Column("times", "loop times", names),
            number_column("rate_hz", "frames/s", [time.rate_hz for time in times], "{:.1f}"),
            number_column("delay_ms", "delay, ms", delays, "{:.0f}"),
            replace(highest, cells=list(map(self._text, speeds))),
            interval_column("gain_mph", "gain, mph", gains, "{:+g}"),
            replace(every, cells=[self._text(Estimate(mph)) for mph in least]),
        ]
        return Table(columns, f"Highest clean speeds of {self.checkpoint}, median of the roads.")

    def _text(self, speed: Estimate) -> str:
        """Return a speed with its interval; one that was not tried is a bound."""
        least = self.options.least
        text = with_interval(speed, "{:g}").replace(f"({least - 1} to", f"(below {least} to")
        return f"below {least}" if speed.value < least else text

    def plot(self) -> Figure:
        """Draw the loop times, and the highest speeds with their intervals."""
        measured, options = self.times[MEASURED], self.options
        figure = NotebookFigure(figsize=(10, 4.2), layout="constrained")
        title = (
            f"{self.checkpoint} on {options.family}: up to {self._speed(MEASURED)} at "
            f"{measured.rate_hz:.1f} frames per second"
        )
        figure.suptitle(plot_text(title))
        left, right = figure.subplots(1, 2, width_ratios=[1, 1.4])
        longest_ms = max(measured.loop_ms.max(), np.nanmax(measured.latency_ms))
        edges = np.linspace(0, longest_ms * 1.05, 41)
        left.hist(measured.loop_ms, edges, color=GREY, label="frame to next frame")
        left.hist(
            measured.latency_ms[~measured.lost],
            edges,
            histtype="step",
            color=ORANGE,
            lw=1.6,
            label="frame to steering",
        )
        left.set(xlabel="ms", ylabel="loops", title="measured loop times")
        left.legend(frameon=False)
        for row, (name, speeds) in enumerate(self.speeds.items()):
            colour = BLUE if name == MEASURED else GREY
            right.plot(median_interval(speeds), [row, row], color=colour, lw=2)
            right.plot(median(speeds), row, "o", color=colour)
            right.plot(speeds, [row + 0.22] * len(speeds), "|", color=colour, alpha=0.6)
        right.set_yticks(range(len(self.speeds)), list(self.speeds))
        right.set(
            xlabel="highest speed without an intervention, mph",
            xlim=(0, options.most + 1),
            ylim=(len(self.speeds) - 0.5, -0.5),
            title="median of the roads, 95 % interval; a stroke is a road",
        )
        plain_axis(left)
        plain_axis(right, "x")
        return figure

    def content(self) -> dict:
        """Return the content of `timing.json`."""
        return {
            "version": VERSION,
            "checkpoint": self.checkpoint,
            "options": asdict(self.options),
            "times": self.times[MEASURED].name,
            "rows": self.table(),
            "speeds_mph": {name: list(speeds) for name, speeds in self.speeds.items()},
            "lines": self.lines,
        }

    def _mph(self, speed: float) -> str:
        if speed < self.options.least:
            return f"less than {self.options.least:g} mph"
        return f"{speed:g} mph"

    def _speed(self, name: str) -> str:
        """Return the median speed with its interval, such as `17 (14 to 20) mph`."""
        estimate = _median(self.speeds[name])
        if estimate.value < self.options.least:
            return self._mph(estimate.value)
        return f"{self._text(estimate)} mph"


def _median(values: Sequence[int]) -> Estimate:
    return Estimate(float(median(values)), *median_interval(values))


def _difference(gain: Estimate) -> str:
    return f"{with_interval(gain, '{:+g}')} mph"


def find_highest_speeds(
    checkpoint: str, measured: LoopTimes, options: TimingOptions, console: Console
) -> Timing:
    """Search the highest speeds of a checkpoint, and write the result.

    Raises:
        UsageError: an option is wrong.
        InputError: the checkpoint cannot be used.
    """
    options.check_files(COLUMNS)
    roads = options.scenarios()
    times = {MEASURED: measured, **measured.improved()}
    policy = load_policy(checkpoint)  # reports a wrong file before processes start
    print_line(console, printable(f"{measured.name}: {measured.words}"))
    if line := other_car_line(policy.data, options.family):
        print_line(console, printable(line))
    with command_folder(options.out, "timings") as folder:
        scenarios = [replace(road, loop=time.loop) for time in times.values() for road in roads]
        with (
            opened_pool(options.workers, most=len(scenarios)) as pool,
            progress_bar("search for the highest speed", console) as show,
        ):
            speeds = highest_speeds(checkpoint, scenarios, options.least, options.most, pool, show)
        by_name = np.array(speeds).reshape(len(times), options.roads).tolist()
        result = Timing(
            short_name(Path(checkpoint)), options, times, dict(zip(times, by_name, strict=True))
        )
        result.written.append(write_whole(folder / RESULT, json_text(result.content())))
        result.written.append(save_figure(result.plot(), folder / PLOT))
        result.written.extend(options.write_files(result))
    return result


def highest_speeds(
    checkpoint: str,
    scenarios: Sequence[Scenario],
    least: int,
    most: int,
    pool: Pool | None = None,
    show: Callable[[float], None] = lambda share: None,
) -> list[int]:
    """Return the highest speed of each scenario without an intervention, by bisection.

    It takes for granted that a network which fails at a speed fails at higher ones.

    Args:
        checkpoint: path of the checkpoint.
        scenarios: scenarios to drive, at other speeds than their own.
        least: lowest speed, in whole mph.
        most: highest speed, in whole mph.
        pool: open pool of processes.
        show: function called with the finished share.

    Returns:
        Speeds in whole mph; `least - 1` where the lowest is not clean.
    """
    clean, failed = [least - 1] * len(scenarios), [most + 1] * len(scenarios)
    rounds = int(np.ceil(np.log2(most - least + 2)))
    for number in range(rounds):
        tried = [
            (index, (low + high) // 2)
            for index, (low, high) in enumerate(zip(clean, failed, strict=True))
            if high - low > 1
        ]
        speeds = [replace(scenarios[index], speed=float(speed)) for index, speed in tried]
        drives = all_drives(checkpoint, speeds, first_only=True, pool=pool)
        for (index, speed), drive in zip(tried, drives, strict=True):
            (failed if drive.intervention.any() else clean)[index] = speed
        show((number + 1) / rounds)
    return clean
