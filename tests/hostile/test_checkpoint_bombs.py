"""Files of networks that ask for far more than they hold, or are replaced while they are read."""

import io
import os
import re
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from tests.hostile import crafted_files as crafted
from tests.refusals import refusal
from tests.slow_members import slow
from tests.zoo.bomb import Bomb
from tests.zoo.command_runs import only_line, run
from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint, load_plain
from zoo.checkpoints.onnx_policy import ELSEWHERE, open_session


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_constant(tmp_path / "x.ckpt", 0.1)


@pytest.mark.parametrize("name", ["export", "evaluate", *slow("doctor")])
def test_lists_that_share_their_parts_are_not_expanded(name: str, path: Path) -> None:
    contents = crafted.contents_of(path)
    contents["drivezoo"]["config"]["data"] = crafted.shared_lists(40)
    torch.save(contents, path)
    result = run(path.parent, str(path), module=f"zoo.commands.{name}", timeout=60)
    printed = " ".join((result.stdout + result.stderr).split())
    assert "Traceback" not in printed
    assert "x.ckpt: is damaged" in printed
    assert "1,000,000 values" in printed
    assert result.returncode == 1


@pytest.mark.parametrize(
    ("pickle", "words"),
    [
        (crafted.deep_pickle(5000), "64 levels"),
        (crafted.many_lists(1_900_000), "steps"),
        (crafted.shared_tuples_as_key(45), "values"),
        (crafted.calls_bytearray(8_000_000_000), "code"),
    ],
    ids=["deep", "many", "hash", "bytearray"],
)
def test_a_crafted_pickle_is_refused(pickle: bytes, words: str, path: Path) -> None:
    with pytest.raises(InputError, match=rf"x\.ckpt: .*{words}"):
        load_plain(crafted.with_pickle(path, pickle))


@pytest.mark.parametrize(
    "pickle", [crafted.shared_tuples_as_key(45), crafted.calls_bytearray(8_000_000_000)]
)
def test_a_crafted_pickle_of_an_old_torch_file_is_refused(pickle: bytes, tmp_path: Path) -> None:
    torch.save({}, tmp_path / "old.pth", _use_new_zipfile_serialization=False)
    whole = (tmp_path / "old.pth").read_bytes()
    (tmp_path / "old.pth").write_bytes(whole[: whole.index(b"}q\x00.")] + pickle)
    assert "old.pth: " in refusal(load_plain, tmp_path / "old.pth")


def test_an_old_torch_file_is_read(tmp_path: Path) -> None:
    state = {"a": torch.arange(3.0), "b": torch.nn.Parameter(torch.ones(2))}
    torch.save(state, tmp_path / "old.pth", _use_new_zipfile_serialization=False)
    assert load_plain(tmp_path / "old.pth")["a"].tolist() == [0, 1, 2]


def test_deflated_members_are_not_unpacked(path: Path) -> None:
    crafted.rezip(path, {"data/0": bytes(100_000_000)}, zipfile.ZIP_DEFLATED)
    assert path.stat().st_size < 200_000
    tracemalloc.start()
    with pytest.raises(InputError, match=r"x\.ckpt: claims 100,0\d\d,\d+ bytes"):
        load_plain(path)
    assert tracemalloc.get_traced_memory()[1] < 20_000_000
    tracemalloc.stop()


def test_a_checkpoint_that_was_packed_again_is_read(path: Path) -> None:
    crafted.rezip(path, {}, zipfile.ZIP_DEFLATED)
    load_checkpoint(path)


def test_an_archives_long_list_of_members_is_not_read(tmp_path: Path) -> None:
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        archive.writestr("x/data.pkl", b"")
    data = bytearray(written.getvalue())
    at = data.rindex(b"PK\5\6") + 12
    data[at : at + 4] = (4_000_001).to_bytes(4, "little")
    (tmp_path / "x.ckpt").write_bytes(data)
    assert "x.ckpt: has 4,000,001 bytes of an index" in refusal(load_plain, tmp_path / "x.ckpt")


def test_tensors_that_repeat_one_number_count_whole(path: Path) -> None:
    contents = crafted.contents_of(path)
    contents["state_dict"]["network.x"] = torch.zeros(1).expand(100_000_000)
    torch.save(contents, path)
    with pytest.raises(InputError, match=r"x\.ckpt: claims 400,000,\d+ bytes"):
        load_plain(path)


