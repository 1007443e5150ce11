"""Kinds of networks' files by their content, and what commands say of those that do not drive."""

import gzip
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import nn

import drivezoo
from tests.refusals import refusal
from tests.zoo.command_runs import only_line, run_here
from tests.zoo.extras.keras.keras_files import write_h5, write_json, write_keras
from tests.zoo.extras.keras.test_keras_file import LAYERS, check_layers
from tests.zoo.written_checkpoints import write_constant
from zoo.base.console_script import commands
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.extras.keras.keras_file import read_keras_apart
from zoo.extras.keras.network_kind import IMPORTED, KINDS, network_kind

Writer = Callable[[Path], object]

READ = ("hdf5", "keras", "packed")


class Steering(nn.Module):
    """A network of another program: the mean of a frame's green."""

    def __init__(self) -> None:
        super().__init__()
        self.factor = nn.Parameter(torch.tensor([0.25]))

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """Return the steering."""
        return self.factor * images[:, 1].mean((1, 2))[:, None]


def write_bytes(data: bytes) -> Writer:
    return lambda path: path.write_bytes(data)


def write_folder(*names: str) -> Writer:
    def write(path: Path) -> None:
        for name in names:
            (path / name).parent.mkdir(parents=True, exist_ok=True)
            (path / name).write_bytes(b"x")

    return write


def write_packed(path: Path) -> None:
    inner = write_h5(path.with_name("inner.h5"), LAYERS)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(inner, "course-main/model.h5")
        archive.writestr("__MACOSX/course-main/._model.h5", b"")
        archive.writestr("course-main/README.md", b"a network")


def write_json_alone(path: Path) -> None:
    write_json(path.with_name("a.json"), LAYERS).rename(path)


CASES: list[tuple[str, str, Writer]] = [
    ("hdf5", "model.keras", lambda path: write_h5(path, LAYERS)),
    ("keras", "model.h5", lambda path: write_keras(path, LAYERS)),
    ("json", "model.txt", write_json_alone),
    ("packed", "model.h5", write_packed),
    ("folder", "course", write_folder("model.h5")),
    ("torch", "model.h5", lambda path: torch.save({"epoch": 1}, path)),
    (
        "torch",
        "model.keras",
        lambda path: torch.save({"a": 1}, path, _use_new_zipfile_serialization=False),
    ),
    ("script", "model.h5", lambda path: torch.jit.save(torch.jit.script(Steering()), str(path))),
    ("pickle", "model.h5", write_bytes(pickle.dumps({"a": 1}))),
    ("onnx", "model.pb", write_bytes(b"\x08\x07\x12\x07pytorch")),
    ("model", "model.onnx.txt", write_bytes(b"\x08\x01\x12\x10")),
    ("model", "export", write_folder("saved_model.pb", "variables/variables.index")),
    ("tensors", "model.h5", write_bytes(b"\0" * 60 + b"\x57\xfb\x80\x8b\x24\x75\x47\xdb")),
    ("tensors", "model.data-00000-of-00001", write_bytes(b"x" * 60)),
    ("tensors", "checkpoint", write_bytes(b'model_checkpoint_path: "model.ckpt"\n')),
    ("tensors", "save", write_folder("checkpoint", "model.ckpt.index", "model.ckpt.meta")),
    ("model", "frozen.pb", write_bytes(b"\x0a\x10node")),
    ("lite", "model.h5", write_bytes(b"\x1c\0\0\0TFL3" + b"\0" * 20)),
    ("archive", "model.h5", write_bytes(gzip.compress(b"x"))),
    ("page", "model.h5", write_bytes(b"\n<!DOCTYPE html><html>")),
    ("empty", "model.h5", write_bytes(b"")),
    ("", "model.h5", write_bytes(b"steering")),
]


