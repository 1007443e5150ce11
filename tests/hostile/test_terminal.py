"""Hostile names and fields: terminals and pages show them as text."""

import html
import json
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table

from tests.recordings import write_recording
from tests.zoo.base.test_console_progress import on_a_terminal
from tests.zoo.command_runs import command, only_line, run_here
from tests.zoo.server.browser import Browser, needs_chromium
from tests.zoo.sweeps import change_status, write_run
from zoo.base.terminal import error_line, guard_rich
from zoo.results.ranking_page import Ranking
from zoo.scoring.write_up import write_report

EVIL = "a\x1b[2J\x1b]0;x\x07\x9b1A\u202eb\rc"  # clear, title, cursor up, right-to-left, overwrite
SHOWN = r"a\x1b[2J\x1b]0;x\x07\x9b1A\u202eb"


def control_characters(printed: str) -> str:
    return "".join(sign for sign in printed if sign != "\n" and not sign.isprintable())


REFUSED = {
    "check's folder": ("zoo.commands.check", [f"{EVIL}\nall images are whole"]),
    "recording": ("zoo", ["model=tiny", f"data.root='{EVIL}'"]),
    "track": ("zoo.commands.evaluate", ["x.ckpt", f"track={EVIL}\nx"]),
    "simulator's command": ("zoo.commands.simulator", [f"{EVIL}\nx"]),
}


@pytest.mark.parametrize(("module", "arguments"), REFUSED.values(), ids=REFUSED)
def test_an_error_is_escaped_in_one_line(module: str, arguments: list, tmp_path: Path) -> None:
    assert not control_characters(only_line(run_here(tmp_path, *arguments, module=module)))
    assert not control_characters(run_here(tmp_path, "-v", *arguments, module=module).stderr)


def test_check_escapes_folders_and_images_of_a_log(tmp_path: Path) -> None:
    folder = tmp_path / f"{EVIL}\nall images are whole"
    written = write_recording(folder, rows=30)
    log = written.log.read_text()
    written.log.write_text(log.replace(f"center_{written.stems[7]}", f"{EVIL}".replace("\r", "")))
    written.image(3).write_bytes(b"")
    result = run_here(tmp_path, str(folder), module="zoo.commands.check")
    assert result.returncode == 1
    assert not control_characters(result.stdout + result.stderr)
    assert "row 8: " in result.stdout
    assert SHOWN in result.stdout
    assert "all images are whole" not in result.stdout.splitlines()


def evil_runs(folder: Path) -> None:
    write_run(folder / f"good{EVIL}", 0.9, tracks=(EVIL, "lake"), overrides=(f"x={EVIL}",))
    write_run(folder / "other", 0.8, tracks=("lake",), overrides=(f"x={EVIL}2",))
    damaged = write_run(folder / f"bad{EVIL}\n9 failed", 0.9)
    (damaged / "metrics.json").write_text(json.dumps({"baselines": {EVIL: {"x": {"mse": "x"}}}}))


def test_on_a_terminal_the_leaderboard_escapes_names(tmp_path: Path) -> None:
    """Colours and table frames stay; other control characters are not printed."""
    evil_runs(tmp_path)
    printed = on_a_terminal(tmp_path, *command("zoo.commands.leaderboard", "."))
    assert "1 damaged: " in printed
    assert "9 failed" not in printed.splitlines()
    assert "\x1b[1m" in printed or "\x1b[3m" in printed
    for sequence in ("\x1b[2J", "\x1b]", "\x07", "\x9b", "\u202e"):
        assert sequence not in printed


def test_a_report_escapes_the_name_of_its_run(tmp_path: Path) -> None:
    folder = write_run(tmp_path / f"{EVIL}\nx", 0.9)
    config = {"seed": 1, "data": {"root": None}, "model": {"name": "linear"}}
    (folder / ".hydra" / "config.yaml").write_text(json.dumps(config))
    result = run_here(tmp_path, str(folder), module="zoo.commands.report")
    assert result.returncode == 0, result.stderr
    assert not control_characters(result.stdout + result.stderr)
    assert len(result.stdout.splitlines()) == 3, "two files and the next command"


def test_a_sweep_escapes_why_its_jobs_failed(tmp_path: Path) -> None:
    log = write_recording(tmp_path / "lake", rows=30).log
    log.write_text(log.read_text().replace("center_", EVIL.replace("\r", "")))
    result = run_here(tmp_path, "-m", "data.root=lake", "seed=1,2")
    assert SHOWN in result.stdout
    assert not control_characters(result.stdout + result.stderr)


def test_rich_escapes_texts_and_keeps_its_own_sequences(capsys: pytest.CaptureFixture) -> None:
    guard_rich()
    table = Table(EVIL)
    table.add_row(EVIL, style="red")
    console = Console(force_terminal=True, width=80)
    console.print(table)
    console.out(EVIL, highlight=False)
    printed = capsys.readouterr().out
    assert "\x1b[31m" in printed
    assert printed.count(r"\x1b[2J") == 3
    assert "\x1b[2J" not in printed


def test_a_long_error_is_cut_in_its_middle() -> None:
    line = error_line("zoo", "a" * 5000 + "\n\x1b" + "b" * 5000)
    assert line.startswith("zoo: aaa")
    assert line.endswith("bbb")
    assert len(line) < 4100


IMAGE = "<img src=x onerror=hacked=1>"
SCRIPT = "</script><script>hacked=1</script>"
PLACEHOLDER = "{{data}} {% raw %} {{ 7*7 }} ${hacked=1}"
HOSTILE = f"{IMAGE} {SCRIPT} {PLACEHOLDER} \"'onload=hacked=1 </title></style></pre>"
# A name that a folder can have.
NAME = "<img src=x onerror=hacked=1> {{data}} \"'"


@pytest.fixture
def runs(tmp_path: Path) -> list[Path]:
    """Write two finished runs and a failed one, with hostile texts everywhere."""
    folders = []
    for number in range(3):
        folder = tmp_path / f"{NAME} {number}"
        given = (f"model={HOSTILE}{number}", f"+{IMAGE}={SCRIPT}{number}")
        write_run(folder, 1.0 - number / 10, seed=number, overrides=given, tracks=(HOSTILE,))
        config = {"seed": number, "model": {"name": HOSTILE}, "data": {"root": HOSTILE}}
        (folder / ".hydra" / "config.yaml").write_text(json.dumps(config))
        folders.append(folder)
    change_status(folders[2], status="failed", reason=HOSTILE)
    (folders[2] / "metrics.json").unlink()
    return folders


def check_harmless(page: Path, images: int, scripts: int, profile: Path) -> str:
    """Open a page, check that no script of a text runs, and return the shown text."""
    with Browser(profile, 1200, 900) as browser:
        browser.open(page.as_uri())
        loaded = "document.readyState === 'complete' && document.querySelectorAll('h1').length"
        browser.wait_for(loaded)
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
def test_the_ranking_shows_names_as_text(runs: list[Path], tmp_path: Path) -> None:
    page = Ranking.read(runs, tmp_path).write_page(tmp_path / "page.html", HOSTILE)
    shown = check_harmless(page, 0, 2, tmp_path / "profile")
    for text in (HOSTILE, IMAGE, NAME):
        assert text in shown


@needs_chromium
@pytest.mark.parametrize("number", [0, 2])
def test_a_report_shows_names_as_text(number: int, runs: list[Path], tmp_path: Path) -> None:
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
