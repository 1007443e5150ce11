"""Every command refuses an ONNX file that drivezoo did not write, in one line."""

import json
import re
import shutil
from pathlib import Path

import onnx
import pytest
import torch

from datamodules.image import read_image
from tests.recordings import Written
from tests.zoo.command_runs import ROOT, only_line, run
from tests.zoo.written_checkpoints import checkpoint_of
from zoo.base.errors import InputError
from zoo.checkpoints import onnx_policy
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.checkpoint_path import PACKAGED
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.checkpoints.onnx_policy import CARD, OnnxPolicy
from zoo.commands import evaluate


def write_foreign(path: Path, **metadata: str) -> Path:
    """Write another program's file, which returns its input."""
    of = [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1]) for name in "xy"]
    node = onnx.helper.make_node("Identity", ["x"], ["y"])
    opset = onnx.helper.make_opsetid("", 17)
    graph = onnx.helper.make_graph([node], "graph", [of[0]], [of[1]])
    model = onnx.helper.make_model(graph, opset_imports=[opset], ir_version=8)
    onnx.helper.set_model_props(model, metadata)
    onnx.save(model, path)
    return path


def test_the_manuals_own_lines_steer_as_the_checkpoint(
    recorded: Written, here: Path, capsys: pytest.CaptureFixture
) -> None:
    page = (ROOT / "docs" / "driving.md").read_text()
    (code,) = re.findall(r"```python\n(import cv2\nimport onnxruntime\n.*?)```", page, re.DOTALL)
    (here / "model.onnx").write_bytes(onnx_bytes(load_checkpoint(PACKAGED / "lenet.ckpt")))
    shutil.copy(recorded.image(3), here / "frame.jpg")
    exec(code, {})
    expected = load_policy("lenet")(read_image(here / "frame.jpg"), 15.0).steering
    assert float(capsys.readouterr().out.splitlines()[-1]) == pytest.approx(expected, abs=1e-4)


def test_another_programs_file_is_refused_in_one_line(tmp_path: Path) -> None:
    write_foreign(tmp_path / "theirs.onnx")
    line = only_line(run(tmp_path, "theirs.onnx", "drive.port=0", module="zoo.commands.drive"))
    assert "theirs.onnx: its drivezoo metadata cannot be used (there is none" in line
    with pytest.raises(InputError, match=r"theirs\.onnx: .*drivezoo export"):
        evaluate.evaluate_or_replay([str(tmp_path / "theirs.onnx"), f"out={tmp_path / 'out'}"])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("card", "words"),
    [
        ("{", "cannot be used"),
        ("[]", "cannot be used"),
        ("{}", "format"),
        ('{"format": 99}', "has format version 99"),
        ('{"format": 1, "view": {"crop": [999, 0], "colour": "rgb", "size": null}}', "crop"),
        ('{"format": 1, "view": {"crop": [9, 9], "colour": "rgb", "size": [6, 20]}}', "20 x 6 rgb"),
    ],
)
def test_metadata_that_do_not_fit_are_refused(card: str, words: str, tmp_path: Path) -> None:
    path = write_foreign(tmp_path / "odd.onnx", **{CARD: card})
    with pytest.raises(InputError) as error:
        load_policy(path)
    assert str(path) in str(error.value)
    assert words in str(error.value)


