"""The command `drivezoo simulator drive track=lake`: drive and record in a window."""

import datetime
import time
from pathlib import Path

from rich.console import Console

from simulator.command_options import DriveOptions
from simulator.drive_screen import HELP, DriveScreen
from simulator.hand_control import Gamepads, HandControl, Hands
from simulator.record import Driven, print_report
from simulator.recorder import Recorder
from simulator.rig import CAMERAS, PHYSICS_STEP_S
from simulator.window import Window
from simulator.world import Start, World

SHOWN_PER_S = 60.0
LONGEST_S = 0.1  # longest step of real time; on slower machines the world slows down


class Drive:
    """A person's drive and its recording.

    Args:
        world: world with a frame for each physics step of 0.02 s.
        screen: screen that the person watches.
        recorder: recorder of the rows while the person records.
        frame_rate: rows per second of simulated time.
    """

    def __init__(
        self, world: World, screen: DriveScreen, recorder: Recorder, frame_rate: float
    ) -> None:
        self.world, self.screen, self.row_s = world, screen, 1 / frame_rate
        self.control, self.gamepads = HandControl(), Gamepads()
        self.driven = Driven(world.track.length)
        self.recorder, self.is_recording = recorder, False
        self._began_s = self._next_row_s = 0.0
        self._before = world.pose()

    def run(self, seconds: float = 0.0) -> None:
        """Drive until the person quits, or for some seconds of simulated time above 0.

        Raises:
            InputError: the disk is full.
        """
        begin, owed_s = time.perf_counter(), 0.0
        while not seconds or self.world.time < seconds:
            hands = self._hands()
            while owed_s >= PHYSICS_STEP_S:
                owed_s -= PHYSICS_STEP_S
                self._step(hands)
            if not self._draw(owed_s / PHYSICS_STEP_S) or not self._handle_keys():
                break
            time.sleep(max(begin + 1 / SHOWN_PER_S - time.perf_counter(), 0))
            now = time.perf_counter()
            owed_s += min(now - begin, LONGEST_S)
            begin = now
        self.driven.seconds, self.driven.metres = self.world.time, abs(self.world.travelled)

    def _hands(self) -> Hands:
        window = self.screen.window
        return Hands(frozenset(window.held), window.pointer, *self.gamepads.read())

    def _step(self, hands: Hands) -> None:
        """Record a row if one is due, then drive for 0.02 s."""
        world = self.world
        command = self.control.step(PHYSICS_STEP_S, hands)
        if world.time >= self._next_row_s - 1e-6:
            self._next_row_s += self.row_s
            self._take_row(command)
        self._before = world.pose()
        world.step(*command)
        self.driven.note_lap(world)

    def _take_row(self, command: tuple[float, float]) -> None:
        """Show the centre camera's frame; record all cameras' frames while recording."""
        world, self.driven.frames = self.world, self.driven.frames + 1
        is_recorded = self.is_recording and not world.at_end
        cameras = CAMERAS if is_recorded else CAMERAS[:1]
        frames = {camera: world.frame(camera) for camera in cameras}
        self.screen.show_frame(frames[CAMERAS[0]])
        if is_recorded:
            seconds = world.time - self._began_s
            self.driven.add_row(self.recorder, world, frames, command, seconds)

    def _draw(self, part: float) -> bool:
        """Draw the world at a fraction between its last two steps, for smooth motion."""
        rows = self.recorder.rows
        if self.is_recording:
            status = f"REC   {rows:,} rows"
        else:
            status = f"paused   {rows:,} rows" if rows else "R: record"
        begun = rows or self.is_recording
        notice = self.recorder.folder.name if begun else "nothing is recorded yet"
        if self.world.at_end:
            notice = "the road ends here: press backspace to return to its begin"
        elif self.world.off_road:
            notice = "off the road: press backspace to return"
        elif self.control.cruising:
            notice = "cruising: space or the brake ends it"
        self.screen.show_status(status, self.is_recording, notice)
        pairs = zip(self._before, self.world.pose(), strict=True)
        pose = tuple(before + (after - before) * part for before, after in pairs)
        car = self.world.car
        return self.screen.draw(pose, car.speed_mph, self.control.steering, self.control.throttle)

    def _handle_keys(self) -> bool:
        """Handle the keys just pressed; return False to quit."""
        for key in self.screen.window.pressed:
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


def drive(options: DriveOptions, console: Console | None = None) -> tuple[Path, int] | None:
    """Let a person drive in a window.

    Returns:
        The recording's folder and its number of rows off the road; None without rows.

    Raises:
        InputError: an option is wrong, no window opens, or the recording cannot be written.
    """
    console = console or Console(soft_wrap=True)
    options.check()
    world = options.open(frame_rate=1 / PHYSICS_STEP_S)
    folder = Path(options.out)
    if options.out == "auto":
        folder = Path("recordings", f"{datetime.datetime.now():%Y-%m-%d_%H-%M-%S}")
    began = time.perf_counter()
    with Recorder(folder, options.header, options.relative) as recorder:
        title = f"{world.track.name}, drivezoo simulator drive"
        window = Window(title, (options.width, options.width // 2))
        screen = DriveScreen(window, world.renderer, world.weather)
        run = Drive(world, screen, recorder, options.frame_rate)
        console.print(HELP.replace("     ", "\n"), highlight=False, markup=False)
        try:
            run.run(options.seconds)
        finally:
            window.close()
    if not recorder.rows:
        console.print("nothing was recorded; press R while driving to record")
        return None
    took = time.perf_counter() - began
    print_report(console, recorder, [run.driven], took, world.renderer.name)
    return recorder.folder, run.driven.off_road
