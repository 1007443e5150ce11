"""Damaged files of networks: each is read, or refused in one line that names it."""

import io
import json
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from hypothesis import given
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
from tests.zoo.keras.keras_files import (
    Layer,
    keras_3_weights,
    lambda_config,
    model_config,
    random_weights,
    write_h5,
    write_keras,
)
from tests.zoo.models.test_models_command import build
from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint, doubt_members, load_checkpoint, load_plain
from zoo.checkpoints.onnx_policy import CARD, OnnxPolicy
from zoo.checkpoints.policy import build_doubt, doubt_contents
from zoo.export.onnx_file import onnx_bytes
from zoo.hub.card import described_hash
from zoo.keras.keras_file import read_keras
from zoo.keras.keras_layers import convert
from zoo.monitor.guarded_policy import Guard, read_guard, write_guard
from zoo.monitor.scores import make_score

FRAME = np.zeros((160, 320, 3), np.uint8)
KERAS: list[Layer] = [
    ("Lambda", lambda_config(lambda x: x / 127.5 - 1.0), []),
    ("Conv2D", {"filters": 2, "kernel_size": [3, 3]}, random_weights((3, 3, 3, 2), (2,))),
    ("BatchNormalization", {"axis": -1, "epsilon": 0.001}, random_weights(*[(2,)] * 4)),
    ("Flatten", {}, []),
    ("Dense", {"units": 1}, random_weights((1008, 1), (1,))),
]
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


@FEW_AND_MANY
def test_a_damaged_doubt_file_is_named(count: int, tmp_path: Path) -> None:
    members = [write_constant(tmp_path / f"{one}.ckpt", 0.1 * one) for one in (1, 2)]
    path = tmp_path / "x.ckpt"
    torch.save(doubt_contents(members, samples=2, seed=0), path)

    def read(path: Path) -> None:
        contents = load_plain(path)
        if doubt_members(contents) is not None:
            build_doubt(contents, path)

    read_damaged(damaged_torch_files(path), read, path, count)


@FEW_AND_MANY
def test_a_damaged_guard_file_is_named(count: int, tmp_path: Path) -> None:
    score = make_score("attention_mean", {"mean": 0.5})
    path = write_guard(tmp_path / "x.guard", Guard(score, 0.1, 1, 6.0, 2, "0" * 64))
    read_damaged(damaged_torch_files(path), read_guard, path, count)


def imported(path: Path) -> None:
    convert(read_keras(path))


@FEW_AND_MANY
def test_a_damaged_keras_architecture_is_named(count: int, tmp_path: Path) -> None:
    write_h5(tmp_path / "m.h5", KERAS)
    path = tmp_path / "m.json"
    read_damaged(mutated_json(model_config(KERAS)), imported, path, count)


@FEW_AND_MANY
def test_a_damaged_keras_archive_is_named(count: int, tmp_path: Path) -> None:
    path = write_keras(tmp_path / "m.keras", KERAS)
    # Bytes of HDF5 are not damaged here: its library never returns from some such files.
    weights = keras_3_weights(KERAS)
    members = {
        "config.json": mutated_json(model_config(KERAS, version=3)),
        ".h5": st.integers(0, len(weights)).map(lambda end: weights[:end]),
    }
    read_damaged(mutated_zip(path.read_bytes(), members), imported, path, count)


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
    found = onnx.ModelProto.FromString(model.SerializeToString())
    graph = found.graph
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
            draw(st.sampled_from(list(value.shape.dim))).dim_value = draw(
                st.sampled_from((0, -1, 1, 3, 2**40))
            )
    elif how == "card":
        (entry,) = [one for one in found.metadata_props if one.key == CARD]
        entry.value = draw(mutated_json(json.loads(entry.value))).decode("utf-8", "ignore")
    elif node.attribute:
        attribute = draw(st.sampled_from(list(node.attribute)))
        attribute.i = draw(st.sampled_from((0, -1, 2**40)))
        attribute.ints[:] = [draw(st.sampled_from((0, -1, 2**40)))] * len(attribute.ints)
    return found.SerializeToString()


@FEW_AND_MANY
def test_a_damaged_onnx_file_is_named(count: int, model: onnx.ModelProto, tmp_path: Path) -> None:
    whole = model.SerializeToString()
    damaged = mutated_bytes(whole) | mutated_graphs(model)
    read_damaged(damaged, driven, tmp_path / "x.onnx", count)


def test_metadata_that_are_not_utf8_are_named(model: onnx.ModelProto, tmp_path: Path) -> None:
    whole = model.SerializeToString()
    (tmp_path / "x.onnx").write_bytes(whole.replace(b'"format"', b'"f\xffrmat"'))
    with pytest.raises(InputError, match=r"x\.onnx: .*metadata"):
        OnnxPolicy(tmp_path / "x.onnx")


@given(mutated_bytes(b"---\nlicense: mit\n---\n| `x.ckpt` | SHA-256 `" + b"0" * 64 + b"` |\n"))
def test_a_damaged_card_of_the_hub_has_a_hash_or_none(data: bytes) -> None:
    found = described_hash(data.decode(errors="replace"))
    assert found is None or len(found) == 64
