"""Checkpoints by a path, a run, `latest`, or the name of a network that comes with drivezoo."""

import hashlib
import os
import re
import shutil
from pathlib import Path

import pytest

import drivezoo
from benchmarks.study_grid import Study
from tests.refusals import refusal
from tests.slow_members import slow_but
from tests.without_rights import without_rights
from tests.zoo.command_runs import only_line, run, run_here, succeed
from tests.zoo.trainings import equal, weights
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint, read_checkpoint_file
from zoo.checkpoints.checkpoint_path import (
    PACKAGED,
    find_checkpoint,
    find_run,
    name_latest,
    packaged_names,
    read_facts,
    short_name,
)
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.commands import doctor
from zoo.commands.evaluate import evaluate_or_replay as evaluate
from zoo.commands.results import results
from zoo.runs.metrics_file import NAME as METRICS

ODD = "a=b [ï] c"  # what shells, globs and Hydra read otherwise


def make_run(folder: Path, started: float, *names: str) -> Path:
    """Create a run's folder with empty checkpoints."""
    (folder / "checkpoints").mkdir(parents=True)
    for name in names:
        (folder / "checkpoints" / name).write_bytes(b"weights")
    config = folder / ".hydra" / "config.yaml"
    config.parent.mkdir()
    config.write_text("seed: 1\n")
    os.utime(config, (started, started))
    return folder


@pytest.fixture
def work(here: Path) -> Path:
    """Create a working folder with three runs, the newest without a checkpoint."""
    make_run(here / "outputs" / "late", 2_000, "best.ckpt", "last.ckpt")
    make_run(here / "outputs" / "day" / "early", 1_000, "last.ckpt")
    make_run(here / "outputs" / "begun", 3_000)
    return here


@pytest.mark.parametrize(
    ("path", "file"),
    [
        ("late/checkpoints/last.ckpt", "late/checkpoints/last.ckpt"),
        ("late", "late/checkpoints/best.ckpt"),
        ("late/checkpoints", "late/checkpoints/best.ckpt"),
        ("day/early", "day/early/checkpoints/last.ckpt"),
        ("day/early/checkpoints", "day/early/checkpoints/last.ckpt"),
    ],
)
def test_a_file_is_itself_and_a_run_its_best_checkpoint_or_else_its_last(
    work: Path, path: str, file: str
) -> None:
    assert find_checkpoint(f"outputs/{path}") == Path("outputs", file)


def test_latest_is_the_run_that_started_last_and_has_a_checkpoint(
    work: Path, capsys: pytest.CaptureFixture
) -> None:
    # Resumed since, which changes its checkpoints and not when it started.
    os.utime("outputs/day/early/checkpoints/last.ckpt", (9e9, 9e9))
    assert find_checkpoint("latest") == Path("outputs/late/checkpoints/best.ckpt")
    printed = capsys.readouterr()
    assert printed.err == "latest: outputs/late/checkpoints/best.ckpt\n"
    assert not printed.out
    assert find_run("latest") == Path("outputs/late")
    assert METRICS in refusal(results, "latest")
    Path("outputs/day/early", METRICS).write_text("{}")
    assert f"outputs/day/early/{METRICS}: version: is missing" in refusal(results, "latest")


def test_a_job_of_a_sweep_can_be_the_latest(work: Path) -> None:
    make_run(Path("outputs/sweeps/day/time/3"), 5_000, "best.ckpt")
    assert find_checkpoint("latest").parent.parent == Path("outputs/sweeps/day/time/3")


def test_what_is_called_latest_goes_before_the_newest_run(work: Path) -> None:
    make_run(work / "latest", 1, "best.ckpt")
    assert find_checkpoint("latest") == Path("latest/checkpoints/best.ckpt")
    assert find_run("latest") == Path("latest")


def test_a_saved_config_keeps_the_checkpoint_that_latest_was(work: Path) -> None:
    assert name_latest("model.weights=latest") == "model.weights=outputs/late/checkpoints/best.ckpt"


@pytest.mark.parametrize(
    ("folder", "words"),
    [
        ("outputs/sweep", r"2 runs.*outputs/sweep/0"),
        ("outputs/begun", r"drivezoo train resume=outputs/begun"),
        ("IMG", r"checkpoints/best\.ckpt"),
    ],
)
def test_a_folder_without_a_checkpoint_of_its_own_is_refused_with_what_to_do(
    folder: str, words: str, work: Path
) -> None:
    for number in (0, 1):
        make_run(Path(f"outputs/sweep/{number}"), number, "best.ckpt")
    (work / "IMG").mkdir()
    with pytest.raises(InputError, match=f"{folder}: .*{words}"):
        find_checkpoint(folder)


def test_without_a_run_latest_says_where_it_looked(here: Path) -> None:
    with pytest.raises(InputError, match=rf"{here}/outputs .*drivezoo train"):
        find_checkpoint("latest")


def test_a_folder_that_may_not_be_entered_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "closed").mkdir(mode=0)
    tmp_path.chmod(0o711)
    with without_rights(), pytest.raises(InputError, match=r"closed/best\.ckpt: cannot be read"):
        find_checkpoint(tmp_path / "closed" / "best.ckpt")
    (tmp_path / "closed").chmod(0o700)


