"""`python -m simulator drive track=lake`: a window to drive in, and to record what was driven."""

import datetime
import shlex
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from simulator.command_line import read_options
from simulator.drive_screen import HELP, DriveScreen
from simulator.errors import SimulatorError
from simulator.gamepad import Gamepads
from simulator.hand_control import HandControl, Hands
from simulator.record_report import Driven, print_report
from simulator.recorder import LOG_NAME, Recorder, check_free, split_pedals
from simulator.rig import CAMERAS, PHYSICS_STEP_S
from simulator.weather import CLEAR
from simulator.window import Window
from simulator.world import Start, World, open_world

DIRECTIONS = {"forward": 1, "1": 1, "backward": -1, "-1": -1}
SHOWN_PER_S = 60.0
LONGEST_S = 0.1  # that a picture may take; on a slower machine the world goes slower, too


@dataclass(frozen=True)
class DriveOptions:
    """Drive in a window, with keyboard, mouse or gamepad; R starts and stops recording.

    Args:
        track: its name, or the path of a track's YAML file.
        out: the folder to record to; auto is recordings/ and the time when R is first pressed.
        direction: forward or backward.
        weather: clear, or random for a day drawn from the seed.
        seed: of the weather.
        start: metres along the lap.
        frame_rate: rows per second, up to 50.
        width: of the window, in pixels; it is half as high.
        renderer: of the recorded pictures: auto, software or opengl.
        header: begin the log with the columns' names, as the course's sample data does.
        relative: write paths beginning with IMG/, not this machine's.
        seconds: quit after so much driving; 0 never.
    """

    track: str = "lake"
    out: str = "auto"
    direction: str = "forward"
    weather: str = "clear"
    seed: int = 0
    start: float = 0.0
    frame_rate: float = 15.0
    width: int = 1280
    renderer: str = "auto"
    header: bool = False
    relative: bool = False
    seconds: float = 0.0


class Drive:
    """A person's drive, and the recording made of it."""

    def __init__(self, world: World, screen: DriveScreen, options: DriveOptions) -> None:
        self.world, self.screen, self.options = world, screen, options
        self.control, self.gamepads = HandControl(), Gamepads()
        self.driven = Driven(world.track.length)
        self.recorder: Recorder | None = None
        self.is_recording = False
        self._began_s = self._lap_began_s = self._next_row_s = 0.0
        self._before = world.pose()

    def run(self, recorders: ExitStack) -> None:
        """Drive until the person quits; a recorder that is opened goes on the stack.

        Raises:
            SimulatorError: the recording's folder cannot be written, or the disk is full.
        """
        begin, owed_s, seconds = time.perf_counter(), 0.0, self.options.seconds
        while not seconds or self.world.time < seconds:
            hands = self._hands()
            while owed_s >= PHYSICS_STEP_S:
                owed_s -= PHYSICS_STEP_S
                self._step(hands)
            if not self._draw(owed_s / PHYSICS_STEP_S) or not self._obey(recorders):
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
        """Drive for 0.02 s, after the row that is due."""
        world = self.world
        steering, throttle = self.control.step(PHYSICS_STEP_S, hands)
        if world.time >= self._next_row_s - 1e-6:
            self._next_row_s += 1 / self.options.frame_rate
            self._take_row(steering, throttle)
        self._before, lap = world.pose(), world.lap
        world.step(steering, throttle)
        if world.lap > lap:
            self.driven.lap_s.append(world.time - self._lap_began_s)
            self._lap_began_s = world.time

    def _take_row(self, steering: float, throttle: float) -> None:
        """Show what the centre camera sees; record it with the others' pictures."""
        world, self.driven.frames = self.world, self.driven.frames + 1
        cameras = CAMERAS if self.is_recording else CAMERAS[:1]
        frames = {camera: world.frame(camera) for camera in cameras}
        self.screen.show_frame(frames[CAMERAS[0]])
        if self.is_recording:
            pedals = split_pedals(throttle)
            seconds = world.time - self._began_s
            self.recorder.add(frames, steering, *pedals, world.car.speed_mph, seconds)
            self.driven.cte.append(world.cte)
            self.driven.steering.append(steering)

    def _draw(self, part: float) -> bool:
        """Show the world between the last two steps, or the car would judder."""
        rows = self.recorder.rows if self.recorder else 0
        if self.is_recording:
            said = f"REC   {rows:,} rows"
        else:
            said = f"paused   {rows:,} rows" if rows else "R: record"
        notice = self.recorder.folder.name if self.recorder else "nothing is recorded yet"
        if self.world.off_road:
            notice = "off the road: backspace puts you back"
        elif self.control.cruising:
            notice = "cruising: space or the brake ends it"
        self.screen.say(said, self.is_recording, notice)
        pairs = zip(self._before, self.world.pose(), strict=True)
        pose = tuple(before + (after - before) * part for before, after in pairs)
        car = self.world.car
        return self.screen.draw(pose, car.speed_mph, self.control.steering, self.control.throttle)

    def _obey(self, recorders: ExitStack) -> bool:
        """What the keys just pressed ask for; False to quit."""
        for key in self.screen.window.pressed:
            if key == "escape":
                return False
            if key == "r":
                self._toggle_recording(recorders)
            elif key == "space":
                self.control.cruising = not self.control.cruising
            elif key == "backspace":
                self._put_back()
        return True

    def _toggle_recording(self, recorders: ExitStack) -> None:
        self.is_recording = not self.is_recording
        if self.recorder is None:
            options = self.options
            recorder = Recorder(_folder(options.out), options.header, options.relative)
            self.recorder = recorders.enter_context(recorder)
        self._begin_pass()

    def _begin_pass(self) -> None:
        if self.recorder is not None:
            self.recorder.begin_pass()
        self._began_s = self.world.time

    def _put_back(self) -> None:
        """On the centreline, where it left it; readers of the recording see a gap."""
        self.world.put_back(Start(self.world.place.distance))
        self.control.release()
        self.control.cruising = False
        self._before = self.world.pose()
        self._begin_pass()


