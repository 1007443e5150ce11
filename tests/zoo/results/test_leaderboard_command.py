"""The ranking of runs: order, repeats by training seed, files, and runs that cannot be ranked."""

import csv
import itertools
import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from tests.contracts.outside_package import installed, manual_example
from tests.zoo.command_runs import only_line, run_here, succeed
from tests.zoo.results.synthetic_results import ROADS, figures, of_levels, result, write
from tests.zoo.server.browser import CHROMIUM, Browser
from tests.zoo.sweeps import change_status, write_run
from zoo.base.entry_points import installed_entries
from zoo.base.errors import InputError, UsageError
from zoo.commands.leaderboard import leaderboard
from zoo.driving.drive_log import write_drive
from zoo.driving.drive_record import SOCKET, Drive, DriveRow
from zoo.results.benchmarked import overall
from zoo.results.checked_result import read_result
from zoo.results.ranking import named_columns, rank, ranked_figures, seeds_column
from zoo.results.ranking_page import Ranking
from zoo.results.scored import drive_folders, load_drive, load_run, read_scored, run_folders
from zoo.runs.metrics_file import write_metrics_file
from zoo.runs.status import write_status


def ranked(*folders: Path) -> list[list[str]]:
    """Return the folder names of each entry, in ranked order."""
    runs, unranked = read_scored(folders)
    assert not unranked
    return [[run.folder.name for run in entry.runs] for entry in rank(runs)]


def test_autonomy_ranks_first_then_error_then_validation(tmp_path: Path) -> None:
    better_mse = write_run(tmp_path / "a", 0.8, val_mse=0.001, overrides=("x=1",))
    near = write_run(tmp_path / "b", 1.0, cte_m=0.2, overrides=("x=2",))
    far = write_run(tmp_path / "c", 1.0, cte_m=0.4, overrides=("x=3",))
    low = write_run(tmp_path / "d", 1.0, cte_m=0.4, val_mse=0.002, overrides=("x=4",))
    undriven = write_run(tmp_path / "e", None, val_mse=0.0001, overrides=("x=5",))
    order = ranked(undriven, better_mse, far, near, low)
    assert order == [["b"], ["d"], ["c"], ["a"], ["e"]]


@pytest.mark.parametrize(
    ("runs", "words"),
    [
        ([{"autonomy": 0.9}, {"autonomy": None}], "the best driver first"),
        ([{"autonomy": 0.0}, {"autonomy": 0.0}], "none drives: the smallest cross-track error"),
        ([{"autonomy": None}, {"autonomy": None}], "nothing was driven: the lowest validation MSE"),
        (
            [{"autonomy": 0.9, "tracks": ("lake",)}, {"autonomy": 0.8, "tracks": ("mountain",)}],
            "the best driver first, but on different tracks",
        ),
    ],
)
def test_the_order_is_named(runs: list[dict], words: str, tmp_path: Path, console: Console) -> None:
    folders = [
        write_run(tmp_path / str(number), overrides=(f"x={number}",), **run)
        for number, run in enumerate(runs)
    ]
    ranking = Ranking.read(folders, tmp_path, title="2 jobs")
    ranking.show(console)
    assert f"2 jobs, {words}" in " ".join(console.file.getvalue().split())
    assert words[1:] in ranking.write_page(tmp_path / "page.html", "2 jobs").read_text()
    assert words in ranking.result_table().caption


@pytest.mark.parametrize(("source", "command"), [(None, "benchmark"), ("donkeycar", "replay")])
def test_the_next_command_drives_the_best_networks_own_car(
    source: str | None, command: str, tmp_path: Path, console: Console
) -> None:
    data = {"fingerprint": "0" * 16, "rows": 9, "source": source}
    Ranking.read([write_run(tmp_path / "0", data=data)], tmp_path).show(console)
    last = console.file.getvalue().splitlines()[-1]
    assert shlex.split(last)[:3] == ["next:", "drivezoo", command]


def write_socket_drive(folder: Path, mph: float = 9.0) -> Path:
    """Write a drive of one minute from a socket, with one intervention."""
    rows = [DriveRow(0.5 * step, speed_mph=mph, cross_track_m=0.1) for step in range(121)]
    rows[60] = replace(rows[60], intervention=True)
    write_drive(folder, Drive.of(rows, source=SOCKET, track="lake"), set_mph=20.0)
    return folder


