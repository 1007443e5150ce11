"""The command `drivezoo simulator drive track=lake`: drive and record on a page."""

import datetime
import functools
import time
from contextlib import closing, nullcontext, suppress
from pathlib import Path

from rich.console import Console

from zoo.base.terminal import print_line, shown_path
from zoo.simulator.command_options import DriveOptions
from zoo.simulator.hand_control import HandControl, Hands
from zoo.simulator.hand_page import Seat, served_seat
from zoo.simulator.record import Driven, print_report
from zoo.simulator.recorder import Recorder
from zoo.simulator.simulated_world import Start, World
from zoo.simulator.udacity_car import CAMERAS, PHYSICS_STEP_S

SHOWN_PER_S = 30.0
LONGEST_S = 0.1  # longest step of real time; on slower machines the world slows down


class Drive:
    """A person's drive and its recording.

    Args:
        world: world with a frame for each physics step of 0.02 s.
        seat: seat of the person; time passes only while a page shows the drive.
        recorder: recorder of the rows while the person records.
        frame_rate: rows per second of simulated time.
    """

    def __init__(self, world: World, seat: Seat, recorder: Recorder, frame_rate: float) -> None:
        self.world, self.seat, self.row_s = world, seat, 1 / frame_rate
        self.control = HandControl()
        self.driven = Driven(world.track.length)
        self.recorder, self.is_recording = recorder, False
        self._began_s = self._next_row_s = 0.0
        self._before = world.pose()

    def run(self, seconds: float = 0.0) -> None:
        """Drive until the person ends it, or for some seconds of simulated time above 0.

        Raises:
            InputError: the disk is full.
        """
        begin, owed_s = time.perf_counter(), 0.0
        self._show(0.0)
        with suppress(KeyboardInterrupt):  # ends the drive, as the page's End does
            while not seconds or self.world.time < seconds:
                hands = self.seat.hands
                while owed_s >= PHYSICS_STEP_S:
                    owed_s -= PHYSICS_STEP_S
                    self._step(hands)
                if self.seat.watched:
                    self._show(owed_s / PHYSICS_STEP_S)
                if not self._handle_keys():
                    break
                time.sleep(max(begin + 1 / SHOWN_PER_S - time.perf_counter(), 0))
                now = time.perf_counter()
                owed_s += min(now - begin, LONGEST_S) if self.seat.watched else 0.0
                begin = now
        self.driven.seconds, self.driven.metres = self.world.time, abs(self.world.travelled)

    def _step(self, hands: Hands) -> None:
        """Record a row if one is due, then drive for 0.02 s."""
        world = self.world
        command = self.control.step(PHYSICS_STEP_S, hands)
        if world.time >= self._next_row_s - 1e-6:
            self._next_row_s += self.row_s
            self.driven.frames += 1
            if self.is_recording and not world.at_end:
                frames = {camera: world.frame(camera) for camera in CAMERAS}
                seconds = world.time - self._began_s
                self.driven.add_row(self.recorder, world, frames, command, seconds)
        self._before = world.pose()
        world.step(*command)
        self.driven.note_lap(world)

    def _show(self, part: float) -> None:
        """Show the world at a fraction between its last two steps, for smooth motion."""
        world, control, laps = self.world, self.control, self.driven.lap_ends_s
        notice = ""
        if world.at_end:
            notice = "The road ends here: put the car back to its begin"
        elif world.off_road:
            notice = "Off the road: put the car back"
        pairs = zip(self._before, world.pose(), strict=True)
        x, y, z, heading, pitch = (before + (after - before) * part for before, after in pairs)
        self.seat.show(
            world.drawing().frame((x, y, z, heading, pitch), CAMERAS[0], world.frames),
            speed_mph=world.car.speed_mph,
            steering=control.steering,
            throttle=control.throttle,
            lap=world.lap + 1,
            lap_s=world.time - (laps[-1] if laps else 0.0),
            last_lap_s=self.driven.lap_s[-1] if laps else None,
            recording=self.is_recording,
            rows=self.recorder.rows,
            folder=shown_path(self.recorder.folder),
            cruising=control.cruising,
            notice=notice,
        )

    def _handle_keys(self) -> bool:
        """Handle the keys just pressed; return False to quit."""
        for key in self.seat.pressed():
            if key == "escape":
                return False
            if key == "r":
                self.is_recording = not self.is_recording
                self._begin_pass()
            elif key == "space":
                self.control.cruising = not self.control.cruising
            elif key == "backspace":
                self._put_back()
        return True

    def _begin_pass(self) -> None:
        self.recorder.begin_pass()
        self._began_s = self.world.time

    def _put_back(self) -> None:
        """Put the car on the centreline beside its place; the recording gets a gap there.

        From the end of an open road it returns to the road's begin.
        """
        world = self.world
        world.put_back(Start(None if world.at_end else world.place.distance))
        self.control.release()
        self.control.cruising = False
        self._before = world.pose()
        self._begin_pass()


def drive(
    options: DriveOptions, console: Console | None = None, seat: Seat | None = None
) -> tuple[Path, int] | None:
    """Let a person drive on a page.

    Args:
        options: options of the drive.
        console: console for messages to the user.
        seat: seat whose page is served already; None serves one on this machine.

    Returns:
        The recording's folder and its number of rows off the road; None without rows.

    Raises:
        InputError: an option is wrong, the port is in use, or the recording cannot be written.
    """
    console = console or Console(soft_wrap=True)
    options.check()
    folder = Path(options.out)
    if options.out == "auto":
        folder = Path("recordings", f"{datetime.datetime.now():%Y-%m-%d_%H-%M-%S}")
    say = functools.partial(print_line, console)
    purpose = " and drive; End, or Ctrl-C here, ends the drive"
    began = time.perf_counter()
    with (
        closing(options.open(frame_rate=1 / PHYSICS_STEP_S)) as world,
        Recorder(folder, options.header, options.relative) as recorder,
        nullcontext(seat) if seat else served_seat(say, options.port, purpose) as taken,
    ):
        run = Drive(world, taken, recorder, options.frame_rate)
        run.run(options.seconds)
        renderer = world.drawing().name
    if not recorder.rows:
        console.print("nothing was recorded; press R while driving to record")
        return None
    print_report(console, recorder, [run.driven], time.perf_counter() - began, renderer)
    return recorder.folder, run.driven.off_road