@pytest.fixture(scope="module")
def odd(run_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Create a working folder whose newest run has every odd character in its name."""
    folder = tmp_path_factory.mktemp("odd")
    shutil.copytree(run_folder, folder / "outputs" / ODD)
    return folder


@pytest.mark.parametrize("path", [f"outputs/{ODD}", "latest"])
def test_python_and_the_doctor_load_a_run(
    path: str, odd: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(odd)
    assert doctor.sort_paths([path]) == (f"outputs/{ODD}/checkpoints/best.ckpt", None)
    assert load_policy(path).name == "PilotNet"
    assert load_checkpoint(path).config["model"]["name"] == "nvidia"


def test_evaluate_takes_the_latest_run_and_keeps_which_it_was(
    odd: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(odd)
    evaluate(["latest", "laps=0.01", "quality=simple", "out=scored"])
    checkpoint = f"outputs/{ODD}/checkpoints/best.ckpt"
    assert checkpoint in (odd / "scored" / "metrics.json").read_text().encode().decode(
        "unicode_escape"
    )
    assert capsys.readouterr().err == f"latest: {checkpoint}\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ("zoo.commands.evaluate", "outputs/none"),
        ("zoo.commands.drive", "outputs/none", "drive.port=0"),
        ("zoo.commands.replay", "outputs/none", "recording"),
        ("zoo.commands.saliency", "outputs/none", "recording"),
        ("zoo.commands.export", "outputs/none"),
        ("zoo", "model.weights=outputs/none", "data.root={recording}"),
    ],
)
def test_every_command_names_the_run_to_take_instead(
    arguments: tuple[str, ...], odd: Path, recorded
) -> None:
    module, *rest = (argument.format(recording=recorded.folder) for argument in arguments)
    line = only_line(run_here(odd, *rest, module=module))
    assert "outputs/none: no such checkpoint" in line
    assert f"outputs/{ODD}/checkpoints/best.ckpt" in line


def test_report_takes_the_latest_run(odd: Path) -> None:
    printed = succeed(run_here(odd, "latest", module="zoo.commands.report"))
    assert f"outputs/{ODD}/report/index.html" in printed


def test_weights_come_from_the_latest_run(odd: Path, run_folder: Path, recorded) -> None:
    keys = ("model=nvidia", "model.weights=latest", "trainer.max_epochs=0", "score=none")
    data = (f"data.root={recorded.folder}", "data.block_s=0.5", "data.gap_s=0.1")
    printed = succeed(run(odd, *keys, *data, "hydra.run.dir=fine"))
    assert f"tensors from outputs/{ODD}/checkpoints/best.ckpt" in printed
    assert equal(weights(odd / "fine", "best"), weights(run_folder, "best"))


MOST_BYTES = 3_000_000  # of the wheel
QUICK = "tiny41"


def test_the_files_are_small_and_each_is_described() -> None:
    assert set(packaged_names()) == {entry.name for entry in Study("pretrained", []).entries()}
    assert {path.stem for path in PACKAGED.glob("*.json")} == set(packaged_names())
    assert sum(path.stat().st_size for path in PACKAGED.iterdir()) < MOST_BYTES


@pytest.mark.parametrize("name", packaged_names())
def test_each_network_loads_and_its_hash_is_recorded(name: str) -> None:
    facts, path = read_facts(name), PACKAGED / f"{name}.ckpt"
    assert hashlib.sha256(path.read_bytes()).hexdigest() == facts["sha256"]
    assert load_policy(path).parameters == facts["parameters"]
    contents = read_checkpoint_file(path)
    assert set(contents) == {"drivezoo", "state_dict"}, "no optimizer"
    card = contents["drivezoo"]
    recorded = card["config"]["data"]["record"]
    assert name == "both_tracks" or card["data"]["fingerprint"] == recorded["fingerprint"]
    assert not re.search(r"'(/|~|[A-Z]:)", str(card)), "no folder of the machine that trained it"


@pytest.mark.parametrize("name", slow_but([QUICK], packaged_names()))
def test_each_network_drives(name: str, here: Path, capsys: pytest.CaptureFixture) -> None:
    (figures,) = drivezoo.evaluate(name, track="lake", laps=0.1, out="out", workers=1).drives
    assert figures["interventions"] == 0
    assert figures["laps"] > 0.09


def test_a_name_is_a_checkpoint_wherever_one_is_taken(
    here: Path, capsys: pytest.CaptureFixture
) -> None:
    path = find_checkpoint(QUICK)
    assert path == PACKAGED / f"{QUICK}.ckpt"
    assert capsys.readouterr().err == f"{QUICK}: comes with drivezoo, {path}\n"
    assert short_name(path) == QUICK, "as the next command names it"


def test_a_file_of_that_name_goes_first_and_a_line_says_so(
    here: Path, capsys: pytest.CaptureFixture
) -> None:
    Path(QUICK).write_bytes(b"")
    assert find_checkpoint(QUICK) == find_checkpoint(QUICK) == Path(QUICK)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{QUICK}: the file of that name here")
    assert short_name(PACKAGED / f"{QUICK}.ckpt") != QUICK


def test_they_are_listed(tmp_path: Path) -> None:
    printed = succeed(run_here(tmp_path, "checkpoints", module="zoo.commands.list"))
    for name in packaged_names():
        assert re.search(rf"^ +{name} +\w+, [\d,]+ parameters", printed, re.MULTILINE)
