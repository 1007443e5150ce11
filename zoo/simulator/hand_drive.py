"""The command `drivezoo simulator drive track=lake`: drive and record in a window."""

import datetime
import time
from pathlib import Path

import matplotlib
import numpy as np
from rich.console import Console

from zoo.base.terminal import counted
from zoo.simulator.command_options import DriveOptions
from zoo.simulator.hand_control import Gamepads, HandControl, Hands
from zoo.simulator.panda import core
from zoo.simulator.record import Driven, print_report
from zoo.simulator.recorder import Recorder
from zoo.simulator.renderer import Renderer, camera_lens, set_view
from zoo.simulator.scenery.frame_effects import FOG_RGB, bonnet_image
from zoo.simulator.simulated_world import Start, World
from zoo.simulator.udacity_car import CAMERAS, PHYSICS_STEP_S
from zoo.simulator.weather import Weather
from zoo.simulator.window import ImagePanel, Window

SHOWN_PER_S = 60.0
LONGEST_S = 0.1  # longest step of real time; on slower machines the world slows down
HELP = (
    "arrows or W A S D: drive     left mouse button held, moved sideways: steer     "
    "space: cruise     R: record     backspace: back on the road     Esc: quit"
)
WHITE, GREY, RED = (1, 1, 1, 1), (0.85, 0.85, 0.85, 1), (1, 0.25, 0.2, 1)
DARK = (0.05, 0.06, 0.08, 0.6)
HELP_SIZE = 0.036  # the help fills a window that is twice as wide as high
INSET_WIDTH = 0.9  # in units of half the window's height, as all lengths here
BAR_WIDTH = 0.5  # half the width of the steering bar
FINE = 4  # rows of the drawn bonnet for one of the camera's rows


class DriveScreen:
    """The content of the drive's window."""

    def __init__(self, window: Window, renderer: Renderer, weather: Weather) -> None:
        self.window, self.renderer = window, renderer
        self.lens = camera_lens()
        self.camera = renderer.root.attachNewNode(core.Camera("driver", self.lens))
        self.camera.node().setInitialState(_weather_state(weather))
        window.window.makeDisplayRegion().setCamera(self.camera)
        # In Panda3D's default font a zero looks like an o.
        font = Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")
        core.TextProperties.setDefaultFont(
            core.DynamicTextFont(core.Filename.fromOsSpecific(str(font)))
        )
        flat = window.flat
        flat.setBin("unsorted", 0)  # draws nodes in the order of their creation
        colour, cover = bonnet_image("center", FINE)
        lit = np.concatenate([colour * weather.brightness, 255 * cover], -1)
        ImagePanel(flat, -2, -1, 4).show(lit.clip(0, 255).astype(np.uint8))
        self.corner = flat.attachNewNode("top right")
        self.left = flat.attachNewNode("top left")
        top = 0.96 - INSET_WIDTH / 2
        _box(self.corner, (-INSET_WIDTH - 0.01, 0.01), (top - 0.09, 0.97), DARK)
        self.inset = ImagePanel(self.corner, -INSET_WIDTH, top, INSET_WIDTH)
        caption = _text(self.corner, -INSET_WIDTH / 2, top - 0.06, 0.037)
        _set_text(caption, "centre camera, as recorded", GREY)
        _box(self.left, (0, 0.95), (0.71, 0.97), DARK)
        self.recording = _text(self.left, 0.05, 0.87, 0.065, core.TextNode.ALeft)
        self.notice = _text(self.left, 0.05, 0.765, 0.042, core.TextNode.ALeft)
        self.speed = _text(flat, 0, -0.66, 0.15)
        _box(flat, (-BAR_WIDTH, BAR_WIDTH), (-0.775, -0.755), DARK)
        self.wheel = _box(flat, (-0.02, 0.02), (-0.79, -0.74), WHITE)
        self.steering = _text(flat, 0, -0.86, 0.042)
        self.help_box = _box(flat, (-1, 1), (-1, -0.93), DARK)
        self.help = _text(flat, 0, -0.98, HELP_SIZE)
        _set_text(self.help, HELP, GREY)

    def show_frame(self, frame: np.ndarray) -> None:
        """Show a frame in the corner: uint8 [160, 320, 3], RGB."""
        self.inset.show(frame)

    def show_status(self, recording: str, is_recording: bool, notice: str) -> None:
        """Show two lines in the upper left corner."""
        _set_text(self.recording, recording, RED if is_recording else WHITE)
        _set_text(self.notice, notice, GREY)

    def draw(
        self,
        pose: tuple[float, float, float, float, float],
        speed_mph: float,
        steering: float,
        throttle: float,
    ) -> bool:
        """Draw the world from a pose of `World.pose`; return False when the window is closed."""
        aspect = self.window.aspect
        self.corner.setX(aspect - 0.03)
        self.left.setX(-aspect + 0.03)
        self.help_box.setSx(aspect)
        self.help.setScale(HELP_SIZE * min(aspect / 2, 1))
        set_view(self.lens, aspect, self.renderer.fov_deg)
        self.renderer.place_camera(self.camera, pose, "center")
        _set_text(self.speed, f"{speed_mph:.0f} mph", WHITE)
        self.wheel.setX(steering * BAR_WIDTH)
        pedal = "brake" if throttle < 0 else "throttle"
        _set_text(self.steering, f"steering {steering:+.2f}     {pedal} {abs(throttle):.2f}", WHITE)
        return self.window.draw()


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
            status = f"REC   {counted(rows, 'row')}"
        else:
            status = f"paused   {counted(rows, 'row')}" if rows else "R: record"
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
        x, y, z, heading, pitch = (before + (after - before) * part for before, after in pairs)
        pose = x, y, z, heading, pitch
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
        screen = DriveScreen(window, world.drawing(), world.weather)
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
    print_report(console, recorder, [run.driven], took, world.drawing().name)
    return recorder.folder, run.driven.off_road


def _weather_state(weather: Weather) -> core.RenderState:
    """Return a render state that approximates the recorded frames' fog and exposure."""
    state = core.NodePath("weather")
    if weather.fog:
        fog = core.Fog("fog")
        fog.setColor(*(float(channel) for channel in FOG_RGB / 255 * weather.brightness))
        fog.setExpDensity(weather.fog**2 * 0.06)
        state.setFog(fog)
    state.setColorScale(*[weather.brightness] * 3, 1)
    return state.getState()


def _text(
    parent: core.NodePath, x: float, z: float, size: float, align: int = core.TextNode.ACenter
) -> core.NodePath:
    node = core.TextNode("text")
    node.setAlign(align)
    node.setShadow(0.04, 0.04)
    node.setShadowColor(0, 0, 0, 0.9)
    path = parent.attachNewNode(node)
    path.setPos(x, 0, z)
    path.setScale(size)
    return path


def _set_text(path: core.NodePath, text: str, colour: tuple[float, ...]) -> None:
    node = path.node()
    if node.getText() != text:
        node.setText(text)
    node.setTextColor(*colour)


def _box(
    parent: core.NodePath,
    x: tuple[float, float],
    z: tuple[float, float],
    colour: tuple[float, ...],
) -> core.NodePath:
    card = core.CardMaker("box")
    card.setFrame(*x, *z)
    card.setColor(*colour)
    path = parent.attachNewNode(card.generate())
    path.setTransparency(core.TransparencyAttrib.MAlpha)
    return path
