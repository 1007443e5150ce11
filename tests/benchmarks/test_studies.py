"""The studies of `benchmarks/studies`: their grids, rows and pages."""

import csv
import itertools
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest

from benchmarks import board_rows, study, study_data, study_grid, study_rows
from benchmarks.measuring import merge, read_csv, write_csv
from benchmarks.study_grid import FOLDER, Entry, Study
from tests.recordings import Written
from tests.refusals import refusal
from tests.zoo.command_runs import ROOT, environment
from tests.zoo.results.synthetic_results import of_levels, summed, write
from zoo.base.compose import refuse_repeated
from zoo.base.errors import InputError
from zoo.base.plain_files import read_json
from zoo.checkpoints.checkpoint import load_checkpoint, read_checkpoint_file
from zoo.checkpoints.checkpoint_path import PACKAGED, packaged_names, read_facts
from zoo.results.benchmark_options import BASELINES
from zoo.results.checked_result import read_result

FINGERPRINT = "d799b34fbcd58066"
LEVELS = [  # roads of the board
    (axis, f"bends_{level}:{number}", {})
    for axis in ("geometry", "dynamics", "visibility", "camera")
    for level in (1, 2, 3)
    for number in range(8)
]
CLAIM = {"recipe": "C", "data": "expert", "training": "published", "weights": "", "seed": "1"}
CLAIM |= {"track": "udacity_lake", "control": "throttle 0.2", "frame_rate": "15.0"}
CLAIM |= {"direction": "forward", "autonomy": "0.9"}
CLEAN = CLAIM | {"seed": "2", "autonomy": "1.0"}


@pytest.fixture
def pages(here: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with copies of the manual's pages, which is the current folder.

    The results of these tests have not all roads of the suite that they name.
    """
    monkeypatch.setattr("zoo.results.checked_result._of_included_suite", lambda made, _: made)
    left_out = shutil.ignore_patterns("_build", "*.csv", "*.png", "images", "api")
    shutil.copytree(ROOT / "docs", "docs", ignore=left_out)
    return here


@pytest.fixture(autouse=True)
def clean(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the checkout be as its commit, whatever a developer has changed."""
    monkeypatch.setattr(study, "changed_files", lambda _: [])


@pytest.mark.parametrize(  # these have no committed figures
    "name", sorted({path.stem for path in FOLDER.glob("*.yaml")} - {"lengths"})
)
def test_the_committed_pages_are_those_of_the_committed_figures(
    name: str, pages: Path, capsys: pytest.CaptureFixture
) -> None:
    for path in (ROOT / "docs").glob("*.csv"):
        shutil.copy(path, "docs")
    shutil.copytree(ROOT / board_rows.BOARD, board_rows.BOARD)
    study.main([name, "runs=false"])
    written = capsys.readouterr().out.strip().split(", ")
    assert len(written) > 1 or name == "pretrained"
    for path in map(Path, written):
        assert path.is_file()
        if path.suffix != ".png":
            assert path.read_text() == (ROOT / path).read_text(), f"{path}: run study.py {name}"


def test_pages_name_the_commit_of_a_study_that_is_gone() -> None:
    gone = []
    for page in (ROOT / "docs").rglob("*.md"):
        for before, text in itertools.pairwise(["", *page.read_text().split("\n\n")]):
            for words in re.findall(r"benchmarks/study\.py ([^`\n]*)", text):
                if "commit" in before + text:
                    continue
                name, *given = words.split()
                try:
                    Study(name, [word for word in given if not word.startswith("add=")]).chosen()
                except InputError as error:
                    gone.append(f"{page.name}: {words}: {error}")
    assert not gone


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "available: board"),
        (["bord"], "bord: no such study; available: board"),
        (["board", "only=lennet"], "lennet"),
        (["board", "sedes=2"], "sedes"),
        (["claims", "seeds=many"], "seeds=many"),
        (["first_try", "only=lenet-real"], "lenet-real"),
    ],
)
def test_a_wrong_option_is_named(arguments: list[str], message: str) -> None:
    assert message in refusal(study.main, arguments)


