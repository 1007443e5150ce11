"""Names and fields with control characters: they are printed as text."""

import json
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table

from tests.recordings import write_recording
from tests.zoo.cli.test_console_progress import on_a_terminal
from tests.zoo.commands import command, only_line, run
from tests.zoo.sweeps import write_run
from zoo.base.terminal import error_line, guard_rich

EVIL = "a\x1b[2J\x1b]0;x\x07\x9b1A\u202eb\rc"  # clear, title, cursor up, right-to-left, overwrite
SHOWN = r"a\x1b[2J\x1b]0;x\x07\x9b1A\u202eb"


def control_characters(printed: str) -> str:
    return "".join(one for one in printed if one != "\n" and not one.isprintable())


REFUSED = {
    "check's folder": ("datamodules.check", [f"{EVIL}\nall images are whole"]),
    "recording": ("zoo", ["model=tiny", f"data.root='{EVIL}'"]),
    "track": ("zoo.evaluate", ["x.ckpt", f"track={EVIL}\nx"]),
    "simulator's track": ("simulator", ["record", "out=x", f"track={EVIL}"]),
    "simulator's command": ("simulator", [f"{EVIL}\nx"]),
}


@pytest.mark.parametrize("name", REFUSED)
def test_an_error_escapes_control_characters_in_one_line(name: str, tmp_path: Path) -> None:
    module, arguments = REFUSED[name]
    line = only_line(run(tmp_path, *arguments, module=module, timeout=60))
    assert not control_characters(line)


def test_check_escapes_folders_and_images_of_a_log(tmp_path: Path) -> None:
    folder = tmp_path / f"{EVIL}\nall images are whole"
    written = write_recording(folder, rows=30)
    log = written.log.read_text()
    written.log.write_text(log.replace(f"center_{written.stems[7]}", f"{EVIL}".replace("\r", "")))
    written.image(3).write_bytes(b"")
    result = run(tmp_path, str(folder), module="datamodules.check", timeout=60)
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


def test_the_leaderboard_escapes_names_of_runs_and_tracks(tmp_path: Path) -> None:
    evil_runs(tmp_path)
    result = run(tmp_path, ".", module="zoo.leaderboard", timeout=60)
    assert result.returncode == 0, result.stderr
    assert not control_characters(result.stdout + result.stderr)
    assert "1 damaged: " in result.stdout
    assert "9 failed" not in result.stdout.splitlines()


def test_on_a_terminal_it_escapes_them_too(tmp_path: Path) -> None:
    """Colours and table frames stay; other control characters are not printed."""
    evil_runs(tmp_path)
    printed = on_a_terminal(tmp_path, *command("zoo.leaderboard", "."))
    assert "damaged" in printed
    assert "\x1b[1m" in printed or "\x1b[3m" in printed
    for sequence in ("\x1b[2J", "\x1b]", "\x07", "\x9b", "\u202e"):
        assert sequence not in printed


def test_a_report_escapes_the_name_of_its_run(tmp_path: Path) -> None:
    folder = write_run(tmp_path / f"{EVIL}\nx", 0.9)
    config = {"seed": 1, "data": {"root": None}, "model": {"name": "linear"}}
    (folder / ".hydra" / "config.yaml").write_text(json.dumps(config))
    result = run(tmp_path, str(folder), module="zoo.report", timeout=100)
    assert result.returncode == 0, result.stderr
    assert not control_characters(result.stdout + result.stderr)
    assert len(result.stdout.splitlines()) == 3, "two files and the next command"


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
