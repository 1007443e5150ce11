"""Pages about a stranger's runs, in a browser: hostile names are shown as text."""

import html
import json
from pathlib import Path

import pytest

from tests.zoo.drive.browser import CHROMIUM, Browser
from tests.zoo.sweeps import change_status, write_run
from zoo.leaderboard.ranking_page import Ranking
from zoo.report.write_up import write_report

IMAGE = "<img src=x onerror=hacked=1>"
SCRIPT = "</script><script>hacked=1</script>"
PLACEHOLDER = "{{data}} {% raw %} {{ 7*7 }} ${hacked=1}"
HOSTILE = f"{IMAGE} {SCRIPT} {PLACEHOLDER} \"'onload=hacked=1 </title></style></pre>"
# A name that a folder can have.
NAME = "<img src=x onerror=hacked=1> {{data}} \"'"

needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="chromium is not installed; apt install chromium"
)


@pytest.fixture
def runs(tmp_path: Path) -> list[Path]:
    """Write two finished runs and a failed one, with hostile texts everywhere."""
    found = []
    for number in range(3):
        folder = tmp_path / f"{NAME} {number}"
        given = (f"model={HOSTILE}{number}", f"+{IMAGE}={SCRIPT}{number}")
        write_run(folder, 1.0 - number / 10, seed=number, overrides=given, tracks=(HOSTILE,))
        config = {"seed": number, "model": {"name": HOSTILE}, "data": {"root": HOSTILE}}
        (folder / ".hydra" / "config.yaml").write_text(json.dumps(config))
        found.append(folder)
    change_status(found[2], status="failed", reason=HOSTILE)
    (found[2] / "metrics.json").unlink()
    return found


def check_harmless(page: Path, images: int, scripts: int, profile: Path) -> str:
    """Open a page, check that no script of a text runs, and return the shown text."""
    with Browser(profile, 1200, 900) as browser:
        browser.open(page.as_uri())
        browser.wait_for(
            "document.readyState === 'complete' && document.querySelectorAll('h1').length"
        )
        assert browser.value("typeof hacked") == "undefined"
        count = "[...document.querySelectorAll('{}')].length".format
        assert browser.value(count("img:not([src^=data])")) == images
        assert browser.value(count("script")) == scripts
        assert browser.value(count("[onerror], [onload]")) == 0
        assert browser.value(count('meta[http-equiv="Content-Security-Policy"]')) == 1
        assert browser.errors == []
        # The page's policy also stops scripts that are inserted later.
        browser.value(f"document.body.insertAdjacentHTML('beforeend', {json.dumps(IMAGE)})")
        browser.value(
            "document.body.append(Object.assign(document.createElement('script'), "
            "{textContent: 'hacked = 1'}))"
        )
        browser.wait_for("document.querySelector('img[src=x]').complete")
        assert browser.value("typeof hacked") == "undefined"
        return browser.value("document.documentElement.textContent")


@needs_chromium
def test_the_ranking_shows_hostile_names_as_text(runs: list[Path], tmp_path: Path) -> None:
    page = Ranking.read(runs, tmp_path).write_page(tmp_path / "page.html", HOSTILE)
    shown = check_harmless(page, 0, 2, tmp_path / "profile")
    for text in (HOSTILE, IMAGE, NAME):
        assert text in shown


@needs_chromium
@pytest.mark.parametrize("number", [0, 2])
def test_the_report_shows_hostile_names_as_text(
    number: int, runs: list[Path], tmp_path: Path
) -> None:
    shown = check_harmless(write_report(runs[number]), 0, 0, tmp_path / "profile")
    assert IMAGE in shown
    assert PLACEHOLDER in shown


def test_each_page_allows_only_its_own_content(runs: list[Path], tmp_path: Path) -> None:
    ranking = Ranking.read(runs, tmp_path).write_page(tmp_path / "page.html", "x")
    for page in (ranking, write_report(runs[0])):
        text = page.read_text()
        policy = html.unescape(text.split('Content-Security-Policy" content="')[1].split('"')[0])
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "base-uri 'none'" in policy
        assert IMAGE not in text
        assert text.count("</script>") == text.count("<script")