def drive(options: DriveOptions, console: Console | None = None) -> Path | None:
    """Open the window and let a person drive; the recording's folder, None where there is none.

    Raises:
        SimulatorError: an option cannot be, no window opens, or the recording cannot be written.
    """
    console = console or Console(soft_wrap=True)
    world = _open(options)
    title = f"{world.track.name}, python -m simulator drive"
    window = Window(title, (options.width, options.width // 2))
    run = Drive(world, DriveScreen(window, world.pictures, world.weather), options)
    console.print(HELP.replace("     ", "\n"), highlight=False, markup=False)
    began = time.perf_counter()
    try:
        with ExitStack() as recorders:
            run.run(recorders)
    finally:
        window.close()
    if run.recorder is None or not run.recorder.rows:
        console.print("nothing was recorded: R starts a recording")
        return None
    took = time.perf_counter() - began
    print_report(console, run.recorder, [run.driven], took, world.pictures.name)
    return run.recorder.folder


def main(arguments: Sequence[str]) -> None:
    """The command: `key=value` arguments, see `DriveOptions`."""
    folder = drive(read_options(DriveOptions, arguments))
    if folder is None:
        return
    here = Path.cwd()
    root = folder.relative_to(here) if folder.is_relative_to(here) else folder
    command = shlex.join(["python", "-m", "zoo", f"data.root={root}"])
    for line in (str(folder / LOG_NAME), f"train on it: {command}"):
        Console(soft_wrap=True).print(line, highlight=False, markup=False)


def _open(options: DriveOptions) -> World:
    if options.direction not in DIRECTIONS:
        raise SimulatorError(f"direction={options.direction}: must be forward or backward")
    if options.weather not in ("clear", "random"):
        raise SimulatorError(f"weather={options.weather}: must be clear or random")
    if options.renderer == "none":
        raise SimulatorError("renderer=none: a recording needs pictures; try renderer=auto")
    if not 0 < options.frame_rate <= 1 / PHYSICS_STEP_S:
        raise SimulatorError(f"frame_rate={options.frame_rate:g}: must be above 0, up to 50")
    if not 320 <= options.width <= 7680:
        raise SimulatorError(f"width={options.width}: must be in 320..7680 pixels")
    if not 0 <= options.seconds < float("inf"):
        raise SimulatorError(f"seconds={options.seconds:g}: must be 0 or more")
    check_free(_folder(options.out))
    world = open_world(
        options.track,
        options.renderer,
        frame_rate=1 / PHYSICS_STEP_S,
        direction=DIRECTIONS[options.direction],
    )
    weather = CLEAR if options.weather == "clear" else options.weather
    world.reset(options.seed, Start(options.start), weather)
    return world


def _folder(out: str) -> Path:
    """`out`, or a folder named for this moment."""
    moment = datetime.datetime.now()
    return Path("recordings", f"{moment:%Y-%m-%d_%H-%M-%S}") if out == "auto" else Path(out)
