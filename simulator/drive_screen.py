"""The screen of a person's drive: the world, the recorded frame in a corner, texts and help."""

from pathlib import Path

import matplotlib
import numpy as np
from panda3d import core

from simulator.renderer import Renderer, camera_lens, set_aspect
from simulator.scenery.frame_effects import FOG_RGB, bonnet_image
from simulator.weather import Weather
from simulator.window import ImagePanel, Window

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
        self, pose: tuple[float, ...], speed_mph: float, steering: float, throttle: float
    ) -> bool:
        """Draw the world from a pose of `World.pose`; return False when the window is closed."""
        aspect = self.window.aspect
        self.corner.setX(aspect - 0.03)
        self.left.setX(-aspect + 0.03)
        self.help_box.setSx(aspect)
        self.help.setScale(HELP_SIZE * min(aspect / 2, 1))
        set_aspect(self.lens, aspect)
        self.renderer.place_camera(self.camera, pose, "center")
        _set_text(self.speed, f"{speed_mph:.0f} mph", WHITE)
        self.wheel.setX(steering * BAR_WIDTH)
        pedal = "brake" if throttle < 0 else "throttle"
        _set_text(self.steering, f"steering {steering:+.2f}     {pedal} {abs(throttle):.2f}", WHITE)
        return self.window.draw()


def _weather_state(weather: Weather) -> core.RenderState:
    """Return a render state that approximates the recorded frames' fog and exposure."""
    state = core.NodePath("weather")
    if weather.fog:
        fog = core.Fog("fog")
        fog.setColor(*(float(one) for one in FOG_RGB / 255 * weather.brightness))
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
