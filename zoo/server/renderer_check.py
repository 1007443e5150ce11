"""Check of the embedded simulator's renderers: whether they open and draw.

Each runs in a subprocess, because a graphics driver can crash its process.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator

from zoo.base.child_process import start_module
from zoo.server.machine_checks import FAULT, OK, WARNING, Finding

TIMEOUT_S = 20.0
GROUND = (0.2, 0.6, 0.4)


def start_renderers() -> Callable[[], Iterator[Finding]]:
    """Start the renderers in the background; return a function that yields the findings."""
    quiet = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    text = {"text": True, "encoding": "utf-8", "errors": "replace"}
    started = {
        name: start_module("zoo.server.renderer_check", name, **quiet, **text)
        for name in ("software", "opengl")
    }
    return lambda: _findings(started)


def _findings(started: dict[str, subprocess.Popen]) -> Iterator[Finding]:
    drawn = {}
    for name, process in started.items():
        try:
            output, _ = process.communicate(timeout=TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            output, _ = process.communicate()
        # Only the last line counts: graphics libraries print lines before it.
        lines = output.strip().splitlines() or [f"no answer, exit status {process.returncode}"]
        drawn[name] = "" if process.returncode == 0 else lines[-1]
    if not drawn["software"]:
        yield Finding(OK, "renderer", "software opens and draws")
    else:
        fix = "pip install -e . (panda3d 1.10.15 or newer), and on Linux: apt install libx11-6"
        state = WARNING if not drawn["opengl"] else FAULT
        yield Finding(state, "renderer", f"software does not draw: {drawn['software']}", fix)
    if not drawn["opengl"]:
        yield Finding(OK, "OpenGL", "opens and draws: renderer=opengl")
    else:
        yield Finding(OK, "OpenGL", f"not available, and not needed ({drawn['opengl']})")


def draw(name: str) -> str:
    """Draw a background with a renderer; return what failed, or an empty text."""
    from panda3d import core

    from zoo.base.errors import InputError
    from zoo.simulator.renderer import open_buffer

    try:
        engine, buffer, _ = open_buffer(name, 32, 16)
    except InputError as error:
        return str(error).partition("; ")[0]
    texture = core.Texture()
    buffer.addRenderTexture(texture, core.GraphicsOutput.RTMCopyRam)
    buffer.setClearColor((*GROUND, 1))
    engine.renderFrame()
    seen = tuple(bytes(texture.getRamImageAs("RGB"))[:3])
    wanted = tuple(round(255 * channel) for channel in GROUND)
    near = len(seen) == 3 and all(abs(seen[at] - wanted[at]) < 8 for at in range(3))
    return "" if near else f"drew {seen} instead of {wanted}"


if __name__ == "__main__":
    try:
        failure = draw(sys.argv[1])
    except Exception as error:  # print any error of a damaged installation in one line
        failure = f"{type(error).__name__}: {error}".splitlines()[0]
    print(failure)
    sys.exit(1 if failure else 0)
