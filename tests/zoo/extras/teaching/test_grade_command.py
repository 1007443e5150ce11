"""`drivezoo grade`: marks of a class on drawn roads, warnings and pages."""

import csv
import functools
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import yaml

from datamodules.recording import make_recording
from tests.refusals import refusal
from tests.zoo.command_runs import only_line, run_here
from tests.zoo.results.test_benchmark_command import write_family, write_suite
from tests.zoo.written_checkpoints import write_constant, write_pilotnet
from zoo.base import console_progress
from zoo.base.bounded_files import hash_file
from zoo.base.errors import InputError, StoppedError, UsageError
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.checkpoint_path import PACKAGED
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.commands.benchmark import benchmark
from zoo.extras.teaching import graded
from zoo.extras.teaching.grade import grade
from zoo.extras.teaching.redrawn_suite import redraw_suite, redrawn
from zoo.extras.teaching.submissions import Submission, find_submissions, warnings_of
from zoo.extras.teaching.submitted_network import (
    IMAGES,
    NetworkFacts,
    facts_file,
    network_facts,
    read_facts,
    write_facts,
)
from zoo.results.checked_result import read_result
from zoo.results.result import NAME, Driver, write_result
from zoo.results.suite import read_suite
from zoo.training.recorded_roads import road_key, trained_roads


