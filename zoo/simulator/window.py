"""A window with images and text, and the keys and buttons pressed in it.

OpenGL (`pandagl`) draws it, or Panda3D's software renderer on machines without OpenGL.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from zoo.base.errors import InputError
from zoo.simulator.panda import core
from zoo.simulator.renderer import SETTINGS, make_output

PIPES = ("pandagl", "p3tinydisplay")
KEY, UP = "key-", "-up"  # prefix and suffix of event names
OVERLAY = 10  # drawn after the world


class Window:
    """A window with a flat layer for images and texts.

    Args:
        title: title of the window.
        size: width and height in pixels.

    Attributes:
        flat: node of the flat layer, -aspect..aspect in x and -1..1 in z.
        pressed: names of the keys that went down during the last `draw`.
        held: names of the keys that are down.

    Raises:
        InputError: no window can be opened here.
    """

    def __init__(self, title: str, size: tuple[int, int] = (1280, 640)) -> None:
        pipe, self.engine, self.window = _open(title, size)
        self.held: set[str] = set()
        self.pressed: list[str] = []
        self.flat = core.NodePath("flat")
        self.flat.setDepthTest(False)
        self.flat.setDepthWrite(False)
        self.lens = core.OrthographicLens()
        self.lens.setNearFar(-1, 1)
        region = self.window.makeDisplayRegion()
        region.setSort(OVERLAY)
        region.setCamera(self.flat.attachNewNode(core.Camera("flat", self.lens)))
        # Panda3D's "data graph" turns the window's input into named events.
        self._devices = core.NodePath("devices")
        keyboard = core.MouseAndKeyboard(self.window, 0, "keyboard and mouse")
        thrower = core.ButtonThrower("keys")
        thrower.setPrefix(KEY)
        self._devices.attachNewNode(keyboard).attachNewNode(thrower)
        self._traverser = core.DataGraphTraverser()
        self._events = core.EventQueue.getGlobalEventQueue()
        # Set last and so freed last: the software renderer's window must not outlive its pipe.
        self._pipe = pipe

    @property
    def is_open(self) -> bool:
        """Return whether the window is still open."""
        return self.window is not None and not self.window.isClosed()

    @property
    def aspect(self) -> float:
        """Return the window's width divided by its height."""
        return self.window.getXSize() / max(self.window.getYSize(), 1)

    @property
    def pointer(self) -> float:
        """Return the mouse's x: 0 at the left edge, 1 at the right, beyond these outside."""
        return self.window.getPointer(0).getX() / max(self.window.getXSize(), 1)

    def draw(self) -> bool:
        """Draw everything and read the input; return False when the window is closed."""
        self.lens.setFilmSize(2 * self.aspect, 2)
        self.engine.renderFrame()
        self._traverser.traverse(self._devices.node())
        self.pressed = []
        while not self._events.isQueueEmpty():
            name = self._events.dequeueEvent().getName()
            if not name.startswith(KEY) or name.endswith("-repeat"):
                continue
            key = name.removeprefix(KEY)
            if key.endswith(UP):
                self.held.discard(key.removesuffix(UP))
            else:
                self.held.add(key)
                self.pressed.append(key)
        return self.is_open

    def close(self) -> None:
        """Close the window, unless the user has closed it."""
        self.engine.removeAllWindows()
        self._devices.removeNode()
        self.window = None


class ImagePanel:
    """A rectangle that shows an image, in the units of a window's flat layer."""

    def __init__(self, parent: core.NodePath, left: float, bottom: float, width: float) -> None:
        self.parent, self.place = parent, (left, bottom, width)
        self.texture = core.Texture("image")
        self.texture.setMagfilter(core.SamplerState.FTLinear)
        self.node: Any = None  # a NodePath from the first image on

    def show(self, frame: np.ndarray) -> None:
        """Show uint8 [H, W, 3 or 4], RGB or RGBA; every image needs the first one's shape."""
        height, width, channels = frame.shape
        if self.node is None:
            self._attach(height, width, channels)
        order = [2, 1, 0, 3][:channels]  # Panda3D stores blue first and the lowest row first
        self._stored[:height, :width] = frame[::-1, :, order]
        self.texture.setRamImage(self._stored.tobytes())

    def _attach(self, height: int, width: int, channels: int) -> None:
        # The software renderer needs textures whose sides are powers of two.
        rows, columns = (1 << (side - 1).bit_length() for side in (height, width))
        self._stored = np.zeros((rows, columns, channels), np.uint8)
        kind = core.Texture.FRgba if channels == 4 else core.Texture.FRgb
        self.texture.setup2dTexture(columns, rows, core.Texture.TUnsignedByte, kind)
        card = core.CardMaker("image")
        left, bottom, wide = self.place
        card.setFrame(left, left + wide, bottom, bottom + wide * height / width)
        # Half a pixel inside, because the texture beyond the image is black.
        low, right, top = 0.5 / columns, (width - 0.5) / columns, (height - 0.5) / rows
        card.setUvRange((low, 0.5 / rows), (right, top))
        self.node = self.parent.attachNewNode(card.generate())
        self.node.setTexture(self.texture)
        if channels == 4:
            self.node.setTransparency(core.TransparencyAttrib.MAlpha)


class Viewer:
    """A window that shows only frames."""

    def __init__(self, title: str, size: tuple[int, int] = (960, 480)) -> None:
        self.window = Window(title, size)
        self.panel = ImagePanel(self.window.flat, -1.0, -0.5, 2.0)

    def show(self, frame: np.ndarray) -> bool:
        """Show uint8 [160, 320, 3], RGB, as large as fits; return False when it is closed."""
        if not self.window.is_open:
            return False
        self.panel.show(frame)
        height, width = frame.shape[:2]
        self.panel.node.setScale(min(self.window.aspect, width / height))
        return self.window.draw() and "escape" not in self.window.pressed

    def show_until_closed(self, frame: np.ndarray) -> None:
        """Show a frame; raise KeyboardInterrupt when the user has closed the window."""
        if not self.show(frame):
            raise KeyboardInterrupt

    def close(self) -> None:
        """Close the window; a second call has no effect."""
        self.window.close()


def _open(
    title: str, size: tuple[int, int]
) -> tuple[core.GraphicsPipe, core.GraphicsEngine, core.GraphicsWindow]:
    linux = sys.platform.startswith("linux")
    if linux and not os.environ.get("DISPLAY"):
        raise InputError(
            "no window can be opened: DISPLAY is not set; run this on a desktop (Wayland needs "
            "Xwayland), with ssh -X, or under xvfb-run"
        )
    core.loadPrcFileData("", SETTINGS)
    for module in PIPES:
        with _quiet_libraries():
            pipe = core.GraphicsPipeSelection.getGlobalPtr().makeModulePipe(module)
            if pipe is None or not pipe.isValid():
                continue
            # Without a back buffer, nothing reaches the screen.
            engine, window = make_output(pipe, title, size, core.GraphicsPipe.BFRequireWindow, 1)
            if window is not None:
                engine.openWindows()
                if not window.isClosed():
                    return pipe, engine, window
    where = f"on DISPLAY={os.environ['DISPLAY']}" if linux else "here"
    raise InputError(f"no window can be opened {where}; run this on a desktop")


@contextmanager
def _quiet_libraries() -> Iterator[None]:
    """Discard messages that Xlib and Panda3D's loader write to file 2.

    No setting suppresses them, and they are harmless: a missing X extension of the 1990s, and a
    type that two renderers share.
    """
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
