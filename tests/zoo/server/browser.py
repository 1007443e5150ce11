"""Headless Chromium, controlled over its DevTools protocol."""

import base64
import json
import shutil
import subprocess
import time
import urllib.request
from pathlib import Path

import pytest
import websocket

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: apt install chromium")


class Browser:
    """A browser with one page; a context manager.

    Args:
        profile: new, empty folder.
        width, height: size of the page, pixels.
        scheme: `light` or `dark`, which the browser reports as the user's preference.
    """

    def __init__(self, profile: Path, width: int, height: int, scheme: str = "light") -> None:
        flags = ["--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0"]
        flags += ["--remote-allow-origins=*", f"--user-data-dir={profile}", "about:blank"]
        self._process = subprocess.Popen(
            [CHROMIUM, *flags], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        )
        self.errors: list[str] = []  # what the page's scripts threw, and what could not be loaded
        self._calls = 0
        try:
            self._socket = websocket.create_connection(self._page(), timeout=20)
        except BaseException:
            self.__exit__()
            raise
        self.call("Runtime.enable")
        self.call("Log.enable")
        page = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **page)
        feature = {"name": "prefers-color-scheme", "value": scheme}
        self.call("Emulation.setEmulatedMedia", features=[feature])

    def _page(self) -> str:
        line = next(text for text in self._process.stderr if "DevTools listening on" in text)
        port = line.split("://")[1].split("/")[0].rpartition(":")[2]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json", timeout=10) as tabs:
            pages = [tab for tab in json.load(tabs) if tab["type"] == "page"]
        return pages[0]["webSocketDebuggerUrl"]

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        try:
            self._process.wait(5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stderr.close()

    def call(self, method: str, **parameters: object) -> dict:
        self._calls += 1
        self._socket.send(json.dumps({"id": self._calls, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv())
            if message.get("id") == self._calls:
                assert "error" not in message, message["error"]
                return message["result"]
            self._note(message)

    def _note(self, event: dict) -> None:
        if event.get("method") == "Runtime.exceptionThrown":
            self.errors.append(
                event["params"]["exceptionDetails"].get("exception", {})["description"]
            )
        elif event.get("method") == "Log.entryAdded":
            entry = event["params"]["entry"]
            self.errors.append(f"{entry['text']} ({entry.get('url')})")

    def open(self, url: str) -> None:
        self.call("Page.navigate", url=url)

    def value(self, script: str) -> object:
        return self.call("Runtime.evaluate", expression=script, returnByValue=True)["result"].get(
            "value"
        )

    def wait_for(self, script: str, seconds: float = 15) -> object:
        """Wait until a script's value is true; return it."""
        ends = time.monotonic() + seconds
        while not (value := self.value(script)):
            assert time.monotonic() < ends, f"not within {seconds} s: {script}; {self.errors}"
            time.sleep(0.05)
        return value

    def click(self, selector: str) -> None:
        """Click at the position of an element, where it stays, as a user does."""
        script = f"""(() => {{
            const box = document.querySelector({json.dumps(selector)}).getBoundingClientRect();
            return [box.x + box.width / 2, box.y + box.height / 2];
        }})()"""
        before, place = None, self.value(script)
        while place != before:  # a panel that is filled moves others
            time.sleep(0.05)
            before, place = place, self.value(script)
        x, y = place
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def screenshot(self, path: Path) -> None:
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot")["data"]))