def ranked_lines(cwd: Path, *arguments: str) -> list[str]:
    """Return the printed lines of the first three places."""
    printed = succeed(run_here(cwd, *arguments, module="zoo.commands.leaderboard"))
    return re.findall(r"^│ [123] .*$", printed, re.MULTILINE)


@pytest.fixture
def wide(here: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the test's folder, which is the current one of a wide terminal."""
    monkeypatch.setenv("COLUMNS", "200")
    return here


def test_a_drive_on_a_socket_is_ranked_among_runs(wide: Path) -> None:
    write_run(Path("runs/good"), 1.0, cte_m=0.2)
    write_run(Path("runs/bad"), 0.5, cte_m=0.2, overrides=("x=2",))
    write_socket_drive(Path("drives/day/time"), mph=40.0)
    first, second, third = ranked_lines(wide, "runs", "drives")
    assert "100.0%" in first
    for text in ("socket", "90.0%", "0.10"):
        assert text in second
    assert "50.0%" in third
    assert "socket" in Path("runs/leaderboard.html").read_text()


def test_a_short_drive_comes_after_longer_ones_with_its_length(wide: Path) -> None:
    write_evaluation(Path("scores/tenth"), 1.0, "a.ckpt", laps=0.1)
    write_evaluation(Path("scores/whole"), 0.7, "b.ckpt", laps=1.0)
    write_socket_drive(Path("scores/minute"))
    first, second, third = ranked_lines(wide, "scores", "table=a.csv")
    assert "whole" in first
    assert "70.0%" in first
    assert " of " not in first.replace("1 of 2", "")
    assert "100.0%" in second
    assert "90.0%" in third
    assert "of 0.1 laps" in Path("scores/leaderboard.html").read_text()
    assert "of 241 m" in Path("scores/leaderboard.html").read_text()
    with Path("a.csv").open() as file:
        assert [row["lake_laps"] for row in csv.DictReader(file)] == ["1.0", "0.1", ""]


@pytest.mark.usefixtures("here")
def test_results_of_the_benchmark_are_ranked(capsys: pytest.CaptureFixture) -> None:
    rng = np.random.default_rng(1)
    for name, autonomy in (("good", 0.9), ("bad", 0.6)):
        content = result(figures(rng, autonomy, 3, 0.01, np.zeros(len(ROADS))), name)
        write(Path("marks", name), content)
    ranking = leaderboard("marks")
    assert [entry.first.name for entry in ranking.entries] == ["good", "bad"]
    best = ranking.entries[0].first
    summary = overall(read_result(Path("marks/good")))
    assert best.mean("autonomy") == pytest.approx(summary["autonomy"].value)
    leaderboard.main(["marks"])
    assert "next: drivezoo compare marks/good marks/bad" in capsys.readouterr().out
    assert "code" not in ranking.table()[0]
    write(Path("marks/new"), content | {"code": {"hash": "b2"}})
    assert {row["code"] for row in leaderboard("marks").table()} == {"a1", "b2"}


def test_a_folder_that_two_paths_name_counts_once(
    here: Path, capsys: pytest.CaptureFixture
) -> None:
    write(here / "marks" / "a", result(np.full((3, len(ROADS)), 0.9)))
    write_run(here / "runs" / "b")
    (here / "link").symlink_to("runs")
    leaderboard("marks", here / "marks", "runs", "link").show()
    printed = capsys.readouterr().out
    assert "1 run; evaluations, benchmarks or drives: 1" in " ".join(printed.split())
    assert "of 84" in printed, "three trainings on 28 roads"


def test_drives_of_levels_are_ranked_by_the_share_of_clean_ones(tmp_path: Path) -> None:
    roads = [("bends", f"bends_{level}:{road}", {}) for level in (1, 2) for road in range(4)]
    for name, autonomy in (("late", [0.99] * 8), ("half", [1.0] * 4 + [0.5] * 4)):
        write(tmp_path / name, of_levels(np.array([autonomy] * 3), name, roads))
    first, second = leaderboard(tmp_path).table()
    assert (first["run"], first["training_seeds"], second["run"]) == ("half", 3, "late")
    assert list(first)[5] == "own 012345 15.0_without_intervention", "of one speed"
    assert first["own 012345 15.0_without_intervention"] == 0.5


@pytest.mark.usefixtures("here")
def test_a_page_that_was_edited_or_is_another_is_kept() -> None:
    write_run(Path("runs/a"), 0.9)
    page = Path("runs/leaderboard.html")
    for _ in range(2):
        leaderboard("runs")
    written = page.read_text()
    for text in ("mine", written.replace("<title>", "<title>My "), written + "mine"):
        page.write_text(text)
        with pytest.raises(UsageError, match=r"runs/leaderboard\.html: exists"):
            leaderboard("runs")
        assert page.read_text() == text
    leaderboard("runs", overwrite=True)
    assert "mine" not in page.read_text()


@pytest.mark.usefixtures("here")
def test_a_table_replaces_no_file_of_a_run() -> None:
    write_run(Path("runs/a"), 0.9)
    log = Path("runs/a/metrics.csv")
    log.write_text("mine")
    with pytest.raises(InputError, match=r"table=.*metrics\.csv: is an input"):
        leaderboard("runs", table=str(log), overwrite=True)
    assert log.read_text() == "mine"


def test_the_drives_of_a_folder_that_holds_runs_are_not_ranked(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", 1.0)
    write_socket_drive(run / "drives" / "lake-0")
    assert list(drive_folders(tmp_path)) == []
    assert list(drive_folders(run / "drives")) == [run / "drives" / "lake-0"]


def write_evaluation(
    folder: Path, autonomy: float, checkpoint: str, world: str = "embedded", mph: float = 15, **more
) -> Path:
    """Write an evaluation of two drives on the lake, as `drivezoo evaluate` does."""
    for seed in (0, 1):
        write_socket_drive(folder / f"lake-{seed}")
    figures = {"drives": 2, "drives_without_intervention": 1, "autonomy": [autonomy, 0.1]}
    tracks = {"lake": figures | {"cte_mean_m": [0.2, 0.1], "interventions": [0.5, 0.7]}}
    tracks["lake"] |= {key: [value, 0.0] for key, value in more.items()}
    settings = {"speed": str(float(mph)), "laps": "1.0"}
    about = {"checkpoint": checkpoint, "world": world, "settings": settings}
    write_metrics_file(folder, about | {"drives": [], "tracks": tracks})
    return folder


@pytest.mark.usefixtures("wide")
def test_an_evaluation_is_one_entry_with_its_means(capsys: pytest.CaptureFixture) -> None:
    write_evaluation(Path("scores/ann"), 0.7, "submitted/ann.ckpt")
    write_evaluation(Path("scores/bob"), 0.9, "submitted/bob 1.ckpt", mph=20)
    write_evaluation(Path("scores/cleo"), 0.5, "submitted/cleo.ckpt", world="donkey")
    leaderboard.main(["scores"])
    printed = capsys.readouterr().out
    first, second, third = re.findall(r"^│ [123] .*$", printed, re.MULTILINE)
    assert "embedded" in second
    assert "donkey" in third
    for text in ("bob", "90.0%", "1 of 2", "20.0"):
        assert text in first
    assert "70.0%" in second
    assert "next: drivezoo benchmark 'submitted/bob 1.ckpt' suite=quick" in printed


def test_a_drive_is_measured_where_its_file_lacks_figures(tmp_path: Path) -> None:
    folder = write_socket_drive(tmp_path / "drive")
    whole, file = load_drive(folder), folder / "drive.json"
    assert whole.overrides == {"set_mph": "20"}, "a column where drives differ"
    file.unlink()
    (measured,) = load_drive(folder).tracks.values()
    assert measured == pytest.approx(whole.tracks["lake"])
    figures = {"version": 1, "drive": "replay", "autonomy": None, "driven_m": 0.0}
    file.write_text(json.dumps(figures | {"interventions": 0}))
    assert load_drive(folder).mean("autonomy") is None


@pytest.mark.parametrize(("file", "text"), [("drive.json", "[]"), ("result.json", "{}")])
def test_what_is_damaged_is_named_the_others_ranked(file: str, text: str, tmp_path: Path) -> None:
    good, bad = write_socket_drive(tmp_path / "a"), tmp_path / "b"
    if file == "drive.json":
        write_socket_drive(bad)
    bad.mkdir(exist_ok=True)
    (bad / file).write_text(text)
    scored, (unranked,) = read_scored([], drive_folders(tmp_path))
    assert [run.folder for run in scored] == [good]
    assert (unranked.folder, unranked.why) == (bad, "damaged")
    assert unranked.reason.startswith(f"{file}: ")
    table = leaderboard(bad, table=tmp_path / "table.csv")
    assert table.entries == [], "a folder with nothing else has an empty table"
    assert len((tmp_path / "table.csv").read_text().splitlines()) == 1


def test_repeats_with_other_seeds_are_one_entry_with_a_spread(tmp_path: Path) -> None:
    for seed, autonomy in ((1, 0.9), (2, 1.0), (3, 0.8)):
        about = {"root": f"/{seed}/lake", "fingerprint": "a" * 16}  # a folder that was moved
        write_run(tmp_path / str(seed), autonomy, seed=seed, start_seeds=3, **about)
    write_run(tmp_path / "other", 0.85, overrides=("model=lenet",), **about | {"root": "/1/lake"})
    first, second = rank(read_scored(sorted(tmp_path.iterdir()))[0])
    assert [run.seed for run in first.runs] == [1, 2, 3]
    mean, spread = first.figures["autonomy"]
    assert mean == pytest.approx(0.9)
    assert spread == pytest.approx(0.1)  # sample deviation of three values
    assert second.first.folder.name == "other"
    assert first.counts["lake"] == (3, 9)
    headings = {column.heading for column in named_columns([first, second], tmp_path)}
    assert headings == {"", "run"}, "all share the recording, and a column of settings the model"


def test_a_repeated_training_counts_once(tmp_path: Path) -> None:
    for name, seed, autonomy in (("a", 1, 0.9), ("again", 1, 0.9), ("b", 2, 0.8)):
        write_run(tmp_path / name, autonomy, seed=seed, root="/a/lake")
    (entry,) = entries = rank(read_scored(sorted(tmp_path.iterdir()))[0])
    assert ranked_figures(entries)[0].interval(entry).low < 0.5
    mean, deviation = entry.figures["autonomy"]
    assert (mean, deviation) == pytest.approx((0.85, 0.005**0.5)), "of the seeds, not of the runs"
    assert seeds_column(entries).cells == ["1, 1, 2\n(n = 2)"]


@pytest.mark.parametrize(
    ("key", "values", "text"),
    [
        ("precision", ("32-true", "bf16-mixed"), ", precision 32-true and bf16-mixed"),
        ("precision", ("32-true", "32-true"), ""),
        ("precision", (None, "32-true"), ""),
        ("code", ({"hash": "fedcba98"}, {"hash": "01234567"}), ", code 012345 and fedcba"),
    ],
)
def test_several_precisions_or_codes_are_marked(
    key: str, values: tuple, text: str, tmp_path: Path
) -> None:
    for seed, value in enumerate(values, 1):
        write_run(tmp_path / str(seed), 0.9, seed=seed, root="/a/lake", **{key: value})
    entries = rank(read_scored(sorted(tmp_path.iterdir()))[0])
    assert seeds_column(entries).cells == [f"1, 2\n(n = 2{text})"]


def drives_on(**tracks: tuple[float, float]) -> dict:
    """Return a run's figures of its drives, by track its mean autonomy and the spread."""
    other = {"cte_mean_m": [0.3, 0.0], "interventions": [1.0, 0.0]}
    figures = {track: other | {"autonomy": [*autonomy]} for track, autonomy in tracks.items()}
    return {"laps": 1.0, "seeds": 3, "tracks": figures}


def test_only_tracks_that_all_runs_share_count(tmp_path: Path) -> None:
    drives = drives_on(lake=(1.0, 0.0), mountain=(0.2, 0.0))
    both = write_run(tmp_path / "both", overrides=("x=1",), drive=drives)
    lake = write_run(tmp_path / "lake", 0.9, overrides=("x=2",))
    assert ranked(both, lake) == [["both"], ["lake"]]


def test_a_real_run_is_read_whole(run_folder: Path) -> None:
    run = load_run(run_folder)
    metrics = json.loads((run_folder / "metrics.json").read_text())
    assert run.name == "nvidia"
    assert run.mean("autonomy") == metrics["drive"]["tracks"]["lake"]["autonomy"][0]
    assert run.val_mse == metrics["open_loop"]["val"]["mse"]
    assert set(run.curves["val/mse"]) == {1, 2}
    assert run.overrides["trainer.max_epochs"] == "2"
    assert not any(key.startswith("hydra") for key in run.overrides)


def test_runs_without_figures_are_counted_and_named(tmp_path: Path) -> None:
    outputs = tmp_path / "outputs" / "today"
    write_run(outputs / "good", 0.97)
    write_status(write_run(outputs / "bad", 1.0), "failed", reason="no space left")
    write_status(write_run(outputs / "going"), "running")
    write_status(write_run(outputs / "killed"), "running")
    change_status(outputs / "killed", process_started=12.5)
    old = write_run(outputs / "old", drive={"track": "lake", "autonomy": 1.0}, open_loop=None)
    (write_run(outputs / "broken") / "metrics.json").write_text("{")
    (tmp_path / "outputs" / "cache").mkdir()

    out = succeed(run_here(tmp_path, module="zoo.commands.leaderboard"))

    assert "6 runs" in out
    assert "97.0%" in out
    for line in (
        r"1 failed: today/bad \(no space left\)",
        r"1 .*running: today/going",
        r"1 stopped.*: today/killed",
        rf"1 older.*: today/{old.name}",
        r"1 damaged: today/broken \(metrics\.json: .*JSON",
    ):
        assert re.search(f"^{line}", out, re.MULTILINE), line
    assert (tmp_path / "outputs" / "leaderboard.html").is_file()


def test_runs_are_found_in_sweeps_and_not_below_runs(tmp_path: Path) -> None:
    write_run(tmp_path / "sweeps" / "day" / "time" / "0")
    write_run(write_run(tmp_path / "day" / "time") / "again")
    paths = {str(path.relative_to(tmp_path)) for path in run_folders(tmp_path)}
    assert paths == {"sweeps/day/time/0", "day/time"}


@pytest.mark.parametrize(
    ("argument", "words"),
    [("nowhere", "nowhere: "), (".", "outputs/evaluations"), ("--all", "all: no such key")],
)
def test_bad_input_gets_one_line(argument: str, words: str, tmp_path: Path) -> None:
    assert words in only_line(run_here(tmp_path, argument, module="zoo.commands.leaderboard"))


def page_of(tmp_path: Path) -> Path:
    for number, autonomy in enumerate((0.9, 1.0, 0.7)):
        for seed in (1, 2):
            overrides = (f"optim.lr=0.00{number + 1}", "data.root=</script>")
            folder = tmp_path / f"{number}-{seed}"
            write_run(folder, autonomy, seed=seed, overrides=overrides)
    ranking = Ranking.read(sorted(tmp_path.iterdir()), tmp_path)
    return ranking.write_page(tmp_path / "ranking.html", "A <sweep>")


def test_the_page_holds_all_it_needs(tmp_path: Path) -> None:
    text = page_of(tmp_path).read_text()
    assert "A &lt;sweep&gt;" in text
    assert re.findall(r'<tr data-entry="\d">', text) == [f'<tr data-entry="{n}">' for n in range(3)]
    fetched = [url for url in re.findall(r"https?://[^\"' ]+", text) if "w3.org" not in url]
    assert fetched == []


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed; apt install chromium")
def test_the_page_draws_and_picks(tmp_path: Path) -> None:
    page = page_of(tmp_path)
    with Browser(tmp_path / "profile", 1200, 900) as browser:
        browser.open(page.as_uri())
        assert browser.wait_for("document.querySelectorAll('#parallel .entry').length") == 3
        assert browser.value("document.querySelectorAll('#curves .entry').length") == 6
        browser.value("data.entries.forEach((one, n) => { one.values.near = 1 + n / 1e5; })")
        ticks = "scale({key: 'near'}).ticks.map(([, label]) => label)"
        assert browser.value(f"new Set({ticks}).size") == 5
        # The best is the first row; sorted by its learning rate it is the second.
        browser.click("#ranking th:nth-child(3)")
        order = "[...document.querySelectorAll('#ranking tbody tr')].map((r) => r.dataset.entry)"
        assert browser.value(f"{order}.join()") == "1,0,2"
        # Drag along the upper third of the first axis.
        browser.value("document.querySelector('#parallel').scrollIntoView()")
        x, y, height = browser.value(
            "(() => { const b = document.querySelector('.hand').getBoundingClientRect();"
            " return [b.x + b.width / 2, b.y, b.height]; })()"
        )
        for kind, at in (("mousePressed", 0.0), ("mouseMoved", 0.3), ("mouseReleased", 0.3)):
            mouse = {"type": kind, "x": x, "y": y + at * height, "button": "left", "clickCount": 1}
            buttons = 0 if kind == "mouseReleased" else 1
            browser.call("Input.dispatchMouseEvent", **mouse, buttons=buttons)
        # It shows the learning rate, highest on top: the drag selects the worst entry only.
        assert browser.value("document.querySelectorAll('#ranking tr.out').length") == 2
        browser.call("Emulation.setEmulatedMedia", media="print")  # paper does not scroll
        frame = "getComputedStyle(document.querySelector('.scroll'))"
        assert browser.value(f"{frame}.overflow + {frame}.maxHeight") == "visiblenone"
        assert not browser.errors


def many_runs(folder: Path) -> list[Path]:
    """Write runs with names and settings too long for a narrow terminal."""
    runs = []
    for model, seed in itertools.product(("nvidia", "commaai"), (1, 2, 3)):
        path = folder / f"2026-11-2{seed}" / f"10-00-0{seed}[/red]{model}"
        keys = (f"model={model}", f"augment=[brightness,shadow,{model}]")
        keys += (f"data.offset=0.{len(model)}", f"optim.lr=0.00{len(model)}")
        driven = {"tracks": ("lake", "mountain"), "start_seeds": 3, "root": f"/{model}/lake"}
        runs.append(write_run(path, 0.9 + 0.01 * seed, seed=seed, overrides=keys, **driven))
    return runs


def cells_of(text: str) -> list[list[str]]:
    """Return the body's cells row by row, each with its lines joined."""
    rows: list[list[str]] = []
    for line in text.splitlines():
        if line.startswith("│"):
            parts = [part.strip() for part in line.strip("│").split("│")]
            if parts[0]:
                rows.append([""] * len(parts))
            rows[-1] = [a + b for a, b in zip(rows[-1], parts, strict=True)]
    return rows


@pytest.mark.parametrize("width", [80, 100, 120, 160, 200])
def test_names_never_vanish(width: int, tmp_path: Path, console: Console) -> None:
    console.width = width
    Ranking.read(many_runs(tmp_path), tmp_path, title="all [/red] runs").show(console)

    text = console.file.getvalue()
    assert all(len(line) <= width for line in text.splitlines() if line.startswith("│"))
    rows = cells_of(text)
    assert [row[0] for row in rows] == ["1", "2"]
    assert "all [/red] runs" in text
    for row, model in zip(rows, ("commaai", "nvidia"), strict=True):
        text = " ".join(row).replace(" ", "")
        settings = (f"[brightness,shadow,{model}]", f"0.{len(model)}", f"0.00{len(model)}")
        figures = ("lake(012345)", "1,2,3(n=3)", "92.0%89.5%..94.5%", "0of9")
        for name in (f"2026-11-21/10-00-01[/red]{model}", *settings, *figures):
            assert name in text, name


def test_figures_that_do_not_fit_are_named(tmp_path: Path, console: Console) -> None:
    console.width = 80
    Ranking.read(many_runs(tmp_path), tmp_path).show(console)

    (line,) = [row for row in console.file.getvalue().splitlines() if "not shown in 80" in row]
    headings = set(line.partition(": ")[2].split("; "))
    assert {"val MSE", "test MSE", "seconds"} <= headings
    assert "autonomy" not in headings
    console.width = 400
    Ranking.read(many_runs(tmp_path / "wide"), tmp_path).show(console)
    assert console.file.getvalue().count("not shown") == 1


def test_runs_on_other_recordings_are_separate_entries(tmp_path: Path) -> None:
    for seed, (root, fingerprint) in enumerate(
        [("/a/lake", "aaaaaaaa"), ("/a/lake", "bbbbbbbb"), ("/b/lake", "cccccccc")]
    ):
        folder = tmp_path / str(seed)
        write_run(folder, 1 - seed / 10, seed=seed, root=root, fingerprint=fingerprint)
    entries = rank(read_scored(sorted(tmp_path.iterdir()))[0])

    (column,) = [item for item in named_columns(entries, tmp_path) if item.heading == "recording"]
    assert column.cells == ["lake (aaaaaa)", "lake (bbbbbb)", "lake (cccccc)"]


def test_a_single_training_shows_no_spread_over_its_start_seeds(tmp_path: Path) -> None:
    run = write_run(tmp_path / "a", drive=drives_on(lake=(0.9, 0.2)))
    (entry,) = rank(read_scored([run])[0])

    assert entry.figures["lake/autonomy"] == (0.9, None)


def rows_of(path: Path) -> list[list[str]]:
    """Return the cells of a TeX table's rows, the headings first."""
    lines = [line for line in path.read_text().splitlines() if line.endswith(r"\\")]
    return [line.removesuffix(r" \\").split(" & ") for line in lines]


@pytest.mark.usefixtures("here")
def test_the_table_of_a_sweep_is_short_for_a_paper_and_whole_for_a_program() -> None:
    for seed, autonomy in ((1, 0.9), (2, 1.0), (3, 0.8)):
        write_run(Path(f"sweep/a{seed}"), autonomy, seed=seed)
        write_run(Path(f"sweep/b{seed}"), 0.5, seed=seed, overrides=("model=lenet",))
    Path("sweep/a1/.hydra/overrides.yaml").write_text('["logger=tensorboard"]')  # of one config
    leaderboard("sweep", table="a.tex")
    leaderboard("sweep", table="a.csv", overwrite=True)
    heads, first, second = rows_of(Path("a.tex"))
    assert heads[:2] == ["model", "training seeds"]
    assert len(heads) == 5
    assert first[:3] == ["tiny", "1, 2, 3 (n = 3)", r"90.0\% (65.2\% to 100.0\%)"]
    assert second[2] == r"50.0\%"
    assert str(Path.cwd()) not in Path("a.tex").read_text()
    with Path("a.csv").open() as file:
        best, _ = csv.DictReader(file)
    assert float(best["lake_autonomy_low"]) == pytest.approx(0.652, abs=0.001)
    assert best["rank"] == "1"
    assert {"run", "val_mse", "wall_s", "lake_drives_without_intervention"} <= set(best)


def test_true_in_capitals_is_no_other_setting(tmp_path: Path) -> None:
    for seed, word in ((1, "True"), (2, "true")):
        quick = ("model=tiny", f"quick={word}")
        write_run(tmp_path / "runs" / str(seed), 0.9, seed=seed, overrides=quick)
    write_run(tmp_path / "runs" / "3", 0.8, overrides=("model=lenet",))
    ranking = leaderboard(tmp_path / "runs")
    assert {row["quick"] for row in ranking.table()} == {"true", None}


def test_runs_of_several_folders_are_named_from_the_current_folder(here: Path) -> None:
    for name in ("a", "b"):
        write_run(here / name / "today" / "run", 0.9, overrides=(f"x={name}",))
    ranking = leaderboard(here / "a", here / "b")
    assert {row["run"] for row in ranking.table()} == {"a/today/run", "b/today/run"}
    (row,) = leaderboard("a/today/run").table()
    assert row["run"] == "a/today/run", "the folder of a single run"


def test_a_package_adds_files_to_a_paper(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_run(Path("sweep/a"), 0.9)
    code, group = manual_example("my_paper.py"), "drivezoo.papers"
    with installed(here / "site", code, group, attribute=":write_seeds"):
        mine = [entry for entry in installed_entries(group) if entry.name == "mine"]
        monkeypatch.setattr("zoo.commands.leaderboard.installed_entries", lambda group: mine)
        Path("paper").mkdir()
        ranking = leaderboard("sweep", paper="paper")
    text = Path("paper/seeds.txt").read_text()
    assert text.startswith("drivezoo leaderboard sweep paper=paper\nsweep")
    assert ranking.written == [Path("paper/seeds.txt")]
    assert "1 training seeds" in ranking.notes


def test_without_a_writer_no_paper_is_written(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_run(Path("sweep/a"), 0.9)
    monkeypatch.setattr("zoo.commands.leaderboard.installed_entries", lambda group: [])
    with pytest.raises(UsageError, match="paper=paper: nothing that is installed writes papers"):
        leaderboard("sweep", paper="paper", table="a.csv")
    assert sorted(path.name for path in here.iterdir()) == ["sweep"]