@pytest.fixture(scope="module", autouse=True)
def _packaged_facts() -> Iterator[None]:
    """Read the facts on each packaged network once: every class is compared with all."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(graded, "network_facts", functools.cache(graded.network_facts))
        yield


@pytest.fixture(scope="module")
def submitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of a class: good, off the road, twice the same, damaged, and missing."""
    folder = tmp_path_factory.mktemp("class")
    (folder / "ben").mkdir()
    write_constant(folder / "ada.ckpt", 0.0)
    write_constant(folder / "ben" / "net.ckpt", -1.0)
    shutil.copy(folder / "ada.ckpt", folder / "dora.ckpt")
    (folder / "eve.ckpt").write_text("no network")
    (folder / "finn").mkdir()
    return folder


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a suite of one short and wide road, with a mark."""
    folder = tmp_path_factory.mktemp("suite")
    path = write_suite(folder, groups={}, marks={"like": {"autonomy": 0.9}})
    road = write_family(folder, width=[20, 20])
    content = yaml.safe_load(path.read_text())
    path.write_text(yaml.safe_dump(content | {"groups": {"like": [{"track": f"{road}:1"}]}}))
    return path


def drive_here(folder: Path, submission: Submission, suite: Path, *_: object) -> None:
    """Drive a submission in this process, which is faster than one of its own."""
    folder.parent.mkdir(exist_ok=True)
    with suppress(InputError):
        write_facts(submission.file, facts_file(folder))
    try:
        benchmark.main([str(submission.file), f"suite={suite}", f"out={folder}", "workers=1"])
    except InputError:
        if not (folder / NAME).is_file():  # a missed mark is an error, too
            raise


@pytest.fixture(scope="module")
def marked(submitted: Path, suite: Path, tmp_path_factory: pytest.TempPathFactory) -> graded.Graded:
    out = tmp_path_factory.mktemp("marked") / "out"
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(graded, "_drive", drive_here)
        return grade(submitted, suite=str(suite), seed=5, out=str(out))


def test_each_student_has_a_row_and_a_page(marked: graded.Graded) -> None:
    status = {student.submission.name: student.status for student in marked.grades}
    expected = {"ada": "passed", "ben": "missed", "dora": "passed"}
    assert status == expected | dict.fromkeys(["eve", "finn"], "not driven")
    lines = {line.partition(":")[0]: line for line in marked.lines}
    assert "same network as dora" in lines["ada"]
    assert "not a torch file" in lines["eve"]
    assert "no .ckpt or .onnx file" in lines["finn"]
    pages = {page.stem: page.read_text() for page in (marked.folder / graded.PAGES).iterdir()}
    assert pages.keys() == status.keys()
    for name, words in (("eve", "not a torch file"), ("finn", "no .ckpt or .onnx file")):
        assert "not driven" in pages[name]
        assert words in pages[name]
    assert "Not passed" in pages["ben"]
    assert "data:video/mp4;base64," in pages["ben"]
    assert "a road of short" in pages["ben"]
    assert "<video" not in pages["ada"]
    rows = {row["student"]: row for row in marked.table()}
    assert rows["ben"]["like_autonomy"] < 0.9 <= rows["ada"]["like_autonomy"]


def test_points_are_the_share_of_marks_passed(marked: graded.Graded) -> None:
    points = {row["student"]: row["points"] for row in marked.table()}
    assert points == {"ada": 10, "ben": 0, "dora": 10, "eve": None, "finn": None}
    assert "number" not in marked.table()[0]
    passed, missed = (SimpleNamespace(passed=value) for value in (True, False))
    third = graded.Grade(Submission("ann", None), reached=[passed, missed, missed])
    assert graded.Graded(Path(), [third], most_points=20).points == [6.67]


def test_no_page_of_a_student_names_a_drawn_road(marked: graded.Graded, suite: Path) -> None:
    drawn = {drive.track for drive in read_suite(str(marked.folder / graded.SUITE)).drives}
    assert not drawn & {drive.track for drive in read_suite(str(suite)).drives}
    for page in (marked.folder / graded.PAGES).iterdir():
        assert not any(track.rpartition(":")[2] in page.read_text() for track in drawn)


def test_it_resumes_without_driving_again(
    marked: graded.Graded, submitted: Path, suite: Path, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driven = []
    monkeypatch.setattr(graded, "_drive", lambda folder, *_: driven.append(folder.name))
    for seed, words in ((6, "other roads were begun"), ("random", "begun without seed=random")):
        with pytest.raises(InputError, match=words):
            grade(submitted, suite=str(suite), seed=seed, out=marked.folder)
    assert not (marked.folder / graded.SEED).exists()
    again = grade(submitted, suite=str(suite), seed=5, out=marked.folder)
    assert [name[:4] for name in driven] == ["eve-"]
    assert again.grades[0].result == marked.grades[0].result
    assert not any("other code" in line for line in again.lines)
    monkeypatch.setattr(graded, "code_fingerprint", lambda: {"hash": "another"})
    (line, *_) = grade(submitted, suite=str(suite), seed=5, out=marked.folder).lines
    assert line.startswith("ada: driven by other code (")
    shutil.copytree(marked.folder, here / "out")
    write_family(suite.parent, width=[19, 19])  # at the same path
    (line, *_) = grade(submitted, suite=str(suite), seed=5, out="out").lines
    write_family(suite.parent, width=[20, 20])
    assert re.match("ada: not driven: out/drives/ada-.*: roads: .* is not that of the suite", line)


@pytest.mark.usefixtures("as_ada")
def test_a_random_seed_is_kept_and_resumed(
    suite: Path, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    write_constant(here / "class" / "0123_ann.ckpt", 0.0)
    write_constant(here / "class" / "9lives.ckpt", 0.0)
    seeds = iter((5, 6))  # ada's drives are of 5
    monkeypatch.setattr(graded.secrets, "randbelow", lambda _: next(seeds))
    first = grade("class", suite=str(suite), seed="random", out="out")
    assert f"{Path('out', graded.SEED)}: " in capsys.readouterr().out
    seed, roads = ((here / "out" / name).read_text() for name in (graded.SEED, graded.SUITE))
    assert roads == redraw_suite(str(suite), int(seed), 1)
    monkeypatch.setattr(graded, "_drive", None)  # nothing is driven again
    again = grade("class", suite=str(suite), seed="random", out="out")
    assert (here / "out" / graded.SUITE).read_text() == roads
    assert again.table() == first.table()
    rows = csv.DictReader((here / "out" / "grades.csv").read_text().splitlines())
    assert [(row["student"], row["number"], row["points"]) for row in rows] == [
        ("0123_ann", "0123", "10.0"),
        ("9lives", "", "10.0"),
    ]
    grade("class", suite=str(suite), seed="random", out="other")
    assert (here / "other" / graded.SEED).read_text() != seed


def drive_eve(submitted: Path, folder: Path, name: str, most_s: float) -> None:
    """Drive a damaged submission as the command does."""
    submission, out = Submission(name, submitted / "eve.ckpt"), folder / "drives" / f"{name}-0"
    graded._drive(out, submission, folder / "suite.yaml", most_s, Event())


def test_a_submission_has_a_process_and_a_time_of_its_own(submitted: Path, tmp_path: Path) -> None:
    assert "not driven within" in refusal(drive_eve, submitted, tmp_path, "eve.1", 1e-5)
    assert [file.name for file in (tmp_path / "drives").glob("*.txt")] == ["eve.1-0.txt"]


def test_weights_alone_are_handed_in_again_not_driven_by_python(
    tmp_path: Path, suite: Path
) -> None:
    file, out = tmp_path / "net.ckpt", tmp_path / "drives" / "net-0"
    torch.save(torch.nn.Linear(2, 1).state_dict(), file)
    line = refusal(graded._drive, out, Submission("net", file), suite, 5, Event())
    assert line.endswith("whose layers are code; hand in an ONNX file or a checkpoint")
    file.write_bytes(file.read_bytes()[:500])
    line = refusal(graded._drive, out, Submission("net", file), suite, 5, Event())
    assert line.endswith("copy it again, or hand in another")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems set no such limit")
def test_a_submission_has_a_limit_of_memory() -> None:
    limited = 'limit_resource("RLIMIT_DATA", MOST_BYTES); bytearray(MOST_BYTES)'
    program = f"from {network_facts.__module__} import *; {limited}"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ended.stderr.splitlines()[-1:] == ["MemoryError"]


class Ended(subprocess.Popen):
    """A process whose exit status 5 stands for a crash on Windows."""

    def poll(self) -> int | None:
        self.returncode = 0xC0000005 if super().poll() == 5 else self.returncode
        return self.returncode


@pytest.mark.parametrize(
    ("end", "reason"),
    [
        ("print('Segmentation fault'); sys.exit(139)", "^Segmentation fault$"),
        ("print('driving 16 roads: 9%'); sys.exit(5)", "^killed by error 0xc0000005, perhaps"),
        pytest.param(
            "print('driving 16 roads: 9%', flush=True); os.kill(os.getpid(), 9)",
            "^killed by signal 9, perhaps because memory ran out$",
            marks=pytest.mark.skipif(sys.platform == "win32", reason="has no such signal"),
        ),
    ],
)
def test_a_process_that_dies_is_named_by_its_signal_or_last_line(
    submitted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str, reason: str
) -> None:
    program = f"import os, sys; {end}"

    def start(*_: str, **output: object) -> subprocess.Popen:
        return Ended([sys.executable, "-c", program], **output)

    monkeypatch.setattr(graded, "start_module", start)
    with pytest.raises(InputError, match=reason):
        drive_eve(submitted, tmp_path, "eve", 1.0)


def test_ctrl_c_ends_the_submissions_that_it_does_not_reach(
    submitted: Path, suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[subprocess.Popen] = []

    def start(*_: str, **output: object) -> subprocess.Popen:
        words = [sys.executable, "-c", "import time; time.sleep(10)"]
        started.append(subprocess.Popen(words, **output))
        return started[-1]

    def interrupt(jobs: object) -> None:
        while not started:
            time.sleep(0.05)
        raise KeyboardInterrupt

    monkeypatch.setattr(graded, "start_module", start)
    monkeypatch.setattr(graded, "as_completed", interrupt)
    with pytest.raises(StoppedError, match=r"the same command with out=.* resumes"):
        grade(submitted, suite=str(suite), seed=5, out=tmp_path / "out")
    assert [process.poll() for process in started] != [0]


def test_roads_are_drawn_by_the_seed_and_keep_their_families() -> None:
    def tracks(seed: int | None, roads: int = 1) -> dict[str, list[str]]:
        groups = yaml.safe_load(redraw_suite("course", seed, roads))["groups"]
        return {name: [drive["track"] for drive in drives] for name, drives in groups.items()}

    assert redrawn("a/own.yaml:3", 7, 1)[0][2:] == redrawn("b/own.yaml:3", 7, 1)[0][2:]
    course, drawn = tracks(None), tracks(7, roads=2)
    assert drawn == tracks(7, roads=2) != tracks(8, roads=2)
    for group, roads in course.items():
        families = [road.partition(":")[0] for road in roads for _ in range(2)]
        assert [road.partition(":")[0] for road in drawn[group]] == families
        assert not set(roads) & set(drawn[group])


def test_places_of_levels_are_drawn_by_the_seed(tmp_path: Path) -> None:
    suite, drawn = tmp_path / "own.yaml", tmp_path / "drawn.yaml"
    levels = [{"family": "alpine"}, {"family": "alpine", "speed": 18}]
    suite.write_text(yaml.safe_dump({"name": "own", "axes": {"dynamics": levels}, "roads": 3}))
    drawn.write_text(redraw_suite(str(suite), 5, 2))
    places, old = ([each.track for each in read_suite(str(path)).drives] for path in (drawn, suite))
    assert len(places) == 12
    assert not set(places) & set(old)
    suite.write_text(suite.read_text().replace("roads: 3", "roads: 60"))
    with pytest.raises(
        InputError, match=r"^roads=20: name fewer for suite=.*own.yaml: roads: .*1000"
    ):
        redraw_suite(str(suite), 5, 20)
    axes = {f"axis{number}": [{"family": "alpine"} for _ in range(3)] for number in range(2)}
    suite.write_text(yaml.safe_dump({"name": "own", "axes": axes, "roads": 60}))
    with pytest.raises(InputError, match=r"^roads=15: suite=.*: has 5,400 drives.*fewer roads"):
        redraw_suite(str(suite), 5, 15)


def test_two_networks_are_compared_once(
    submitted: Path, suite: Path, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compare, pairs = NetworkFacts.likeness, []

    def counted(first: NetworkFacts, second: NetworkFacts) -> str:
        pairs.append(frozenset((id(first), id(second))))
        return compare(first, second)

    monkeypatch.setattr(graded, "_drive", drive_here)
    monkeypatch.setattr(NetworkFacts, "likeness", counted)
    grade(submitted, suite=str(suite), seed=5, out=here / "out")
    assert len(pairs) == len(set(pairs)) > 3


DRIVER = Driver(file="x", sha256="0", model="LeNet", training_seed=1, parameters=1, data="1")


def test_cards_and_trainings_are_compared_with_the_file(tmp_path: Path) -> None:
    file = write_constant(tmp_path / "ada" / "net.ckpt", 0.0)
    file.with_name("README.md").write_text("Network: 41 parameters; with fingerprint abc.")
    driver = DRIVER.model_copy(update={"parameters": 41, "data": "def"})
    course = make_recording(tmp_path, {"steering": np.linspace(0, 1, 400)}, {})
    facts = NetworkFacts(outputs=[], row_hashes=[*course.row_hashes()[:192], *range(64)])
    facts = facts.model_copy(update={"roads": [road_key("alpine:9"), "udacity_lake"]})
    roads = {road_key(track): track for track in ("alpine:9", "alpine:8")}
    warnings = warnings_of(Submission("ada", file), driver, facts, roads, course)
    assert [line.split(",")[0] for line in warnings] == [
        "trained on alpine:9",
        "trained on def",
        "README.md states with fingerprint abc",
    ]
    assert "75 % (69 to 80) of its rows are of the course" in warnings[1]
    warnings = warnings_of(Submission("ada", file), driver, None, roads, course)
    assert "rows are of the course is unknown" in warnings[0]
    unknown = driver.model_copy(update={"data": ""})
    (line,) = warnings_of(Submission("ben", tmp_path / "ben.onnx"), unknown, None, roads, course)
    assert "tells nothing of its training" in line


def test_an_export_is_the_same_network(tmp_path: Path) -> None:
    files = [write_pilotnet(tmp_path / f"{seed}.ckpt", seed) for seed in (0, 1)]
    files.append(tmp_path / "exported.onnx")
    files[2].write_bytes(onnx_bytes(load_checkpoint(files[0])))
    facts = []
    for file in files:
        write_facts(file, tmp_path / "facts.json")
        facts.append(read_facts(tmp_path / "facts.json"))
    assert len(facts[0].outputs) == IMAGES
    assert [facts[0].equals(other) for other in facts] == [True, False, True]


def test_a_wrong_folder_gets_one_line(tmp_path: Path) -> None:
    assert "cannot be read" in refusal(find_submissions, tmp_path / "class")
    (tmp_path / "notes.txt").touch()
    assert "holds no .ckpt or .onnx file" in refusal(find_submissions, tmp_path)


@pytest.mark.skipif(sys.platform == "win32", reason="links need a right there")
def test_the_output_folder_among_the_submissions_is_no_student(here: Path) -> None:
    for name in ("ann", "marked"):
        write_constant(here / "class" / name / "net.ckpt", 0.0)
    (here / "class" / "loop").symlink_to("loop")
    for out, names in (
        (None, ["ann", "loop", "marked"]),
        (Path("class/../class/marked"), ["ann", "loop"]),
    ):
        assert [entry.name for entry in find_submissions(Path("class"), out)] == names


def test_a_file_of_another_kind_has_the_time_of_its_last_change(tmp_path: Path) -> None:
    file = tmp_path / "dora.h5"
    file.touch()
    os.utime(file, (86_400, time.mktime((2026, 5, 4, 3, 2, 0, 0, 0, -1))))
    (tmp_path / "eve").mkdir()
    dora, eve = find_submissions(tmp_path)
    assert (dora.submitted, eve.submitted) == ("2026-05-04 03:02", "-")
    assert "dora.h5: is or has no .ckpt or .onnx file" in dora.problem


def test_more_roads_need_a_seed_and_a_suite_needs_marks(submitted: Path, here: Path) -> None:
    with pytest.raises(UsageError, match="name seed=NUMBER"):
        grade(submitted, roads=3)
    assert "has no marks" in refusal(grade, submitted, suite="quick")


NAMES = {
    "245 characters": "n" * 245,
    "formula": '=HYPERLINK("a","b")',
    "control characters": "a\x1b[2J\r\nb",
    "not UTF-8": "k\udce4the",
    "blanks and quotes": "Ann O'Neil (2)",
    "shell": "$(touch x);`y`",
}


def hand_in(folder: Path) -> None:
    """Write the submissions of a class, each of which is odd in another way."""
    write_constant(folder / "a good one.ckpt", 0.0)
    for name in NAMES.values():
        write_constant(folder / name / "net.ckpt", 0.0)
    (folder / "dangling.ckpt").symlink_to("nowhere.ckpt")
    (folder / "dangling").symlink_to("nowhere")
    (folder / "linked").symlink_to("apple")
    (folder / "the teacher's.ckpt").symlink_to("a good one.ckpt")
    for name, card in (("latin", "Gr\xf6\xdfe".encode("cp1252")), ("large", b"x" * 1_000_001)):
        write_constant(folder / name / "net.ckpt", 0.0)
        (folder / name / "README.md").write_bytes(card)
    (folder / "folder.ckpt").mkdir()
    write_constant(folder / "twice.ckpt", 0.0)
    write_constant(folder / "twice" / "net.ckpt", 0.0)
    write_constant(folder / "apple" / "net.CKPT", 0.0)
    (folder / "apple" / "._net.CKPT").write_bytes(b"a Mac's")
    (folder / "notes.txt").touch()
    (folder / "Thumbs.db").touch()
    (folder / "__MACOSX").mkdir()
    (folder / "4_dora.h5").touch()
    (folder / "a good one.zip").touch()


def grade_class(folder: Path, suite: Path, *names: str) -> graded.Graded:
    """Add networks of these names, which steer straight on, to a class and grade it."""
    for name in names:
        write_constant(folder / "class" / f"{name}.ckpt", 0.0)
    return grade(folder / "class", suite=str(suite), seed=5, out=folder / "out")


@pytest.fixture
def as_ada(marked: graded.Graded, monkeypatch: pytest.MonkeyPatch) -> None:
    """Copy a student's drives in place of driving."""
    (source,) = (path for path in (marked.folder / graded.DRIVES).glob("ada-*") if path.is_dir())

    def copy(folder: Path, submission: Submission, *_: object) -> None:
        shutil.copytree(source, folder)
        write_facts(submission.file, facts_file(folder))

    monkeypatch.setattr(graded, "_drive", copy)


