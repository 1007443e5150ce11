"""Damaged files of networks: each is read, or refused in one line that names it."""

import io
import json
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from hypothesis import strategies as st

from tests.hostile.mutations import (
    FEW_AND_MANY,
    ODD_VALUES,
    mutated_bytes,
    mutated_json,
    mutated_value,
    mutated_zip,
    read_damaged,
)
from tests.zoo.models.test_models_command import build
from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.checkpoints.onnx_policy import CARD, OnnxPolicy

FRAME = np.zeros((160, 320, 3), np.uint8)
# Values that only pickles hold.
ODD_OBJECTS = (
    *ODD_VALUES, torch.zeros(0), torch.zeros(1).expand(3, 4), torch.ones(2, dtype=torch.int8),
    torch.full((1,), torch.nan), b"x", (1, (2,)), 1j, torch.float8_e4m3fn, {1: 2}, {(1, 2): 3},
)  # fmt: skip


def saved(contents: object) -> bytes:
    written = io.BytesIO()
    torch.save(contents, written)
    return written.getvalue()


def damaged_torch_files(path: Path) -> st.SearchStrategy[bytes]:
    """Return a strategy of torch files whose bytes, members, pickle or values are damaged."""
    data = path.read_bytes()
    values = mutated_value(torch.load(path, weights_only=True), ODD_OBJECTS).map(saved)
    return mutated_bytes(data) | mutated_zip(data) | values | values


@FEW_AND_MANY
def test_a_damaged_checkpoint_is_named(count: int, tmp_path: Path) -> None:
    path = write_constant(tmp_path / "x.ckpt", 0.1)
    read_damaged(damaged_torch_files(path), load_checkpoint, path, count)


KIND_BEGINS = (
    b"PK\3\4" + b"\0" * 40, b"\x80\x02}q\x00.", b"\x08\x07\x12\x07pytorch", b"\x08\x01\x12\x10",
    b"\x89HDF\r\n\x1a\n" + b"\0" * 40, b"version https://git-lfs.github.com/spec/v1", b"<html>",
    b'{"a": 1}', b"\0\0\0\0TFL3", b"\0" * 60 + b"\x57\xfb\x80\x8b\x24\x75\x47\xdb",
)  # fmt: skip


@FEW_AND_MANY
@pytest.mark.parametrize("suffix", [".h5", ".pb", ".ckpt"])
def test_a_damaged_file_of_another_kind_is_named(suffix: str, count: int, tmp_path: Path) -> None:
    damaged = st.sampled_from(KIND_BEGINS).flatmap(mutated_bytes)
    read_damaged(damaged, load_checkpoint, tmp_path / f"x{suffix}", count // 3)


@pytest.fixture(scope="module")
def model() -> onnx.ModelProto:
    """Return the graph of a small network."""
    network, view = build("tiny")
    return onnx.load_from_string(onnx_bytes(Checkpoint(network.eval(), view, {}, {})))


def driven(path: Path) -> None:
    OnnxPolicy(path)(FRAME, 9.0)


@st.composite
def mutated_graphs(draw: st.DrawFn, model: onnx.ModelProto) -> bytes:
    """Draw an ONNX file with a changed node, tensor, input or metadata."""
    proto = onnx.ModelProto.FromString(model.SerializeToString())
    graph = proto.graph
    how = draw(st.sampled_from(("node", "lose", "tensor", "shape", "type", "card", "attribute")))
    node = draw(st.sampled_from(list(graph.node)))
    if how == "node":
        node.op_type = draw(st.sampled_from(("Relu", "Add", "Gemm", "Loop", "Nothing", "Reshape")))
    elif how == "lose":
        graph.node.remove(node)
    elif how == "tensor":
        tensor = draw(st.sampled_from(list(graph.initializer)))
        size = draw(st.sampled_from((0, -1, 1, 7, 2**40)))
        tensor.dims[:] = [size, *tensor.dims[1:]]
    elif how in ("shape", "type"):
        value = draw(st.sampled_from([*graph.input, *graph.output])).type.tensor_type
        if how == "type":
            value.elem_type = draw(st.integers(0, 20))
        elif value.shape.dim:
            size = draw(st.sampled_from((0, -1, 1, 3, 2**40)))
            draw(st.sampled_from(list(value.shape.dim))).dim_value = size
    elif how == "card":
        (entry,) = [prop for prop in proto.metadata_props if prop.key == CARD]
        entry.value = draw(mutated_json(json.loads(entry.value))).decode("utf-8", "ignore")
    elif node.attribute:
        attribute = draw(st.sampled_from(list(node.attribute)))
        attribute.i = draw(st.sampled_from((0, -1, 2**40)))
        attribute.ints[:] = [draw(st.sampled_from((0, -1, 2**40)))] * len(attribute.ints)
    return proto.SerializeToString()


@FEW_AND_MANY
def test_a_damaged_onnx_file_is_named(count: int, model: onnx.ModelProto, tmp_path: Path) -> None:
    damaged = mutated_bytes(model.SerializeToString()) | mutated_graphs(model)
    read_damaged(damaged, driven, tmp_path / "x.onnx", count)


def test_metadata_that_are_not_utf8_are_named(model: onnx.ModelProto, tmp_path: Path) -> None:
    whole = model.SerializeToString()
    (tmp_path / "x.onnx").write_bytes(whole.replace(b'"format"', b'"f\xffrmat"'))
    with pytest.raises(InputError, match=r"x\.onnx: .*metadata"):
        OnnxPolicy(tmp_path / "x.onnx")


def parse(path: Path) -> object:
    return json.loads(path.read_bytes())


def refuse(path: Path) -> None:
    raise InputError("something is wrong")


@pytest.mark.parametrize(("read", "error"), [(parse, ValueError), (refuse, AssertionError)])
def test_a_wrong_reader_fails(read: object, error: type[Exception], tmp_path: Path) -> None:
    with pytest.raises(error):
        read_damaged(mutated_bytes(b'{"a": [1]}'), read, tmp_path / "a.json", 50)
