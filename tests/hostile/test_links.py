"""Links in a stranger's run folder: no command writes to their targets."""

import os
import shutil
from pathlib import Path

import pytest
import torch

from tests.hostile.conftest import Refusal
from tests.zoo.sweeps import write_run
from zoo.base.errors import InputError
from zoo.base.whole_file import refuse_links_out, remove_parts, write_whole
from zoo.checkpoints.checkpoint_files import CheckpointFiles
from zoo.commands.leaderboard import leaderboard
from zoo.commands.report import report
from zoo.commands.rerun import rerun
from zoo.commands.sweep import sweep
from zoo.commands.train import train_or_sweep as zoo
from zoo.driving.drive_log import write_summary
from zoo.runs.plots import save_figure
from zoo.runs.status import write_status
from zoo.training.candidates import take
from zoo.training.sweep_record import new_record, write_record

pytestmark = pytest.mark.skipif(os.name != "posix", reason="makes links")


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """Write a file outside of the run's folder."""
    path = tmp_path / "mine"
    path.write_text("mine")
    return path


def write_figure(folder: Path) -> None:
    from matplotlib.figure import Figure

    save_figure(Figure(figsize=(1, 1)), folder / "plot.png")


WRITERS = {
    "status.json": lambda folder: write_status(folder, "running"),
    "sweep.json": lambda folder: write_record(folder, new_record([])),
    "drive.json": lambda folder: write_summary(folder, {}),
    "x.ckpt": lambda folder: CheckpointFiles().save_checkpoint({}, folder / "x.ckpt"),
    "plot.png": write_figure,
    "x.json": lambda folder: write_whole(folder / "x.json", "{}"),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_link_in_place_of_a_file_is_not_followed(name: str, mine: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    for link in (name, f"{name}.part", f".{name}.part", f"{name}.{os.getpid()}.part"):
        (folder / link).symlink_to(mine)
    WRITERS[name](folder)
    assert mine.read_text() == "mine"
    assert not (folder / name).is_symlink()
    (tmp_path / "plain").touch()
    assert (folder / name).stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_the_choice_of_the_best_follows_no_link(mine: Path, tmp_path: Path) -> None:
    for name in ("best.ckpt", "last.ckpt"):
        (tmp_path / name).write_text(name)
    for name in ("monitored.ckpt", "best.ckpt.part", "monitored.ckpt.part"):
        (tmp_path / name).symlink_to(mine)
    take(tmp_path, "last.ckpt")
    assert (tmp_path / "best.ckpt").read_text() == "last.ckpt"
    assert (tmp_path / "monitored.ckpt").read_text() == "best.ckpt"
    assert mine.read_text() == "mine"


COMMANDS = {
    "zoo.commands.report": (report.main, ["run"]),
    "zoo": (zoo, ["resume=run"]),
    "zoo.commands.rerun": (rerun.main, ["run", "out=again"]),
}


@pytest.mark.parametrize("link", ["report", "plots", "hparams.yaml", ".hydra/x", "split.csv"])
@pytest.mark.parametrize("name", COMMANDS)
def test_no_link_leads_out(name: str, link: str, mine: Path, here: Path, refusal: Refusal) -> None:
    run = write_run(here / "run")
    config = {"data": {"root": None}, "model": {"name": "tiny"}}
    (run / ".hydra" / "config.yaml").write_text(repr(config))
    (here / "elsewhere").mkdir()
    (run / link).symlink_to(here / "elsewhere" if link in ("report", "plots") else mine)
    line = refusal(name, *COMMANDS[name])
    assert f"run/{link}: " in line
    assert "link" in line.replace(link, "")
    assert mine.read_text() == "mine"
    assert list((here / "elsewhere").iterdir()) == []
    assert not (here / "again").exists()


def test_a_sweep_with_a_link_out_is_not_resumed(mine: Path, here: Path, refusal: Refusal) -> None:
    (here / "sweep" / "0").mkdir(parents=True)
    write_record(here / "sweep", new_record(["seed=1,2"]))
    (here / "sweep" / "0" / "log.txt").symlink_to(mine)
    assert "sweep/0/log.txt: " in refusal("zoo.commands.sweep", sweep.main, ["resume=sweep"])


def test_a_link_within_the_folder_is_kept(tmp_path: Path) -> None:
    """Weights & Biases makes such a link to its latest run."""
    (tmp_path / "run" / "wandb" / "one").mkdir(parents=True)
    (tmp_path / "run" / "wandb" / "latest").symlink_to("one")
    refuse_links_out(tmp_path / "run")
    (tmp_path / "run2").symlink_to(tmp_path / "run")
    refuse_links_out(tmp_path / "run2")
    (tmp_path / "running").mkdir()
    (tmp_path / "run" / "out").symlink_to(tmp_path / "running")
    with pytest.raises(InputError, match="run/out: "):
        refuse_links_out(tmp_path / "run")


def test_the_leaderboard_refuses_a_link(mine: Path, here: Path, refusal: Refusal) -> None:
    write_run(here / "outputs" / "run", autonomy=1.0)
    (here / "outputs" / "leaderboard.html").symlink_to(mine)
    line = refusal("zoo.commands.leaderboard", leaderboard.main, ["outputs"])
    assert "outputs/leaderboard.html: exists" in line
    assert mine.read_text() == "mine"


def test_only_unfinished_files_of_a_killed_process_are_removed(mine: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    torch.save({}, folder / "best.ckpt")
    (folder / ".best.ckpt.0123456789abcdef.part").write_text("half")
    names = {"best.ckpt", "mine.part", ".x.part", "best.ckpt.parts"}
    for name in names - {"best.ckpt"}:
        (folder / name).write_text("mine")
    (folder / ".y.0123456789abcdef.part").symlink_to(mine)
    remove_parts(folder)
    assert {path.name for path in folder.iterdir()} == names
    assert mine.read_text() == "mine"
    shutil.rmtree(folder)
    remove_parts(folder)
