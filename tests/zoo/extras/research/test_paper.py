"""`drivezoo leaderboard paper=FOLDER`: what a paper needs, of results and of trainings."""

import csv
import hashlib
import json
import warnings
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tests.contracts.outside_package import installed, manual_example
from tests.recordings import Written
from tests.refusals import refusal
from tests.zoo.base.test_file_text import ODD_NAMES, check_shown_name
from tests.zoo.notebooks import run_notebook
from tests.zoo.results.synthetic_results import ROADS, figures, of_levels, result, write
from tests.zoo.results.test_benchmark_command import write_suite
from tests.zoo.sweeps import write_run
from zoo.base.errors import InputError, UsageError
from zoo.commands.leaderboard import leaderboard
from zoo.extras.research.paper import of_results
from zoo.extras.research.share_panels import share_panels
from zoo.results.differences import read_entries

pytestmark = pytest.mark.usefixtures("here")


def write_entry(name: str, autonomy: float, seeds: int = 3, checkpoint: Path | None = None) -> None:
    rng = np.random.default_rng(1)
    drives = np.clip(figures(rng, autonomy, seeds, 0.01, np.zeros(len(ROADS))), 0, 1)
    entry = result(drives, name)
    if checkpoint:
        digest = hashlib.sha256(checkpoint.read_bytes()).hexdigest()
        entry["checkpoints"][0] |= {"file": str(checkpoint), "sha256": digest}
    write(Path("marks", name), entry)


def rows(path: str) -> list[dict[str, str]]:
    return list(csv.DictReader(Path(path).read_text().splitlines()))


def test_results_give_tables_plots_and_a_complete_archive(monkeypatch: pytest.MonkeyPatch) -> None:
    run = write_run(Path("runs/a"), 0.9, versions={"torch": "1.2.3"})
    checkpoint = run / "checkpoints" / "best.ckpt"
    checkpoint.parent.mkdir()
    checkpoint.write_bytes(b"weights")
    write_entry("good", 0.9, checkpoint=checkpoint)
    write_entry("bad", 0.6)
    write_entry("alone", 0.95, seeds=1)
    baseline = result(np.full((1, len(ROADS)), 0.1), "mean")
    baseline["checkpoints"][0]["sha256"] = None
    write(Path("marks/mean"), baseline)
    shown = leaderboard("marks", paper="paper")
    assert [row["training_seeds"] for row in shown.table()] == [1, 3, 3, 0]
    assert not Path("marks/leaderboard.html").exists()  # marks may be somebody's published results

    table = rows("paper/table.csv")
    assert [(row["entry"], row["rank"], row["seeds"]) for row in table] == [
        ("good", "1", "3"),
        ("bad", "2", "3"),
        ("alone", "-", "1"),  # how trainings differ is unknown
        ("mean", "-", ""),  # a baseline
    ]
    assert float(table[0]["sharp_autonomy_low"]) < float(table[0]["sharp_autonomy"])
    (pair,) = rows("paper/pairs.csv")
    assert (pair["a"], pair["b"], pair["verdict"]) == ("good", "bad", "A drives better")
    assert r"\begin{table}" in Path("paper/pairs.tex").read_text()
    for name in ("intervals", "profiles"):
        assert Path(f"paper/{name}.pdf").read_bytes().startswith(b"%PDF")
    text = Path("paper/appendix.md").read_text()
    assert "drivezoo leaderboard marks paper=paper" in text
    assert "drivezoo train model=tiny seed=1" in text
    assert "| torch |" in text
    assert "1.2.3" in text
    assert any("of good is there: 1.ckpt" in line for line in shown.notes)
    assert any("your suite own" in line for line in shown.notes)

    zipfile.ZipFile("paper/repeat.zip").extractall("again")
    monkeypatch.chdir("again")
    assert Path("runs/1_good-1/.hydra/config.yaml").is_file()
    assert list(Path("results/1_good").glob("*.ckpt"))
    leaderboard("results", paper="paper")
    assert Path("paper/table.csv").read_text() == Path("../paper/table.csv").read_text()
    assert Path("paper/pairs.tex").read_text() == Path("../paper/pairs.tex").read_text()


