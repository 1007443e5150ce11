"""A training on relative paths, and what wants its recording in another folder afterwards."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from datamodules.format_options import ReadOptions
from tests.datamodules.exchange.test_tub import record, write_tub
from tests.zoo.command_runs import run_here, succeed
from tests.zoo.trainings import metrics
from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint, read_checkpoint_file
from zoo.checkpoints.checkpoint_path import STARTED_IN
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.checkpoints.new_checkpoint import checkpoint_bytes, lean_contents
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.checkpoints.policy_base import read_as_trained
from zoo.commands.rerun import lead_from
from zoo.scoring.evidence import read_evidence
from zoo.scoring.parity import take_frames
from zoo.scoring.reported_run import ReportedRun

RIG = "{name: small, camera: {size: [160, 120], vertical_fov_deg: 50, up_m: 0.2}, "
RIG += "wheelbase_m: 0.2, steering_deg: 20}"
KEYS = (
    *("model=tiny", "trainer.max_epochs=1", "augment=[]", "callbacks.fed_batch=null"),
    *("data.root=laps/tub", "data.rig=car.yaml", "data.straight_cap=null", "logger=csv"),
    *("data.block_s=0.1", "data.gap_s=0", "hydra.run.dir=run"),
)


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train on a tub of small frames by relative paths; return the folder of the command."""
    cwd = tmp_path_factory.mktemp("begun")
    rows = [record(index, user__angle=float(np.sin(index / 2))) for index in range(12)]
    write_tub(cwd / "laps" / "tub", rows)
    (cwd / "car.yaml").write_text(RIG)
    succeed(run_here(cwd, *KEYS))
    return cwd


@pytest.fixture
def checkpoint(begun: Path, here: Path) -> Checkpoint:
    """Return the training's checkpoint, in another folder."""
    return load_checkpoint(begun / "run")


def test_a_replay_and_a_report_read_recording_and_rig(begun: Path, here: Path) -> None:
    tub = str(begun / "laps" / "tub")
    typed = read_as_trained([load_policy(begun / "run")], tub, ReadOptions())
    assert typed["rig"] == str(begun / "car.yaml")
    assert ReportedRun.open(begun / "run").recording.rig.name == "small"


def test_the_next_command_leads_to_it(
    begun: Path, checkpoint: Checkpoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    best, trained = Path("run/checkpoints/best.ckpt"), (checkpoint.config, checkpoint.data)
    assert read_evidence(begun / best, *trained).root == str(begun / "laps" / "tub")
    monkeypatch.chdir(begun)
    assert read_evidence(best, *trained).root == "laps/tub", "in its own folder, as typed"


@pytest.mark.parametrize("root", ["laps/tub", ["laps/tub", "nowhere"]])
def test_a_config_that_is_trained_again_leads_to_it(begun: Path, here: Path, root: object) -> None:
    config = OmegaConf.create({"data": {"root": root, "images": None, "rig": "${data.root}"}})
    lead_from(begun, config)
    absolute = str(begun / "laps" / "tub")
    assert config.data.root == (absolute if isinstance(root, str) else [absolute, "nowhere"])
    assert OmegaConf.to_container(config)["data"]["rig"] == "${data.root}"


def test_it_resumes_in_another_folder(begun: Path, tmp_path: Path) -> None:
    shutil.copytree(begun / "run", tmp_path / "run")
    (tmp_path / "elsewhere").mkdir()
    succeed(run_here(tmp_path / "elsewhere", "resume=../run", "trainer.max_epochs=2"))
    assert metrics(tmp_path / "run")["epochs"] == 2


def test_a_moved_recording_is_replaced_by_frames_of_the_networks_size(
    begun: Path, checkpoint: Checkpoint
) -> None:
    data = checkpoint.data | {STARTED_IN: str(begun / "moved")}
    frames = take_frames(None, replace(checkpoint, data=data))
    assert {frame.shape for frame in frames.frames} == {(120, 160, 3)}
    for words in ("in 160 x 120, since", "recording laps/tub is not found", "frames=FOLDER"):
        assert words in frames.source


def test_an_export_is_compared_in_another_folder(begun: Path, tmp_path: Path) -> None:
    printed = succeed(run_here(tmp_path, str(begun / "run"), module="zoo.commands.export"))
    assert f"frames of {begun}/laps/tub" in printed


def test_no_shared_file_names_the_folder(begun: Path, checkpoint: Checkpoint) -> None:
    contents = read_checkpoint_file(begun / "run" / "checkpoints" / "best.ckpt")
    assert contents["drivezoo"][STARTED_IN] == str(begun)
    checkpoint.config["logger"] = contents["drivezoo"]["config"]["logger"] = {"url": "ann:secret@b"}
    for shared in (checkpoint_bytes(lean_contents(contents)), onnx_bytes(checkpoint)):
        assert str(begun).encode() not in shared
        assert b"secret" not in shared
