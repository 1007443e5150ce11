"""ONNX files of 8 bits: they steer nearly as their checkpoint."""

from pathlib import Path

import pytest
from rich.console import Console

from tests.recordings import Written
from tests.zoo.written_checkpoints import checkpoint_of
from zoo.base.errors import InputError
from zoo.base.rig import CURVATURE
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy, load_policy
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.checkpoints.onnx_policy import TOLERANCE
from zoo.commands.export import export
from zoo.extras.car.car_exports import INT8_TOLERANCE, Int8OnnxFile
from zoo.extras.car.donkeycar_export import ROUNDED_TOLERANCE
from zoo.scoring.checked_export import export_checkpoint
from zoo.scoring.parity import compare, take_frames


@pytest.mark.parametrize("name", ["lenet", "cnn_gru"])
def test_8_bits_steer_nearly_as_32(name: str, recorded: Written, tmp_path: Path) -> None:
    checkpoint = checkpoint_of(name, *["model.sequence=4"] * (name == "cnn_gru"))
    checkpoint.data[CURVATURE] = 0.1  # of no known car
    kind = Int8OnnxFile(checkpoint, tmp_path / "model.onnx", str(recorded.folder))
    contents = kind.files("# card")[".onnx"]
    assert len(contents) < 0.4 * len(onnx_bytes(checkpoint))
    (tmp_path / "model.onnx").write_bytes(contents)
    policy = load_policy(tmp_path / "model.onnx")
    assert policy.view == checkpoint.view
    frames = take_frames(str(recorded.folder), checkpoint, 6)
    assert 0 < compare(CheckpointPolicy(checkpoint), policy, frames).difference < 0.1


def test_a_calibration_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    out, keys = str(tmp_path / "model.onnx"), {"weights": "int8", "calibration": "nowhere"}
    with pytest.raises(InputError, match="nowhere"):
        export_checkpoint("tiny41", out, None, Console(quiet=True), **keys)


@pytest.mark.parametrize("largest", [TOLERANCE, ROUNDED_TOLERANCE, INT8_TOLERANCE])
def test_the_help_of_export_names_each_allowed_difference(
    largest: float, capsys: pytest.CaptureFixture[str]
) -> None:
    export.main(["--help"])
    assert f"{largest:g}" in capsys.readouterr().out
