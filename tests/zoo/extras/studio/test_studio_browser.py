"""A person's first ten minutes in the studio, in headless Chromium."""

import json
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

from datamodules.recording_format import read_recordings
from tests.zoo.command_runs import command, environment
from tests.zoo.extras.studio.key_latency import measure, press
from tests.zoo.server.browser import CHROMIUM, Browser

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")]


def text(selector: str) -> str:
    return f"document.querySelector({json.dumps(selector)})?.textContent"


def shown(selector: str) -> str:
    return f"document.querySelector({json.dumps(selector)})?.checkVisibility()"


def pick(browser: Browser, selector: str, value: str) -> None:
    browser.value(f"""(() => {{
        const field = document.querySelector({json.dumps(selector)});
        field.value = {json.dumps(value)};
        field.dispatchEvent(new Event("input", {{ bubbles: true }}));
    }})()""")


def click(browser: Browser, selector: str) -> None:
    browser.value(f"document.querySelector({json.dumps(selector)}).scrollIntoView()")
    browser.click(selector)


def upload(browser: Browser, path: Path) -> None:
    root = browser.call("DOM.getDocument")["root"]["nodeId"]
    node = browser.call("DOM.querySelector", nodeId=root, selector="#upload")["nodeId"]
    browser.call("DOM.setFileInputFiles", files=[str(path)], nodeId=node)


def test_a_person_drives_records_trains_and_watches(here: Path) -> None:
    words = command("zoo.extras.studio.studio", "port=0")
    streams = {"stdout": subprocess.PIPE, "text": True}
    process = subprocess.Popen(words, cwd=here, env=environment(), **streams)
    began = time.monotonic()

    def report(step: str) -> None:
        print(f"{time.monotonic() - began:5.0f} s: {step}")

    try:
        with Browser(here / "profile", 1280, 900) as browser:
            browser.open(re.search(r"http://\S+", process.stdout.readline()).group())
            browser.wait_for(f"{text('#drive .line pre')}.startsWith('drivezoo simulator drive')")
            click(browser, "#drive button.primary")
            browser.wait_for(f"{text('#hand [data-fact=lap]')} === '1'", 60)
            press(browser, "KeyR", True)
            report(f"drives; {measure(browser, 40)}")
            click(browser, "#hand [data-press=escape]")
            browser.wait_for(shown("#driven .controls"))
            click(browser, "#driven [data-go=train]")
            folder = browser.wait_for("document.querySelector('#train [name=folder]').value")
            assert len(read_recordings(folder)) > 100
            report("recorded")

            click(browser, "#train [name=quick]")
            browser.wait_for(f"{text('#train .line pre')}.endsWith('quick=true')")
            click(browser, "#train button.primary")
            browser.wait_for(f"{text('#train [data-fact=loss]')}.startsWith('0')", 300)
            click(browser, "[data-stop=train]")
            browser.wait_for(shown("#resume"), 60)
            click(browser, "#resume")
            browser.wait_for(f"!{shown('#watch-it')}")
            browser.wait_for(shown("#watch-it"), 600)
            assert browser.value(f"{text('#training-status')}.startsWith('Trained')")
            assert browser.value(shown("#verdict"))
            assert browser.value(shown("#film"))
            report("trained")

            click(browser, "#watch-it")
            browser.wait_for("document.querySelector('#watch [name=first]').value.length > 8")
            pick(browser, "#watch [name=second]", "lenet")
            click(browser, "#watch button.primary")
            for side in (1, 2):
                fact = f"#sides article:nth-child({side}) [data-fact=time]"
                browser.wait_for(f"parseFloat({text(fact)}) > 2", 120)
            assert browser.value(f"/\\d/.test({text('#difference b')})")
            report("watched")

            broken = here / "broken.ckpt"
            broken.write_bytes(b"no checkpoint")
            upload(browser, broken)
            browser.wait_for(
                "document.querySelector('#watch [name=first]').value.includes('broken')"
            )
            click(browser, "#watch button.primary")
            browser.wait_for(f"{text('#sides .failure')}.includes('not a torch file')", 60)
            click(browser, "[data-step=rank] button")
            browser.wait_for(shown("#ranking"), 60)
            report("ranked")
            for width in (1280, 390):
                screen = {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": False}
                browser.call("Emulation.setDeviceMetricsOverride", **screen)
                for room in ("drive", "recordings", "train", "watch"):
                    browser.value(f"location.hash = '{room}'")
                    browser.wait_for(shown(f"#{room}"))
                    assert browser.value("document.documentElement.scrollWidth <= innerWidth")
            assert not browser.errors
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=90)
    assert process.returncode == 0
