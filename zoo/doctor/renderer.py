"""Check of the embedded simulator's renderers: whether they open and draw.

Each runs in a subprocess, because a graphics driver can crash its process.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
from collections.abc import Callable, Iterator

from zoo.base.child_process import start_module
from zoo.doctor.finding import FAULT, OK, WARNING, Finding

TIMEOUT_S = 20.0
GROUND, CARD = (0.2, 0.6, 0.4), (0.8, 0.4, 0.2)


def start_renderers() -> Callable[[], Iterator[Finding]]:
    """Start the renderers in the background; return a function that yields the findings."""
    started = {name: _start(name) for name in ("software", "opengl")}
    return lambda: _findings(started)


def _findings(started: dict[str, subprocess.Popen]) -> Iterator[Finding]:
    drawn = {}
    for name, process in started.items():
        try:
            process.wait(TIMEOUT_S)
            # Only the last line counts: graphics libraries print lines before it.
            lines = (process.stdout.read().strip() or "no answer").splitlines()
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            lines = ["no answer"]
        drawn[name] = "" if process.returncode == 0 else lines[-1]
        if process.returncode < 0 and drawn[name] == "no answer":
            drawn[name] = f"crashed with signal {-process.returncode}"
        process.stdout.close()
    if not drawn["software"]:
        yield Finding(OK, "renderer", "software opens and draws")
    else:
        fix = "pip install -e . (panda3d 1.10.15 or newer)"
        if sys.platform == "linux" and not _loads("libX11.so.6"):
            fix = "apt install libx11-6 (the software renderer loads it, but needs no display)"
        state = WARNING if not drawn["opengl"] else FAULT
        yield Finding(state, "renderer", f"software does not draw: {drawn['software']}", fix)
    if not drawn["opengl"]:
        yield Finding(OK, "OpenGL", "opens and draws: renderer=opengl")
    else:
        yield Finding(OK, "OpenGL", f"not available, and not needed ({drawn['opengl']})")


def _start(name: str) -> subprocess.Popen:
    return start_module(
        "zoo.doctor.renderer",
        name,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        encoding="utf-8",
        errors="replace",
    )


def draw(name: str) -> str:
    """Draw a card on a background with a renderer; return what failed, or an empty text."""
    from panda3d import core

    from simulator.renderer import open_buffer
    from zoo.base.errors import InputError

    try:
        engine, buffer, _ = open_buffer(name, 32, 16)
    except InputError as error:
        return str(error).partition("; ")[0]
    texture = core.Texture()
    buffer.addRenderTexture(texture, core.GraphicsOutput.RTMCopyRam)
    buffer.setClearColor((*GROUND, 1))
    root = core.NodePath("root")
    card = core.CardMaker("card")
    card.setFrame(0, 1, -1, 1)  # the right half
    card.setColor(*CARD, 1)
    root.attachNewNode(card.generate()).setTwoSided(True)
    camera = core.Camera("camera", core.OrthographicLens())
    camera.getLens().setFilmSize(2, 2)
    view = root.attachNewNode(camera)
    view.setY(-5)
    buffer.makeDisplayRegion().setCamera(view)
    engine.renderFrame()
    pixels = bytes(texture.getRamImageAs("RGB"))
    middle = pixels[8 * 32 * 3 : 9 * 32 * 3]
    for seen, colour in ((middle[:3], GROUND), (middle[-3:], CARD)):
        if any(abs(one / 255 - wanted) > 0.03 for one, wanted in zip(seen, colour)):  # noqa: B905
            return f"drew {tuple(seen)} instead of {tuple(round(255 * one) for one in colour)}"
    return ""


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


if __name__ == "__main__":
    try:
        failure = draw(sys.argv[1])
    except Exception as error:  # print any error of a damaged installation in one line
        failure = f"{type(error).__name__}: {error}".splitlines()[0]
    print(failure)
    sys.exit(1 if failure else 0)