@pytest.mark.usefixtures("as_ada")
@pytest.mark.skipif(sys.platform != "linux", reason="names that other systems refuse")
def test_no_student_ends_the_class(suite: Path, here: Path, capsys: pytest.CaptureFixture) -> None:
    hand_in(here / "class")
    result = grade_class(here, suite)
    result.show()
    status = {student.submission.name: student.status for student in result.grades}
    broken = ["4_dora", "dangling", "folder.ckpt", "linked", "the teacher's", "twice"]
    assert status == {
        **dict.fromkeys([*NAMES.values(), "a good one", "latin", "large", "apple"], "passed"),
        **dict.fromkeys(broken, "not driven"),
    }
    assert len([*(here / "out" / graded.PAGES).iterdir()]) == len(status)
    lines = {student.submission.name: " ".join(student.warnings) for student in result.grades}
    for name, words in (
        ("dangling", "two submissions"),
        ("twice", "two submissions"),
        ("4_dora", "4_dora.h5: is or has no .ckpt or .onnx file"),
        ("folder.ckpt", "no .ckpt or .onnx file"),
        ("latin", "not UTF-8"),
        ("large", "1,000,001 bytes"),
    ):
        assert words in lines[name]
    written = (here / "out" / "grades.csv").read_text()
    assert "\n\"'=HYPERLINK" in written
    assert len(written.splitlines()) == 1 + len(status)
    assert "\x1b" not in capsys.readouterr().out