def test_weights_of_eight_bits_are_named(path: Path) -> None:
    contents = crafted.contents_of(path)
    for name, weight in contents["state_dict"].items():
        contents["state_dict"][name] = weight.to(torch.float8_e4m3fn)
    torch.save(contents, path)
    line = only_line(run(path.parent, str(path), module="zoo.commands.export", timeout=60))
    assert "x.ckpt: head.weight does not hold plain floats" in line


@pytest.mark.parametrize("value", [[0] * 1000, torch.zeros(3, 4), 10**400])
def test_an_odd_format_is_one_short_line(value: object, path: Path) -> None:
    contents = crafted.contents_of(path)
    contents["drivezoo"]["format"] = value
    torch.save(contents, path)
    line = refusal(load_checkpoint, path)
    assert re.search(r"x\.ckpt: has format version .{1,40}, this drivezoo reads 1", line)


def swapping(monkeypatch: pytest.MonkeyPatch, module: object, name: str, path: Path) -> None:
    """Replace the file at `path` whenever a function is called, before it runs."""
    original = getattr(module, name)

    def swap(*arguments: object) -> object:
        os.replace(path.with_name("other"), path)  # noqa: PTH105 - a single system call
        return original(*arguments)

    monkeypatch.setattr(module, name, swap)


@pytest.mark.parametrize("other", ["checkpoint", "code", "pipe"])
def test_a_file_is_as_checked(other: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "x.ckpt"
    torch.save({"a": 1}, path)
    if other == "pipe":
        os.mkfifo(tmp_path / "other")
    else:
        contents = {"a": 2} if other == "checkpoint" else Bomb(tmp_path / "ran")
        torch.save(contents, path.with_name("other"))
    swapping(monkeypatch, zipfile, "is_zipfile", path)
    assert load_plain(path) == {"a": 1}
    assert not (tmp_path / "ran").exists()


def adding(number: float, outside: str | None = None) -> bytes:
    """Return a model that adds a number, stored in the model or in another file."""
    weights = onnx.numpy_helper.from_array(np.full(400, number, np.float32), "w")
    if outside:
        onnx.external_data_helper.set_external_data(weights, outside, offset=0, length=1600)
        weights.ClearField("raw_data")
    make_value = onnx.helper.make_tensor_value_info
    x, y = (make_value(name, onnx.TensorProto.FLOAT, [400]) for name in "xy")
    node = onnx.helper.make_node("Add", ["x", "w"], ["y"])
    graph = onnx.helper.make_graph([node], "graph", [x], [y], [weights])
    opset = onnx.helper.make_opsetid("", 17)
    return onnx.helper.make_model(graph, opset_imports=[opset], ir_version=8).SerializeToString()


def added(session: onnxruntime.InferenceSession) -> float:
    return float(session.run(None, {"x": np.zeros(400, np.float32)})[0][0])


def test_an_onnx_file_runs_as_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "x.onnx"
    path.write_bytes(adding(1.0))
    path.with_name("other").write_bytes(adding(2.0))
    swapping(monkeypatch, onnxruntime, "SessionOptions", path)
    assert added(open_session(path, 1)) == 1.0


@pytest.mark.parametrize("other", ["w.bin", "../w.bin", "/ABSOLUTE/w.bin", "none.bin"])
def test_weights_in_another_file_are_not_read(other: str, here: Path) -> None:
    (here / "models").mkdir()
    for folder in (here, here / "models"):
        (folder / "w.bin").write_bytes(np.ones(400, np.float32).tobytes())
    path = here / "models" / "x.onnx"
    path.write_bytes(adding(1.0, other.replace("/ABSOLUTE", str(here))))
    assert "x.onnx: has weights in another file" in refusal(open_session, path, 1)


def test_a_file_in_onnxruntimes_own_format_is_refused(tmp_path: Path) -> None:
    options = onnxruntime.SessionOptions()
    options.optimized_model_filepath = str(tmp_path / "x.ort")
    options.add_session_config_entry("session.save_model_format", "ORT")
    onnxruntime.InferenceSession(adding(1.0), options, providers=["CPUExecutionProvider"])
    path = (tmp_path / "x.ort").rename(tmp_path / "x.onnx")
    assert b"ORTM" in path.read_bytes()[:16]
    assert "x.onnx: is damaged" in refusal(open_session, path, 1)


def test_weights_elsewhere_are_found_in_any_spelling_of_their_bytes() -> None:
    for spelling in (b"\x0a\x08", b"\x0a\x88\x00", b"\x8a\x80\x00\x88\x80\x00"):
        assert ELSEWHERE.search(b"x" + spelling + b"location")
    assert not ELSEWHERE.search(b'"the location"')
