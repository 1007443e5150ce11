"""Time from a key to the first frame that shows it, in headless Chromium on this machine.

`python -m tests.zoo.extras.studio.key_latency` prints the figures of a drive of its own.
"""

import re
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.zoo.command_runs import command, environment
from tests.zoo.server.browser import Browser

# From the event in the page to the drawing of a frame whose steering has the key's side.
NOTE = """(() => {
  window.noted = { ms: [], frames: 0, begin: performance.now() };
  addEventListener("keydown", (event) => {
    const side = { ArrowLeft: -1, ArrowRight: 1 }[event.code];
    if (side && !event.repeat) Object.assign(noted, { side, down: event.timeStamp });
  }, true);
  document.querySelector("[data-hand]").addEventListener("frame", ({ detail }) => {
    noted.frames += 1;
    if (!noted.down || Math.sign(detail.steering) !== noted.side) return;
    noted.ms.push(performance.now() - noted.down);
    noted.down = 0;
  });
})()"""


@dataclass(frozen=True)
class KeyLatency:
    """Latencies of keys in milliseconds, and frames per second."""

    ms: list[float]
    frames_per_s: float

    def __str__(self) -> str:
        p50, p95 = np.percentile(self.ms, [50, 95])
        keys = f"{len(self.ms)} keys: p50 {p50:.0f} ms, p95 {p95:.0f} ms"
        return f"{keys}; {self.frames_per_s:.1f} frames/s"


def press(browser: Browser, code: str, down: bool) -> None:
    kind = "keyDown" if down else "keyUp"
    browser.call("Input.dispatchKeyEvent", type=kind, code=code, key=code)


def measure(browser: Browser, keys: int, throttle: bool = True) -> KeyLatency:
    """Steer left and right in turn in an open drive, and return the latencies."""
    browser.value(NOTE)
    if throttle:
        press(browser, "KeyW", True)
    for number in range(keys):
        code = ("ArrowLeft", "ArrowRight")[number % 2]
        press(browser, code, True)
        time.sleep(0.125)
        press(browser, code, False)
        time.sleep(0.125)
    press(browser, "KeyW", False)
    rate = browser.value("1000 * noted.frames / (performance.now() - noted.begin)")
    return KeyLatency(browser.value("noted.ms"), rate)


def main(keys: int = 100) -> None:
    with tempfile.TemporaryDirectory() as folder:
        options = ("port=0", "quality=fast", f"out={folder}/laps")
        words = command("zoo.commands.simulator", "drive", *options)
        streams = {"stdout": subprocess.PIPE, "text": True}
        process = subprocess.Popen(words, env=environment(), **streams)
        with process, Browser(Path(folder, "profile"), 1280, 800) as browser:
            browser.open(re.search(r"http://\S+", process.stdout.readline()).group())
            browser.wait_for("document.querySelector('[data-fact=lap]')?.textContent === '1'")
            print(measure(browser, keys))
            press(browser, "Escape", True)


if __name__ == "__main__":
    main()
