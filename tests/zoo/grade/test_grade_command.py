"""`drivezoo grade`: marks of a class on drawn roads, warnings and pages."""

import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import yaml

from datamodules.recording import make_recording
from tests.zoo.benchmark.test_benchmark_command import write_family, write_suite
from tests.zoo.written_checkpoints import write_constant, write_pilotnet
from zoo.base.errors import InputError, UsageError
from zoo.benchmark.__main__ import benchmark
from zoo.benchmark.result import NAME, Driver
from zoo.benchmark.suite import _redrawn, read_suite, redraw_suite
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.grade import graded
from zoo.grade.__main__ import grade
from zoo.grade.submissions import Submission, find_submissions, warnings_of
from zoo.grade.submitted_network import (
    IMAGES,
    NetworkFacts,
    facts_file,
    read_facts,
    write_facts,
)
from zoo.training.recorded_roads import road_key


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


def drive_here(folder: Path, submission: Submission, suite: Path, minutes: float) -> None:
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
    status = {one.submission.name: one.status for one in marked.grades}
    expected = {"ada": "passed", "ben": "missed", "dora": "passed"}
    assert status == expected | dict.fromkeys(["eve", "finn"], "not driven")
    lines = {line.partition(":")[0]: line for line in marked.lines}
    assert "same network as dora" in lines["ada"]
    assert "not a torch file" in lines["eve"]
    assert "no .ckpt or .onnx file" in lines["finn"]
    pages = {one.stem: one.read_text() for one in (marked.folder / graded.PAGES).iterdir()}
    assert pages.keys() == expected.keys()
    assert "Not passed" in pages["ben"]
    assert "data:video/mp4;base64," in pages["ben"]
    assert "<video" not in pages["ada"]
    rows = {row["student"]: row for row in marked.table()}
    assert rows["ben"]["like_autonomy"] < 0.9 <= rows["ada"]["like_autonomy"]


def test_no_page_of_a_student_names_a_drawn_road(marked: graded.Graded, suite: Path) -> None:
    drawn = {one.track for one in read_suite(str(marked.folder / graded.SUITE)).drives}
    assert not drawn & {one.track for one in read_suite(str(suite)).drives}
    for page in (marked.folder / graded.PAGES).iterdir():
        assert not any(track.rpartition(":")[2] in page.read_text() for track in drawn)


def test_it_resumes_without_driving_again(
    marked: graded.Graded, submitted: Path, suite: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driven = []
    monkeypatch.setattr(graded, "_drive", lambda folder, *_: driven.append(folder.name))
    with pytest.raises(InputError, match="other roads were begun"):
        grade(submitted, suite=str(suite), seed=6, out=marked.folder)
    again = grade(submitted, suite=str(suite), seed=5, out=marked.folder)
    assert [name[:4] for name in driven] == ["eve-"]
    assert again.grades[0].result == marked.grades[0].result


def test_a_submission_has_a_process_and_a_time_of_its_own(submitted: Path, tmp_path: Path) -> None:
    one = Submission("eve.1", submitted / "eve.ckpt")
    with pytest.raises(InputError, match="not driven within"):
        graded._drive(tmp_path / "drives" / "eve.1-0", one, tmp_path / "suite.yaml", 1e-5)
    assert [file.name for file in (tmp_path / "drives").glob("*.txt")] == ["eve.1-0.txt"]


def test_a_process_that_dies_is_named_by_its_last_line(
    submitted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = "import sys; print('Segmentation fault'); sys.exit(139)"

    def start(*_: str, **output: object) -> subprocess.Popen:
        return subprocess.Popen([sys.executable, "-c", program], **output)

    monkeypatch.setattr(graded, "start_module", start)
    one = Submission("eve", submitted / "eve.ckpt")
    with pytest.raises(InputError, match="Segmentation fault"):
        graded._drive(tmp_path / "drives" / "eve-0", one, tmp_path / "suite.yaml", 1.0)


def test_roads_are_drawn_by_the_seed_and_keep_their_families() -> None:
    def tracks(seed: int | None, roads: int = 1) -> dict[str, list[str]]:
        groups = yaml.safe_load(redraw_suite("course", seed, roads))["groups"]
        return {name: [one["track"] for one in drives] for name, drives in groups.items()}

    assert _redrawn("a/own.yaml:3", 7, 1)[0][2:] == _redrawn("b/own.yaml:3", 7, 1)[0][2:]
    own, drawn = tracks(None), tracks(7, roads=2)
    assert drawn == tracks(7, roads=2) != tracks(8, roads=2)
    for group, roads in own.items():
        families = [road.partition(":")[0] for road in roads for _ in range(2)]
        assert [road.partition(":")[0] for road in drawn[group]] == families
        assert not set(roads) & set(drawn[group])


def test_cards_and_trainings_are_compared_with_the_file(tmp_path: Path) -> None:
    file = write_constant(tmp_path / "ada" / "net.ckpt", 0.0)
    file.with_name("README.md").write_text("Network: 41 parameters; with fingerprint abc.")
    known = {"file": str(file), "sha256": "0", "model": "Linear", "training_seed": 1}
    driver = Driver(**known, parameters=41, data="def")
    course = make_recording(tmp_path, {"steering": np.linspace(0, 1, 400)}, {})
    facts = NetworkFacts(outputs=[], row_hashes=[*course.row_hashes()[:192], *range(64)])
    facts = facts.model_copy(update={"roads": [road_key("alpine:9"), "udacity_lake"]})
    roads = {road_key(track): track for track in ("alpine:9", "alpine:8")}
    found = warnings_of(Submission("ada", file), driver, facts, roads, course)
    assert [line.split(",")[0] for line in found] == [
        "trained on alpine:9",
        "trained on def",
        "README.md states with fingerprint abc",
    ]
    assert "75 % (69 to 80) of its rows are of the course" in found[1]
    found = warnings_of(Submission("ada", file), driver, None, roads, course)
    assert "rows are of the course is unknown" in found[0]


def test_an_export_is_the_same_network(tmp_path: Path) -> None:
    files = [write_pilotnet(tmp_path / f"{seed}.ckpt", seed) for seed in (0, 1)]
    files.append(tmp_path / "exported.onnx")
    files[2].write_bytes(onnx_bytes(load_checkpoint(files[0])))
    facts = []
    for file in files:
        write_facts(file, tmp_path / "facts.json")
        facts.append(read_facts(tmp_path / "facts.json"))
    assert len(facts[0].outputs) == IMAGES
    assert [facts[0].equals(one) for one in facts] == [True, False, True]


@pytest.mark.parametrize(
    ("names", "reason"),
    [
        (["notes.txt"], "holds no .ckpt or .onnx file"),
        (["ada.ckpt", "ada/net.ckpt"], "ada stands for two submissions"),
        (None, "cannot be read"),
    ],
)
def test_a_wrong_folder_gets_one_line(names: list[str] | None, reason: str, here: Path) -> None:
    folder = here / "class"
    for name in names or []:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    with pytest.raises(InputError, match=reason):
        find_submissions(folder)


def test_more_roads_need_a_seed_and_a_suite_needs_marks(submitted: Path, here: Path) -> None:
    with pytest.raises(UsageError, match="name seed=NUMBER"):
        grade(submitted, roads=3)
    with pytest.raises(InputError, match="has no marks"):
        grade(submitted, suite="quick")