@pytest.mark.parametrize(("split", "seed"), [("", 0), (" split=dev", None)])
def test_checkpoints_beside_a_result_are_in_the_archive(split: str, seed: int | None) -> None:
    checkpoint = Path("1.ckpt")
    checkpoint.write_bytes(b"weights")
    write_entry("good", 0.9, seeds=1, checkpoint=checkpoint)
    checkpoint.rename("marks/good/1.ckpt")
    Path("marks/good/command.txt").write_text("drivezoo train model=lenet\n")
    path = Path("marks/good/result.json")
    content = json.loads(path.read_text()) | {"suite": "own-dev" if split else "own"}
    content["checkpoints"][0]["training_seed"] = seed
    path.write_text(json.dumps(content))
    shown = leaderboard("marks", paper="paper")
    assert not any("not in repeat.zip, since" in line for line in shown.notes)
    names = zipfile.ZipFile("paper/repeat.zip").namelist()
    assert f"results/1_good/{hashlib.sha256(b'weights').hexdigest()[:16]}.ckpt" in names
    text = Path("paper/appendix.md").read_text()
    assert f"drivezoo benchmark marks/good/1.ckpt suite=own.yaml{split} entry=good" in text
    assert "drivezoo benchmark verify results/1_good suite=own.yaml" in text
    assert f"\ndrivezoo train model=lenet{'' if seed is None else ' seed=0'}\n" in text
    assert f"| good | {'-' if seed is None else '0'} |" in text


def test_drives_of_levels_give_a_curve_for_each_axis() -> None:
    axis = [("geometry", f"bends_{level}:{road}", {}) for level in (1, 2) for road in range(4)]
    axis += [("camera", f"bends_{level}:{road}", {}) for level in (1, 2, 3) for road in range(4)]
    failed = np.array([[0.0] * 4 + [1.0, 0, 0, 1] + [0.0] * 12] * 3)
    write(Path("marks/half"), of_levels(1 - failed, "half", axis))
    write(Path("marks/late"), of_levels(np.full_like(failed, 0.99), "late", axis))
    shown = leaderboard("marks", paper="paper")
    table = rows("paper/table.csv")
    assert [entry.first.name for entry in shown.entries] == [row["entry"] for row in table]
    assert list(table[0])[5] == "without_intervention"
    assert "p: of the difference" in Path("paper/pairs.tex").read_text()
    panel, other = of_results(read_entries(Path("marks/half"))).plots["profiles"].axes
    assert (panel.get_title(), other.get_title()) == ("geometry", "camera")
    assert len(other.lines[0].get_ydata()) == 3
    assert panel.lines[0].get_ydata().tolist() == [100, 50]


def test_trainings_have_no_pairs_and_the_notes_name_the_command() -> None:
    for model, autonomy in (("tiny", 0.7), ("lenet", 0.9)):
        for seed in (1, 2):
            folder = Path("sweep", f"{model}{seed}")
            write_run(folder, autonomy + 0.02 * seed, seed=seed, overrides=(f"model={model}",))
    (folder / ".hydra").rename("mine")
    (folder / ".hydra").symlink_to(Path("mine").absolute())
    shown = leaderboard("sweep", paper="paper")
    assert [row["model"] for row in rows("paper/table.csv")] == ["lenet", "tiny"]
    assert not Path("paper/pairs.csv").exists()
    assert "drivezoo benchmark sweep/lenet1 sweep/lenet2 out=marks/1 entry=entry_1" in shown.notes
    names = zipfile.ZipFile("paper/repeat.zip").namelist()
    assert {f"runs/{run}/.hydra/config.yaml" in names for run in ("1-1", "2-1")} == {True}
    assert "runs/1-2/.hydra/config.yaml" not in names  # a stranger's link