@pytest.mark.parametrize(
    ("changed", "arguments", "message"),
    [
        ("zoo/policy.py", [], "zoo/policy.py: differs from the commit"),
        ("docs/claims.csv", [], "docs/claims.csv: differs from the commit"),
        ("zoo/policy.py", ["quick=true"], "no entry Z"),
        ("zoo/policy.py", ["drive=false"], "no entry Z"),
    ],
)
def test_figures_are_measured_from_a_commit(
    changed: str, arguments: list[str], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study, "changed_files", lambda _: [changed])
    monkeypatch.setattr(Study, "chosen", lambda _: (_ for _ in ()).throw(InputError("no entry Z")))
    assert message in refusal(study.main, ["claims", *arguments])


def test_rows_of_two_versions_make_no_table(pages: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = Study("claims", [])
    for row, code in ((CLAIM, "aaaa"), (CLEAN, "bbbb")):
        monkeypatch.setattr(study, "code_fingerprint", lambda code=code: {"hash": code})
        study.add_rows(opened, [row])
    with pytest.raises(InputError, match=r"claims\.csv: .*2 versions of the code \(aaaa, bbbb\)"):
        study.write_results(opened)


def test_a_run_of_other_code_is_not_driven(tmp_path: Path) -> None:
    entry = Entry("lenet", {}, ("model=lenet",), tmp_path, 1)
    trained(entry.runs[0])
    study.check_code(entry)  # an older run, which does not name its code
    trained(entry.runs[0], {"version": 1, "code": {"hash": "aaaa"}})
    assert "was trained by other code (aaaa, here " in refusal(study.check_code, entry)
    changed = {"hash": study.code_fingerprint()["hash"], "changed": ["docs/claims.csv"]}
    trained(entry.runs[0], {"version": 1, "code": changed})
    assert "while docs/claims.csv differed from the commit" in refusal(study.check_code, entry)
    study.check_code(entry, quick=True)


# The grid


def test_an_entry_of_the_board_has_its_seeds_and_is_trained_on_the_closed_track_alone() -> None:
    entries = {entry.name: entry for entry in Study("board", []).entries()}
    assert set(BASELINES) <= set(entries)
    assert {entry.seeds for entry in entries.values() if entry.words} == {5, 10}
    closed = [entry for entry in entries.values() if entry.words and not entry.corrects]
    assert all("data=bench_v1" in entry.words for entry in closed)
    assert entries["linear"].words[-1] == "data.crop=[60,40]"


@pytest.mark.parametrize("name", sorted(path.stem for path in FOLDER.glob("*.yaml")))
def test_no_entry_gives_a_key_twice(name: str) -> None:
    opened = Study(name, [])
    opened.values["root"] = "recording"
    for entry in opened.entries():
        refuse_repeated(opened.command(entry, "train"))


def test_a_name_means_its_variants_too() -> None:
    chosen = Study("board", ["only=lenet-bends,pilotnet", "quick=true"]).chosen()
    names = ["lenet-bends", "pilotnet", "pilotnet-bends", "pilotnet-narrow", "pilotnet-dagger"]
    assert [entry.name for entry in chosen] == names
    assert chosen[1].folder == Path("outputs/board/pilotnet-quick")


@pytest.mark.parametrize("name", packaged_names())
def test_a_packaged_network_names_a_commit_that_has_its_code(name: str) -> None:
    facts = read_facts(name)
    assert re.fullmatch(r"[0-9a-f]{12}", facts["code"]["commit"]), "trained beside changed files"
    assert "changed" not in facts["code"]
    assert "trainer.precision=32-true" in facts["command"], "repeats on any processor"


def test_a_packaged_network_has_a_recipe_of_the_results() -> None:
    results = {entry.name: entry.words for entry in Study("results", []).entries()}
    packaged = {entry.name: entry.words for entry in Study("pretrained", []).entries()}
    assert packaged["tiny41"] == (*results["tiny-no_bonnet"], "data=bench_v1")


@pytest.mark.usefixtures("here")
def test_a_corrected_entry_starts_from_committed_networks(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[list[str]] = []

    def run_logged(log: Path, words: list[str], threads: int) -> None:
        asked.append(words)
        rounds = [{"checkpoint": f"round-{number}.ckpt"} for number in range(4)]
        log.with_suffix("").mkdir(parents=True)
        (log.with_suffix("") / "correct.json").write_text(json.dumps({"rounds": rounds}))
        study_grid.seconds_file(log).write_text("{}")

    monkeypatch.setattr(study_grid, "run_logged", run_logged)
    opened = Study("board", ["only=pilotnet-dagger", "seeds=2"])
    opened.values["root"] = "bench_v1"
    (entry,) = opened.chosen()
    assert entry.finished == []
    for run in [*entry.runs, *entry.runs]:
        opened.train(entry, run)
    assert entry.finished == entry.runs
    assert entry.checkpoint(entry.runs[1]) == Path("round-3.ckpt")
    assert [words[1:3] for words in asked] == [
        ["correct", f"benchmarks/board/pilotnet/{seed}.ckpt"] for seed in (1, 2)
    ]
    assert asked[0][-1] == f"out={entry.runs[0]}"
    families = re.findall(r"(\w+):", entry.words[0])
    assert set(families) == {"lakeside", "country"}, "no road of the suite's families"


def trained(run: Path, metrics: dict | None = None) -> None:
    (run / "metrics.json").parent.mkdir(parents=True, exist_ok=True)
    (run / "metrics.json").write_text(json.dumps(metrics or {"version": 1}))


def test_a_finished_run_is_not_repeated_and_a_failed_entry_not_the_last(
    pages: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    asked, failing, table = [], ["0.3-mouse"], Path("docs/first_try.csv")
    committed = Path("kept/result.json")

    def run_logged(log: Path, words: list[str], threads: int) -> None:
        assert not table.exists(), "a committed file would make the next entries' commit unclean"
        assert not committed.exists()
        asked.append(words)
        if any(name in str(log) for name in failing):
            raise InputError(f"{log}: failed")
        trained(log.parent)

    def row(opened: Study, entry: Entry) -> list[dict]:
        opened.files[committed] = "{}"
        drive = {"track": "lake", "direction": "forward", "quality": "full", "control": "hold"}
        figures = {"autonomy": 0.9, "interventions": 1, "driven_m": 900, "cte_max_m": 2}
        return [{**entry.labels, "seed": run.name, **drive, **figures} for run in entry.finished]

    monkeypatch.setitem(study_data.PREPARE, "student_laps", lambda _: {})
    monkeypatch.setitem(study_rows.ROWS, "drives", row)
    monkeypatch.setattr(study_grid, "run_logged", run_logged)
    words = ["first_try", "seeds=1"]
    assert "failed: 0.3-mouse; the same command resumes" in refusal(study.main, words)
    assert len(asked) == 4
    assert {"experiment=first_try", "seed=1"} <= set(asked[0])
    assert not table.exists()
    failing.clear()
    study.main([*words, "quick=true"])
    assert "'autonomy': 0.9" in capsys.readouterr().out
    assert (table.exists(), committed.exists()) == (False, False), "figures of short trainings"
    study.main(words)
    assert (len(asked), len(read_csv(table))) == (4 + 4 + 1, 4)
    assert committed.read_text() == "{}"


@pytest.mark.usefixtures("here")
def test_a_stopped_training_is_resumed(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(study_grid, "run_logged", lambda log, words, threads: asked.append(words))
    opened = Study("claims", ["only=C"])
    (entry,) = opened.chosen()
    config = entry.runs[0] / ".hydra" / "config.yaml"
    config.parent.mkdir(parents=True)
    config.touch()
    opened.train(entry, entry.runs[0])
    assert asked == [["zoo", f"resume={entry.runs[0]}"]]


def test_a_command_that_fails_is_named_with_its_last_line(tmp_path: Path) -> None:
    words = ["zoo.commands.simulator", "record", "trak=lake"]
    with pytest.raises(InputError, match=r"trak: no such key.*log\.txt"):
        study_grid.run_logged(tmp_path / "log.txt", words, 1)


SERVE = """
from pathlib import Path
from benchmarks.study_grid import run_logged
run_logged(Path("log.txt"), ["zoo.commands.simulator", "drive", "port=0"], 1)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="sends POSIX signals")
def test_a_command_ends_with_a_study_that_is_killed(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", SERVE], cwd=tmp_path, env=environment()) as parent:
        process = psutil.Process(parent.pid)
        while not (commands := process.children()):
            assert parent.poll() is None
        while not (tmp_path / "log.txt").read_text():
            assert parent.poll() is None
        parent.kill()
    assert psutil.wait_procs(commands, timeout=60)[1] == []


# The rows


def test_rows_are_kept_as_text_and_newer_ones_replace_older(tmp_path: Path) -> None:
    path = tmp_path / "docs" / "claims.csv"
    write_csv(path, [CLAIM, CLEAN])
    newer = CLAIM | {"seed": 1, "frame_rate": 15.0, "autonomy": 0.7}
    merged = merge(read_csv(path), [newer, CLAIM | {"seed": 3}], Study("claims", []).config["key"])
    autonomy = {str(row["seed"]): row["autonomy"] for row in merged}
    assert [*autonomy.items()] == [("1", 0.7), ("2", "1.0"), ("3", "0.9")]


def write_entry(folder: Path, clean: float = 0.9, seeds: int = 3, **changes: object) -> Path:
    """Write an entry's folder: a result with a share of clean drives, command and checkpoints."""
    drawn = np.random.default_rng(1).random((seeds, len(LEVELS)))
    content = of_levels(np.where(drawn < clean, 1.0, 0.5), folder.name, LEVELS)
    for checkpoint in content["checkpoints"]:
        checkpoint["data"] = FINGERPRINT
    write(folder, summed(content | {"suite": "v3"}) | changes)
    (folder / board_rows.COMMAND).write_text("drivezoo train experiment=lenet data=bench_v1\n")
    for seed in range(seeds):
        (folder / f"{seed}.ckpt").write_text("weights")
    return folder


def add_entry(folder: Path) -> None:
    command = (folder / board_rows.COMMAND).read_text().strip()
    study_grid.write_files(board_rows.kept_result(folder, command, sorted(folder.glob("*.ckpt"))))


def test_an_entry_stands_in_all_files_of_the_board(pages: Path) -> None:
    add_entry(write_entry(pages / "mine"))
    study.main(["board", "runs=false"])
    assert re.search(r"\| 1 \| `mine` \| 3 \| \d+ of 288 \(", Path("docs/benchmark.md").read_text())
    row = read_csv(Path("docs/benchmark.csv"))[0]
    assert row["group"] == "all but laps"
    assert row["command"] == "drivezoo train experiment=lenet data=bench_v1"
    assert {path.name for path in (board_rows.BOARD / "mine").glob("*")} == {
        *("result.json", "command.txt", "0.ckpt", "1.ckpt", "2.ckpt")
    }


def test_the_most_clean_drives_stand_first_and_ties_share_a_rank(pages: Path) -> None:
    for name, clean in (("a_worst", 0.2), ("tied", 0.9), ("alike", 0.89)):
        add_entry(write_entry(pages / name, clean))
    rows = board_rows.rows_of_board()
    ranks = [("tied", "1 to 2"), ("alike", "1 to 2"), ("a_worst", "3")]
    assert list(dict.fromkeys((row["entry"], row["rank"]) for row in rows)) == ranks


def test_entries_that_no_training_or_an_expert_made_have_no_rank(pages: Path) -> None:
    for name in ("ranked", "corrected"):
        add_entry(write_entry(pages / name, 0.5))
    add_entry(write_entry(pages / "alone", 0.9, seeds=1))
    (board_rows.BOARD / "corrected" / board_rows.COMMAND).write_text("drivezoo correct CKPT\n")
    expert = read_json(write_entry(pages / "expert", 1.0, seeds=1) / "result.json")
    expert["checkpoints"][0]["sha256"] = None
    write(pages / "known", expert)
    study_grid.write_files(board_rows.kept_result(pages / "known", "", []))
    assert {row["entry"]: (row["kind"], row["rank"]) for row in board_rows.rows_of_board()} == {
        "ranked": ("ranked", "1"),
        "corrected": ("interactive", ""),
        "alone": ("one training seed", ""),
        "expert": ("baseline", ""),
    }


def test_results_of_two_versions_of_the_code_make_no_board(pages: Path) -> None:
    add_entry(write_entry(pages / "old", code={"hash": "aaaa"}))
    add_entry(write_entry(pages / "new"))
    assert "new and old were driven by different code" in refusal(board_rows.rows_of_board)


def test_a_kept_result_has_every_drive_and_its_digest_but_no_folder(pages: Path) -> None:
    folder = write_entry(pages / "mine")
    content = read_json(folder / "result.json")
    for driver in content["checkpoints"]:
        driver["file"] = str(folder / driver["file"])
    (folder / "result.json").write_text(json.dumps(content))
    add_entry(folder)
    stored, given = (read_result(path) for path in (board_rows.BOARD / "mine", folder))
    assert (stored.digest, stored.groups) == (given.digest, given.groups)
    assert len(stored.drives) == 3 * len(LEVELS)
    assert [driver.file for driver in stored.checkpoints] == ["0.ckpt", "1.ckpt", "2.ckpt"]


def test_what_drives_has_weights_in_16_bits(tmp_path: Path) -> None:
    entry = Entry("tiny41", {}, ("model=tiny",), tmp_path, 1)
    run = entry.runs[0]
    (run / "checkpoints").mkdir(parents=True)
    shutil.copy(PACKAGED / "tiny41.ckpt", run / study_grid.CHECKPOINT)
    path = board_rows.driven_checkpoint(entry, run)
    assert path == tmp_path / "1.ckpt"
    state = read_checkpoint_file(path)["state_dict"]
    assert {str(tensor.dtype) for tensor in state.values()} == {"torch.float16"}
    weights = load_checkpoint(path).network.state_dict().values()
    assert {str(tensor.dtype) for tensor in weights} == {"torch.float32"}


def test_an_entry_trained_on_other_rows_is_refused(pages: Path) -> None:
    folder = write_entry(pages / "entry")
    path = folder / "result.json"
    path.write_text(path.read_text().replace(FINGERPRINT, "0" * 16))
    with pytest.raises(InputError, match=r"0{16}.*data=bench_v1"):
        add_entry(folder)


@pytest.mark.parametrize(
    ("changes", "message"),
    [({}, r"card\.md"), ({"entry": "a | <b>"}, "letters"), ({"suite": "v1-quick"}, "quick")],
)
def test_an_incomplete_submission_is_refused(changes: dict, message: str, pages: Path) -> None:
    """A name stands in Markdown; an entry of another suite is no line of the board."""
    with pytest.raises(InputError, match=message):
        study.main(["board", f"add={write_entry(pages / 'entry', **changes)}"])
    assert not board_rows.BOARD.exists()


# The pages


def test_a_page_without_markers_is_named(pages: Path) -> None:
    shutil.copy(ROOT / "docs" / "results.csv", "docs")
    Path("docs/recipes.md").write_text("no markers\n")
    with pytest.raises(SystemExit, match=r"docs/recipes\.md: .*<!-- results -->.*; add"):
        study.main(["results", "runs=false"])


# A training of its own


@pytest.mark.slow
def test_a_candidate_of_the_first_try_is_trained_and_driven(
    recorded: Written, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A developer's files may differ from the commit.
    monkeypatch.setattr(study, "check_code", lambda *_: None)
    opened = Study("first_try", [f"real={recorded.folder}", "only=1-real", "seeds=1"])
    small = ("model=tiny", "trainer.max_epochs=1", "data.samples_per_epoch=64", "score.laps=0.01")
    drive = {"control": "hold 15 mph", "track": "lake", "direction": "forward", "quality": "fast"}
    axes = {key: [value] for key, value in (drive | {"laps": 0.01}).items()}
    opened.config["drives"] = [{"axes": axes}]
    (entry,) = opened.chosen()
    words = (*small, "data.block_s=0.5", "data.gap_s=0.1", f"data.root={recorded.folder}")
    monkeypatch.setattr(Study, "chosen", lambda _: [Entry(**vars(entry) | {"words": words})])
    monkeypatch.setitem(study_data.PREPARE, "student_laps", lambda _: {})
    study.make_runs(opened)
    with Path("docs/first_try.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["recording"] == "real"
    assert 0 <= float(row["autonomy"]) <= 1