def test_a_damaged_file_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    whole = onnx_bytes(checkpoint_of("lenet"))
    scrambled = bytearray(whole)
    scrambled[:2000:7] = bytes(len(scrambled[:2000:7]))
    cuts = [whole[: len(whole) * tenth // 10] for tenth in range(10)]
    for number, contents in enumerate([*cuts, whole[:-1], bytes(scrambled), b"rubbish" * 999]):
        path = tmp_path / f"{number}.onnx"
        path.write_bytes(contents)
        with pytest.raises(InputError, match=rf"{number}\.onnx: is (damaged|empty)"):
            OnnxPolicy(path)
    assert capfd.readouterr().err == ""


# Operations that return `controls`, a number for each image, from its mean brightness `b`.
LOOP = """s = Loop (trips, {condition}, none) <body = again (int64 i, bool go, float x)
  => (bool same, float y) {{same = Identity (go)\n y = Identity (x)}}>
controls = Mul (b, s)"""
HARMFUL = {
    "loop": (LOOP.format(condition="always"), "has a loop"),
    "loop for bright images": (
        "lit = Less (half, b)\n if = Squeeze (lit)\n" + LOOP.format(condition="if"),
        "has a loop",
    ),
    "memory": (
        "d = ConstantOfShape (huge)\n e = ReduceMean <keepdims = 0> (d)\n controls = Mul (b, e)",
        "alloc",
    ),
    "another shape": ("controls = Reshape (b, huge)", "cannot be run"),
    "no row": ("controls = Slice (b, zero, zero)", r"array of \(0, 1\)"),
    "two rows": ("controls = Concat <axis = 0> (b, b)", r"array of \(2, 1\)"),
}


def write_harmful(path: Path, operations: str) -> Path:
    """Write a file with drivezoo's card whose network has other operations."""
    checkpoint = checkpoint_of("tiny")
    model = onnx.load_from_string(onnx_bytes(checkpoint))
    height, width, channels = checkpoint.view.shape
    graph = f"""g (uint8[batch, {channels}, {height}, {width}] images) => (float[batch, 1] controls)
        <int64[1] ones = {{1}}, int64 trips = {{4611686018427387904}}, bool always = {{1}},
        float none = {{0}}, float half = {{0.5}}, int64[1] zero = {{0}},
        int64[1] huge = {{750000000}}> {{
        f = Cast <to = 1> (images)
        m = ReduceMean <axes = [1, 2, 3], keepdims = 0> (f)
        b = Unsqueeze (m, ones)
        {operations}
    }}"""
    model.graph.CopyFrom(onnx.parser.parse_graph(graph))
    path.write_bytes(model.SerializeToString())
    return path


@pytest.mark.parametrize("harm", HARMFUL)
def test_a_network_that_does_harm_is_refused_in_one_line(harm: str, tmp_path: Path) -> None:
    operations, words = HARMFUL[harm]
    path = write_harmful(tmp_path / "harm.onnx", operations)
    with pytest.raises(InputError, match=rf"harm\.onnx: .*{words}"):
        load_policy(path)


def test_a_loop_is_found_in_any_spelling_of_its_bytes() -> None:
    for spelling in (b'"\x04Loop', b'"\x84\x00Loop', b"\xa2\x80\x00\x84\x80\x00Loop"):
        assert onnx_policy.LOOP.search(b"x" + spelling)
    assert not onnx_policy.LOOP.search(b'"the Loop"')


LIMITS = {
    "zoo.base.process_pool.READ_S": (0, "does not end within 0 s"),
    # Where the system sets no limit, as on macOS and Windows.
    "zoo.base.process_pool.ProcessPool.used_bytes": (lambda _: 2e9, "takes more than 1,000 MB"),
}


@pytest.mark.parametrize("name", LIMITS)
def test_a_file_is_read_within_its_limits(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.onnx").write_bytes(onnx_bytes(checkpoint_of("tiny")))
    assert load_policy(tmp_path / "a.onnx").outputs == 1
    value, words = LIMITS[name]
    monkeypatch.setattr(name, value)
    monkeypatch.setattr("zoo.base.process_pool.LOOK_S", 0.001)
    with pytest.raises(InputError, match=rf"a\.onnx: is damaged.* {words}"):
        load_policy(tmp_path / "a.onnx")


def test_a_folder_and_nothing_are_refused(tmp_path: Path) -> None:
    (tmp_path / "folder.onnx").mkdir()
    for name, words in (("folder", "is a folder"), ("none", "no such file")):
        with pytest.raises(InputError, match=rf"{name}\.onnx: {words}"):
            load_policy(tmp_path / f"{name}.onnx")


def test_a_file_that_steers_nan_is_refused(tmp_path: Path) -> None:
    checkpoint = checkpoint_of("lenet")
    with torch.no_grad():
        checkpoint.network.head[-1].bias[:] = float("nan")
    (tmp_path / "nan.onnx").write_bytes(onnx_bytes(checkpoint))
    with pytest.raises(InputError, match=r"nan\.onnx: returns NaN.*optim\.lr"):
        load_policy(tmp_path / "nan.onnx")


@pytest.fixture(scope="module")
def remembering() -> onnx.ModelProto:
    checkpoint = checkpoint_of("cnn_gru", "model.width=0.1", "model.neurons=3")
    return onnx.load_from_string(onnx_bytes(checkpoint))


@pytest.mark.parametrize(
    ("window", "words"),
    [
        ({"sequence": 8, "stride": 0}, r"stride=0.* from 1 to 256"),
        ({"sequence": 8, "stride": 257}, r"stride=257.* from 1 to 256"),
        ({"sequence": 8, "ahead": 2}, "does not take its view"),
        ({"frames": 8}, "frames"),
        ([8], "cannot be used"),
        (None, "does not take its view"),
    ],
)
def test_a_window_that_does_not_fit_the_graph_is_refused(
    window: object, words: str, remembering: onnx.ModelProto, tmp_path: Path
) -> None:
    card = json.loads(remembering.metadata_props[0].value) | {"window": window}
    model = onnx.ModelProto.FromString(remembering.SerializeToString())
    onnx.helper.set_model_props(model, {CARD: json.dumps(card)})
    onnx.save(model, tmp_path / "odd.onnx")
    with pytest.raises(InputError, match=rf"odd\.onnx: .*{words}"):
        load_policy(tmp_path / "odd.onnx")


def test_a_state_that_is_not_returned_is_refused(
    remembering: onnx.ModelProto, tmp_path: Path
) -> None:
    model = onnx.ModelProto.FromString(remembering.SerializeToString())
    (state,) = [output for output in model.graph.output if output.name == "next_0"]
    model.graph.output.remove(state)
    onnx.save(model, tmp_path / "odd.onnx")
    with pytest.raises(InputError, match=r"odd\.onnx: .*the state that it takes"):
        load_policy(tmp_path / "odd.onnx")
