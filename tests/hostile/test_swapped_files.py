"""Files that are replaced while they are read: only what was checked is loaded."""

import os
import zipfile
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from tests.zoo.bomb import Bomb
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_plain
from zoo.checkpoints.onnx_policy import open_session


def swapping(monkeypatch: pytest.MonkeyPatch, place: object, name: str, path: Path) -> None:
    """Replace the file at `path` whenever a function is called, before it runs."""
    own = getattr(place, name)

    def swap(*arguments: object) -> object:
        os.replace(path.with_name("other"), path)  # noqa: PTH105 - a single system call
        return own(*arguments)

    monkeypatch.setattr(place, name, swap)


@pytest.mark.parametrize("other", ["checkpoint", "code", "pipe"])
def test_a_checkpoint_is_loaded_as_it_was_checked(
    other: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x.ckpt"
    torch.save({"a": 1}, path)
    if other == "pipe":
        os.mkfifo(tmp_path / "other")
    else:
        torch.save(
            {"a": 2} if other == "checkpoint" else Bomb(tmp_path / "ran"), path.with_name("other")
        )
    swapping(monkeypatch, zipfile, "is_zipfile", path)
    assert load_plain(path) == {"a": 1}
    assert not (tmp_path / "ran").exists()


def adding(number: float, outside: str | None = None) -> bytes:
    """Return a model that adds a number, stored in the model or in another file."""
    weights = onnx.numpy_helper.from_array(np.full(400, number, np.float32), "w")
    if outside:
        weights.ClearField("raw_data")
        weights.data_location = onnx.TensorProto.EXTERNAL
        for key, value in {"location": outside, "offset": "0", "length": "1600"}.items():
            entry = weights.external_data.add()
            entry.key, entry.value = key, value
    of = [onnx.helper.make_tensor_value_info(one, onnx.TensorProto.FLOAT, [400]) for one in "xy"]
    node = onnx.helper.make_node("Add", ["x", "w"], ["y"])
    graph = onnx.helper.make_graph([node], "graph", [of[0]], [of[1]], [weights])
    opset = onnx.helper.make_opsetid("", 17)
    return onnx.helper.make_model(graph, opset_imports=[opset], ir_version=8).SerializeToString()


def added(session: onnxruntime.InferenceSession) -> float:
    return float(session.run(None, {"x": np.zeros(400, np.float32)})[0][0])


def test_an_onnx_file_is_run_as_it_was_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x.onnx"
    path.write_bytes(adding(1.0))
    path.with_name("other").write_bytes(adding(2.0))
    swapping(monkeypatch, onnxruntime, "SessionOptions", path)
    assert added(open_session(path, 1)) == 1.0


@pytest.mark.parametrize("outside", ["../w.bin", "sub/../../w.bin", "/ABSOLUTE/w.bin", "none.bin"])
@pytest.mark.parametrize("here", [".", "models"])
def test_weights_outside_of_an_onnx_files_folder_are_not_read(
    outside: str, here: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "models" / "sub").mkdir(parents=True)
    (tmp_path / "w.bin").write_bytes(np.ones(400, np.float32).tobytes())
    path = tmp_path / "models" / "x.onnx"
    path.write_bytes(adding(1.0, outside.replace("/ABSOLUTE", str(tmp_path))))
    monkeypatch.chdir(tmp_path / here)
    with pytest.raises(InputError, match=r"x\.onnx: .*onnx"):
        open_session(path, 1)


def test_weights_next_to_an_onnx_file_are_read_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "w.bin").write_bytes(np.full(400, 3.0, np.float32).tobytes())
    (tmp_path / "models" / "x.onnx").write_bytes(adding(1.0, "w.bin"))
    monkeypatch.chdir(tmp_path)
    assert added(open_session(Path("models/x.onnx"), 1)) == 3.0
