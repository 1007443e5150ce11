"""A desktop for tests: Xvfb, with simulated keys, mouse and close buttons."""

import ctypes
import ctypes.util
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from PIL import ImageGrab

SIZE = (800, 600)
CLIENT_MESSAGE = 33


class ClientMessage(ctypes.Structure):
    """XClientMessageEvent, as large as an XEvent."""

    _fields_ = (
        ("type", ctypes.c_int),
        ("serial", ctypes.c_ulong),
        ("send_event", ctypes.c_int),
        ("display", ctypes.c_void_p),
        ("window", ctypes.c_ulong),
        ("message_type", ctypes.c_ulong),
        ("format", ctypes.c_int),
        ("data", ctypes.c_long * 5),
        ("rest", ctypes.c_long * 24),
    )


class Desktop:
    """A connection to an X server; `name` is the value of DISPLAY."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.x11, self.xtest = (ctypes.CDLL(ctypes.util.find_library(one)) for one in LIBRARIES)
        self.x11.XOpenDisplay.restype = ctypes.c_void_p
        self.display = ctypes.c_void_p(self.x11.XOpenDisplay(name.encode()))
        assert self.display.value, f"cannot reach {name}"
        for call in ("XStringToKeysym", "XDefaultRootWindow", "XInternAtom"):
            getattr(self.x11, call).restype = ctypes.c_ulong

    def key(self, name: str, down: bool) -> None:
        """Press or release a key, by X's name: `Up`, `r`, `Escape`."""
        symbol = ctypes.c_ulong(self.x11.XStringToKeysym(name.encode()))
        self.xtest.XTestFakeKeyEvent(
            self.display, self.x11.XKeysymToKeycode(self.display, symbol), int(down), 0
        )
        self.x11.XSync(self.display, 0)

    def tap(self, name: str) -> None:
        """Press a key and release it at once."""
        self.key(name, True)
        self.key(name, False)

    def mouse(self, x: int, y: int, button: bool | None = None) -> None:
        """Move the pointer, then press (True) or release (False) the left button."""
        self.xtest.XTestFakeMotionEvent(self.display, 0, x, y, 0)
        if button is not None:
            self.xtest.XTestFakeButtonEvent(self.display, 1, int(button), 0)
        self.x11.XSync(self.display, 0)

    def image(self) -> np.ndarray:
        """Return the screen's image: uint8 [600, 800, 3], RGB."""
        return np.asarray(ImageGrab.grab(xdisplay=self.name).convert("RGB"))

    def close_window(self, title: str) -> None:
        """Close a window as its close button does."""
        delete, protocols = (
            self.x11.XInternAtom(self.display, name, 0)
            for name in (b"WM_DELETE_WINDOW", b"WM_PROTOCOLS")
        )
        for window in self._windows():
            text = ctypes.c_char_p()
            self.x11.XFetchName(self.display, ctypes.c_ulong(window), ctypes.byref(text))
            if title.encode() in (text.value or b""):
                event = ClientMessage(CLIENT_MESSAGE, 0, 1, None, window, protocols, 32)
                event.data[0] = delete
                self.x11.XSendEvent(
                    self.display, ctypes.c_ulong(window), 0, ctypes.c_long(0), ctypes.byref(event)
                )
        self.x11.XSync(self.display, 0)

    def _windows(self) -> list[int]:
        root = ctypes.c_ulong(self.x11.XDefaultRootWindow(self.display))
        found, count = ctypes.POINTER(ctypes.c_ulong)(), ctypes.c_uint()
        unused = ctypes.c_ulong()
        self.x11.XQueryTree(
            self.display,
            root,
            ctypes.byref(unused),
            ctypes.byref(unused),
            ctypes.byref(found),
            ctypes.byref(count),
        )
        return found[: count.value]


LIBRARIES = ("X11", "Xtst")


@contextmanager
def open_desktop() -> Iterator[Desktop]:
    """Start Xvfb on a free display; skip the test if a program or library is missing."""
    if not shutil.which("Xvfb"):
        pytest.skip("needs Xvfb (Debian: apt install xvfb)")
    if not all(map(ctypes.util.find_library, LIBRARIES)):
        pytest.skip("needs libX11 and libXtst (Debian: apt install libx11-6 libxtst6)")
    screen = f"{SIZE[0]}x{SIZE[1]}x24"
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", "1", "-screen", "0", screen, "-nolisten", "tcp"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        number = server.stdout.readline().strip()
        assert number, "Xvfb did not start"
        desktop = Desktop(f":{number}")
        yield desktop
        desktop.x11.XCloseDisplay(desktop.display)
    finally:
        server.terminate()
        server.wait(10)