@pytest.mark.parametrize(("kind", "name", "write"), CASES)
def test_a_kind_is_told_by_the_content_and_read_or_named_with_its_remedy(
    kind: str, name: str, write: Writer, tmp_path: Path
) -> None:
    path = tmp_path / name
    write(path)
    assert network_kind(path) == kind
    line = refusal(load_policy, path)
    assert line.startswith(f"{path}: is ")
    if kind in IMPORTED:
        assert f"drivezoo import {path}" in line
        if kind in READ:
            check_layers(path)
        return
    if kind in KINDS and kind not in ("torch", "pickle"):
        assert KINDS[kind][1] in line
    if kind:
        line = refusal(read_keras_apart, path)
        assert line.startswith(f"{path}: is ")
        assert "HDF5" not in line
        assert "copy it again" not in line or kind == "empty"


def test_an_import_reads_the_only_network_of_a_folder(tmp_path: Path) -> None:
    """comma.ai published the layers as JSON, and HDF5 weights named `.keras`."""
    path = write_json(tmp_path / "steering_angle.json", LAYERS)
    path.with_suffix(".h5").rename(path.with_suffix(".keras"))
    for source in (tmp_path, path, path.with_suffix(".keras")):
        check_layers(source)
    write_h5(tmp_path / "model.h5", LAYERS)
    assert "holds 2 networks (model.h5, steering_angle.keras)" in refusal(check_layers, tmp_path)


def test_a_zip_leaves_nothing_outside_and_names_itself(here: Path) -> None:
    with zipfile.ZipFile("evil.zip", "w") as archive:
        archive.writestr("../model.h5", b"\x89HDF\r\n\x1a\n" + b"\0" * 90)
    with pytest.raises(InputError, match=r"^evil\.zip.*model\.h5"):
        read_keras_apart(Path("evil.zip"))
    assert [path.name for path in here.iterdir()] == ["evil.zip"]
    assert not (here.parent / "model.h5").exists()


@pytest.mark.parametrize(
    "name", sorted({"drive", "evaluate", "export", "search", "doctor"} & commands().keys())
)
def test_a_command_of_a_checkpoint_names_the_import(name: str, tmp_path: Path) -> None:
    write_h5(tmp_path / "model.h5", LAYERS)
    result = run_here(tmp_path, "model.h5", module=commands()[name])
    assert "drivezoo import model.h5" in (result.stdout + result.stderr)
    assert result.returncode


def test_an_import_of_a_checkpoint_of_ours_is_not_needed(tmp_path: Path) -> None:
    write_constant(tmp_path / "model.h5", 0.1)
    line = only_line(run_here(tmp_path, "model.h5", module="zoo.extras.keras.import"))
    assert "drivezoo drive model.h5" in line


@pytest.mark.parametrize("name", ["state", "state in a checkpoint", "script"])
def test_the_three_lines_of_the_message_drive_a_network_of_pytorch(
    name: str, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    network, path = Steering(), here / "model.pth"
    if name == "script":
        torch.jit.save(torch.jit.script(network), str(path))
    else:
        state = network.state_dict()
        torch.save(state if name == "state" else {"epoch": 3, "state_dict": state}, path)
    line = only_line(run_here(here, "model.pth", module="zoo.extras.keras.import"))
    _, _, code = line.partition("frame / 127.5 - 1: ")
    code = code.replace("YOUR_FILE", __name__).replace("YOUR_CLASS", Steering.__name__)
    driven, evaluate = [], drivezoo.evaluate

    def drive(*given: object, **keys: object) -> None:
        driven.append(evaluate(*given, **keys, laps=0.003, page=False))

    monkeypatch.setattr(drivezoo, "evaluate", drive, raising=False)
    exec(code, {})
    assert len(driven) == 1


def test_where_an_onnx_file_does_not_do_its_checkpoint_is_to_be_named(tmp_path: Path) -> None:
    path = tmp_path / "model.onnx"
    path.write_bytes(b"\x08\x07\x12\x07pytorch")
    with pytest.raises(InputError, match=r"model\.onnx: .*name the checkpoint"):
        load_checkpoint(path)