def test_another_packages_files_stand_beside_ours(here: Path) -> None:
    write_run(Path("sweep/a"), 0.9)
    code = manual_example("my_paper.py")
    with installed(here / "site", code, "drivezoo.papers", attribute=":write_seeds"):
        for overwrite in (False, True):
            shown = leaderboard("sweep", paper="paper", overwrite=overwrite)
            assert Path("paper/seeds.txt") in shown.written
            assert Path("paper/table.tex") in shown.written


def test_mixed_results_and_a_folder_with_files_are_refused() -> None:
    write_run(Path("sweep/a"), 0.9)
    write_entry("good", 0.9)
    assert "paper=new" in refusal(leaderboard, "sweep", "marks", paper="new")
    assert "marks: is not empty" in refusal(leaderboard, "marks", paper="marks")
    assert not Path("new").exists()


def test_results_that_are_links_are_named() -> None:
    write_entry("good", 0.9)
    Path("marks/good/result.json").rename("result.json")
    Path("marks/good/result.json").symlink_to(Path("result.json").absolute())
    with pytest.raises(InputError, match=r"^paper=new: .*link.*repeat\.zip.*copy the files"):
        leaderboard("marks", paper="new")
    assert not Path("new").exists()


def test_a_paper_is_replaced_only_with_overwrite() -> None:
    write_entry("good", 0.9)
    write_entry("bad", 0.6)
    leaderboard("marks", paper="paper")
    with pytest.raises(UsageError, match=r"paper=paper/appendix\.md: exists"):
        leaderboard("marks/good", paper="paper")
    assert Path("paper/pairs.csv").exists()
    Path("paper/notes.txt").write_text("mine")
    leaderboard("marks/good", paper="paper", overwrite=True)
    assert not Path("paper/pairs.csv").exists()
    assert [row["entry"] for row in rows("paper/table.csv")] == ["good"]
    assert Path("paper/notes.txt").read_text() == "mine"


def test_the_study_compares_networks_and_resumes(recorded: Written, here: Path) -> None:
    tiny = {"RECORDING": str(recorded.folder), "SUITE": str(write_suite(here)), "WORKERS": 1}
    tiny |= {"MODELS": ["linear", "tiny"], "SEEDS": [1], "EPOCHS": 0}
    with pytest.raises(InputError, match=r"typo: no such folder"):  # corrected, it trains
        run_notebook("study.ipynb", **tiny | {"RECORDING": "typo"})
    first = run_notebook("study.ipynb", **tiny)
    for name in ("metrics.json", "status.json"):  # as if killed in this training
        (here / "study" / f"{recorded.folder.name}-0-epochs" / "tiny-1" / name).unlink()
    second = run_notebook("study.ipynb", **tiny)
    assert second["ranking"].table() == first["ranking"].table()
    assert len(first["comparisons"]) == 1
    assert (here / "study" / "paper" / "profiles.pdf").stat().st_size > 1000
    assert "linear & 15 & 1 &" in (here / "study" / "paper" / "table.tex").read_text()
    archive = zipfile.ZipFile(here / "study" / "paper" / "repeat.zip").namelist()
    assert sum(name.endswith(".ckpt") for name in archive) == 2
    third = run_notebook("study.ipynb", **tiny | {"SEEDS": [1, 2], "MODELS": ["linear"]})
    assert len(third["entries"]["linear"].result.checkpoints) == 2, "drives of one seed are read"


@pytest.mark.parametrize("name", ODD_NAMES[::4])  # a formula, and control characters
def test_a_plot_shows_a_name_as_it_is(name: str, tmp_path: Path) -> None:
    figure = SimpleNamespace(value=0.5, low=0.4, high=0.6)
    check_shown_name(name, share_panels({name: ([1], {name: [figure]})}, "x", "y"), tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # as of axes without a width
        share_panels({"": ([1], {name * 20: [figure]})}, "x", "y").savefig(tmp_path / "long.png")