@pytest.mark.usefixtures("as_ada")
@pytest.mark.parametrize("part", ["_drive", "warnings_of", "_write_page", "read_facts"])
def test_an_unexpected_error_is_one_students_alone(
    part: str, suite: Path, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_constant(here / "class" / "ben.ckpt", 0.1)
    usual = getattr(graded, part)

    def fail_for_ann(*arguments: object) -> object:
        if any("ann" in str(argument) for argument in arguments):
            raise RuntimeError("something odd")
        return usual(*arguments)

    monkeypatch.setattr(graded, part, fail_for_ann)
    ann, ben = grade_class(here, suite, "ann").grades
    assert "RuntimeError: something odd" in " ".join(ann.warnings)
    assert (ann.status, ben.status) == ("not driven" if part == "_drive" else "passed", "passed")
    assert "something odd" in (here / "out" / "grades.html").read_text()


@pytest.mark.usefixtures("as_ada")
def test_nan_gets_no_points(suite: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy = graded._drive

    def steer_nan(folder: Path, *rest: object) -> None:
        copy(folder, *rest)
        result = read_result(folder)
        result.drives[0].figures["nan_frames"] = 1
        write_result(folder, result)

    monkeypatch.setattr(graded, "_drive", steer_nan)
    marks = grade_class(here, suite, "ann")
    assert (marks.grades[0].status, marks.points) == ("not driven", [None])
    assert "steered NaN in 1 frame:" in marks.lines[0]


@pytest.mark.usefixtures("as_ada")
def test_a_number_that_stands_twice_is_reported(suite: Path, here: Path) -> None:
    marks = grade_class(here, suite, "7_ann", "7_ben", "71_cleo", "dan", "eve")
    assert [line for line in marks.lines if "number" in line] == [
        "7_ann: has the number 7, as 7_ben; keep one",
        "7_ben: has the number 7, as 7_ann; keep one",
    ]


@pytest.mark.usefixtures("as_ada")
def test_pages_name_the_last_file(suite: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy = graded._drive

    def drive(folder: Path, submission: Submission, *rest: object) -> None:
        copy(folder, submission, *rest)  # the drives are the same whatever the file's epoch
        result = read_result(folder)
        sha256 = hash_file(submission.file)
        drivers = [result.checkpoints[0].model_copy(update={"sha256": sha256})]
        write_result(folder, result.model_copy(update={"checkpoints": drivers}))

    monkeypatch.setattr(graded, "_drive", drive)
    for epoch in (0, 1):
        path = write_constant(here / "class" / "ann.ckpt", 0.0, epoch)
        grade_class(here, suite)
        assert hash_file(path) in (here / "out" / graded.PAGES / "ann.html").read_text()


@pytest.mark.usefixtures("as_ada")
def test_marks_are_written_after_each(
    suite: Path, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    copy, seen = graded._drive, []

    def look(*arguments: object) -> None:
        path = here / "out" / "grades.csv"
        seen.append(path.read_text().count("waiting") if path.is_file() else 3)
        copy(*arguments)

    monkeypatch.setattr(graded, "_drive", look)
    monkeypatch.setattr(console_progress, "LINE_EVERY_S", 0.0)
    grade_class(here, suite, "ann", "ben", "cleo")
    assert seen[0] == 3 > seen[-1]
    assert re.search(r"grading: 33% after \d+ s, \d+ s left", capsys.readouterr().out)
    assert "waiting" not in (here / "out" / "grades.csv").read_text()


def changed_copy(source: Path, path: Path, change: Callable[[dict], None]) -> Path:
    contents = torch.load(source, weights_only=True)
    change(contents)
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.save(contents, path)
    return path


def add_to_a_bias(contents: dict) -> None:
    contents["state_dict"]["network.head.6.bias"] += 0.001


def add_noise(contents: dict) -> None:
    torch.manual_seed(0)
    for tensor in contents["state_dict"].values():
        tensor += 0.01 * tensor.std(correction=0) * torch.randn_like(tensor)


def strip(contents: dict) -> None:
    contents["drivezoo"]["data"] = {}
    contents["drivezoo"]["config"] = {"model": contents["drivezoo"]["config"]["model"]}


def test_copies_and_packaged_networks_are_said(suite: Path, here: Path, as_ada: None) -> None:
    lenet = PACKAGED / "lenet.ckpt"
    folder = here / "class"
    folder.mkdir()
    shutil.copy(lenet, folder / "ann.ckpt")
    changed_copy(lenet, folder / "ben.ckpt", add_to_a_bias)
    changed_copy(lenet, folder / "cleo.ckpt", add_noise)
    changed_copy(PACKAGED / "pilotnet.ckpt", folder / "dan.ckpt", strip)
    write_pilotnet(folder / "eve.ckpt", 1)
    write_pilotnet(folder / "finn.ckpt", 2)
    grades = grade_class(here, suite).grades
    warnings = {student.submission.name: " ".join(student.warnings) for student in grades}
    assert "is the same network as lenet, which comes with drivezoo" in warnings["ann"]
    for name in ("ben", "cleo"):
        assert "is nearly the same network as lenet, which comes" in warnings[name]
        assert "is nearly the same network as ann" in warnings[name]
    assert "is the same network as pilotnet, which comes" in warnings["dan"]
    for name in ("eve", "finn"):
        assert "same network" not in warnings[name]
    for name in ("dan", "eve"):
        assert "tells nothing of its training" in warnings[name]
    assert "tells nothing" not in warnings["ann"]


def test_the_roads_of_a_config_are_those_of_the_training(tmp_path: Path) -> None:
    facts = network_facts(PACKAGED / "lenet.ckpt")
    assert road_key("lakeside:103") in facts.roads
    submission = Submission("ann", tmp_path / "ann.ckpt")
    roads = {road_key("lakeside:103"): "lakeside:103"}
    (line,) = warnings_of(submission, DRIVER, facts, roads, None)
    assert "trained on lakeside:103" in line


@pytest.mark.parametrize(
    "config", [{}, {"data": None}, {"data": {"record": 3}}, {"data": {"record": {"passes": 3}}}]
)
def test_a_config_without_a_recipe_tells_no_roads(config: dict) -> None:
    assert trained_roads(config, {}) is None


def test_it_needs_onnxruntime(submitted: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(submitted, here / "class")
    (here / "class" / "gus.onnx").touch()
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    line = only_line(run_here(here, "class", "out=out", module="zoo.extras.teaching.grade"), 2)
    assert "gus.onnx: onnxruntime" in line
    assert "pip install" in line
    assert not (here / "out").exists()
