"""Checkpoints exported as C: the same view and steering, no warning, a line for each refusal."""

import ctypes
import math
import platform
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console
from torch import nn

from datamodules.view import CONVERSIONS, RESIZES, View
from tests.recordings import Written, write_resized
from tests.zoo.command_runs import only_line, run_here, succeed
from tests.zoo.written_checkpoints import checkpoint_of, write_constant
from zoo.base.compose import choices
from zoo.base.errors import InputError, UsageError
from zoo.base.rig import CURVATURE
from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.extras.car import compiled_policy
from zoo.extras.car.c_file import c_header, c_source, rounded
from zoo.extras.car.c_source import CSource, function_name
from zoo.extras.car.c_view import write_view
from zoo.extras.car.compiled_policy import CompiledPolicy, find_compiler
from zoo.models.layers import Normalize
from zoo.scoring.checked_export import export_checkpoint
from zoo.scoring.parity import Frames, compare

COMPILER = find_compiler()
STRICT = ("-std=c99", "-O1", "-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror")
pytestmark = pytest.mark.skipif(not COMPILER, reason="no C compiler")


def drawn_frames(size: tuple[int, int], count: int = 3) -> list[np.ndarray]:
    """Return frames of noise, and one of few colours, uint8 [H, W, 3]."""
    rng = np.random.default_rng(0)
    frames = [rng.integers(0, 256, (*size, 3), np.uint8) for _ in range(count)]
    return [*frames, np.where(frames[0] > 127, 255, 0).astype(np.uint8)]


def compiled(checkpoint: Checkpoint, folder: Path, weights: str = "float") -> CompiledPolicy:
    """Write a checkpoint as C and compile it without warnings."""
    (folder / "steer.c").write_text(c_source(checkpoint, "steer", weights))
    (folder / "steer.h").write_text(c_header(checkpoint, "steer", "# card"))
    return CompiledPolicy(checkpoint, folder / "steer.c", STRICT)


def difference(checkpoint: Checkpoint, folder: Path, weights: str = "float") -> float:
    """Return the largest difference of steering and throttle from the checkpoint's."""
    images = drawn_frames(checkpoint.view.frame)
    frames = Frames(images, [3.0 * number for number in range(len(images))], "drawn")
    policy = CheckpointPolicy(checkpoint)
    assert np.std([policy(image, 9.0).steering for image in images]) > 0
    return compare(policy, compiled(checkpoint, folder, weights), frames).difference


def whole(network: nn.Module, view: View) -> Checkpoint:
    return Checkpoint(network.eval(), view, {}, {})


CASES = [
    *((colour, "area", (160, 320)) for colour in CONVERSIONS),
    *(("yuv_old", resize, (160, 320)) for resize in RESIZES),
    ("gray", "area", (121, 163)),
    ("hsv", "linear_first", (50, 70)),  # enlarged
    ("rgb", "area", (50, 70)),
]


@pytest.mark.parametrize(("colour", "resize", "frame"), CASES)
def test_a_view_is_opencvs_exactly(colour: str, resize: str, frame: tuple, tmp_path: Path) -> None:
    for number, (crop, size) in enumerate([((60, 40), (33, 64)), ((0, 0), (80, 160))]):
        view, source = View(crop, colour, size, resize, frame), CSource(floats=1)
        write_view(view, source)
        function = "void seen(const uint8_t *rgb, float *out)"
        body = f"{function};\n{function}\n{{\n(void)work; view(rgb, out);\n}}"
        file, library = tmp_path / "view.c", tmp_path / f"view{number}.so"
        file.write_text(source.text("#include <stdint.h>", body))
        words = [str(COMPILER), *STRICT, "-shared", "-fPIC", str(file), "-o", str(library)]
        subprocess.run(words, check=True)
        seen = ctypes.CDLL(str(library)).seen
        out = np.zeros(view.shape, np.float32)
        for image in drawn_frames(frame, 2):
            seen(ctypes.c_void_p(image.ctypes.data), ctypes.c_void_p(out.ctypes.data))
            # On ARM, OpenCV multiplies and adds in one step.
            exact = platform.machine() in ("x86_64", "AMD64")
            assert np.abs(out - view(image)).max() <= (0 if exact else 1)


@pytest.mark.parametrize(
    "keys",
    [
        ["linear"],
        ["tiny"],
        ["tiny63"],
        ["lenet", "model.width=0.5"],
        ["nvidia", "model.width=0.25"],
        ["nvidia", "model.width=0.25", "model.activation=relu", "model.colour=gray"],
        ["nvidia_speed", "model.width=0.25"],
        *[[name] for name in choices("model") if name == "keras"],  # of an extra
    ],
)
def test_a_network_steers_as_its_checkpoint(keys: list[str], tmp_path: Path) -> None:
    # A sum of 153,600 pixels differs by more than one of a few.
    assert difference(checkpoint_of(*keys), tmp_path) < (1e-5 if keys == ["keras"] else 1e-6)


class Various(nn.Sequential):
    """Layers that no network of the list has."""

    takes_speed, outputs = False, 1


def test_other_layers_are_exact_too(tmp_path: Path) -> None:
    torch.manual_seed(0)
    layers = [
        Normalize(),
        nn.Conv2d(3, 5, 3, padding=(2, 1), dilation=2, stride=(1, 2)),
        nn.BatchNorm2d(5),
        nn.Conv2d(5, 5, (4, 3), padding="same", dilation=(1, 2)),
        nn.Tanh(),
        nn.AvgPool2d(2, padding=1),
        nn.Conv2d(5, 9, (1, 3), bias=False),
        nn.LeakyReLU(0.2),
        nn.BatchNorm2d(9),  # no convolution is before it
        nn.MaxPool2d(3, stride=1, padding=1),
        nn.Sigmoid(),
        nn.AdaptiveAvgPool2d(1),
        nn.Flatten(),
        nn.Linear(9, 2, bias=False),
        nn.Sigmoid(),
        nn.BatchNorm1d(2),
        nn.Linear(2, 1),
    ]
    for layer in layers:
        if hasattr(layer, "running_mean"):
            layer.running_mean += 0.3
            layer.running_var *= 0.7
    view = View((0, 0), "rgb", (20, 30), frame=(40, 60))
    assert difference(whole(Various(*layers), view), tmp_path) < 1e-6


def test_no_result_stands_where_a_copied_image_is_read(tmp_path: Path) -> None:
    torch.manual_seed(0)
    convolutions = nn.Conv2d(48, 5, 3), nn.Tanh(), nn.Conv2d(5, 4, 3), nn.Flatten()
    layers = Normalize(), nn.PixelUnshuffle(4), *convolutions, nn.Linear(4 * 6 * 11, 1)
    view = View((0, 0), "rgb", None, frame=(40, 60))
    assert difference(whole(Various(*layers), view), tmp_path) < 1e-6


@pytest.mark.parametrize("name", ["tiny", "lenet"])
def test_weights_of_8_bits_steer_as_the_rounded_network(name: str, tmp_path: Path) -> None:
    checkpoint = checkpoint_of(name)
    small = rounded(checkpoint)
    assert difference(small, tmp_path, "int8") < 1e-6
    for full, byte in zip(checkpoint.network.parameters(), small.network.parameters(), strict=True):
        assert (full - byte).abs().max() <= full.abs().max() / 254 * 1.001
    assert "int8_t weights_" in (tmp_path / "steer.c").read_text()


@pytest.mark.parametrize("compilers", [compiled_policy.COMPILERS, ()])
def test_8_bits_that_steer_differently_are_not_written(
    compilers: tuple, recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    contents = torch.load(find_checkpoint("lenet"), weights_only=True)
    tensors = contents["state_dict"]
    tensors["network.head.3.weight"][0] = 0  # an output that is always 0,
    tensors["network.head.3.bias"][0] = 0
    tensors["network.head.6.weight"][0, 0] = 100  # beside whose weight 8 bits hold no other
    torch.save(contents, tmp_path / "wide.ckpt")
    monkeypatch.setattr(compiled_policy, "COMPILERS", compilers)
    files = (str(tmp_path / "wide.ckpt"), str(tmp_path / "steer.c"), str(recorded.folder))
    with pytest.raises(InputError, match=r"more than 0\.1; nothing .*: leave weights=int8"):
        export_checkpoint(*files, Console(quiet=True), weights="int8")
    assert not (tmp_path / "steer.c").exists()


def test_a_frame_of_another_size_is_nan(tmp_path: Path) -> None:
    policy = compiled(load_checkpoint("tiny41"), tmp_path)
    assert math.isnan(policy._steer(None, 320, 160, 9.0))
    with pytest.raises(InputError, match=r"160 x 120 pixels.* 320 x 160"):
        policy(np.zeros((120, 160, 3), np.uint8), 9.0)
    assert math.isfinite(policy(np.zeros((160, 320, 3), np.uint8), 9.0).steering)


def test_a_steering_of_nan_has_no_throttle_of_the_frame_before(tmp_path: Path) -> None:
    policy = compiled(checkpoint_of("nvidia_speed", "model.width=0.1"), tmp_path)
    frame = np.zeros((160, 320, 3), np.uint8)
    assert math.isfinite(policy(frame, 9.0).throttle)
    assert math.isnan(policy(frame, math.nan).throttle)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (["commaai", "model.width=0.1"], r"CommaAi: its layer .* computes Pad"),
        (["cnn_gru"], "keeps earlier frames"),
        (["nvidia_gaussian"], "spread"),
    ],
)
def test_what_c_cannot_have_is_named(keys: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        c_source(checkpoint_of(*keys), "steer", "float")


def test_a_layer_is_named_as_in_the_state_dict() -> None:
    network = Various(Normalize(), nn.Conv2d(3, 4, 3, groups=1), nn.GELU(), nn.Flatten())
    with pytest.raises(InputError, match=r"its layer 2 computes Erf"):
        c_source(whole(network, View((0, 0), "rgb", (8, 8))), "steer", "float")


@pytest.mark.parametrize(
    "name",
    ["int.c", "1net.c", "my net.c", "view.c", "läufer.c", "Frame.c", "row_at.c", "weights_5.c"]
    + ["NULL.c", "_Bool.c", "INT32_C.c"],
)
def test_a_name_that_c_refuses_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match=r"steer\.c"):
        function_name(Path(name))


@pytest.mark.parametrize("name", ["steer", "street", "memory", "timer", "printf_1", "int_1"])
def test_a_name_like_one_of_c_is_taken(name: str) -> None:
    assert function_name(Path(f"{name}.c")) == name


def test_a_card_cannot_leave_its_comment(tmp_path: Path) -> None:
    checkpoint = load_checkpoint("tiny41")
    card = "a */ int evil; *\x01/ int evil; /* b\n*\\\n/ int evil;\n??/\n\x00\x1b é *\\/ int evil;"
    (tmp_path / "steer.h").write_text(c_header(checkpoint, "steer", card))
    words = [str(COMPILER), "-E", "-P", *STRICT, str(tmp_path / "steer.h")]
    code = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert "evil" not in code
    assert "float steer(" in code


def test_the_command_writes_both_files_with_the_card(recorded: Written, tmp_path: Path) -> None:
    small = write_resized(recorded, tmp_path / "of another size", 160, 120)
    words = ("tiny41", "to=c", "weights=int8", f"frames={small.folder}")
    printed = succeed(run_here(tmp_path, *words, module="zoo.commands.export"))
    for part in ("wrote: steer.h", "wrote: steer.c", "8 bits", "steer(rgb, 320, 160, speed_mph)"):
        assert part in printed
    header = (tmp_path / "steer.h").read_text()
    for part in ("41 parameters", "negative is left", "25 degrees", "3 of 3 laps", "8 bits"):
        assert part in header
    assert "Latency: a frame takes" in header


def test_a_compiler_may_print_any_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler = tmp_path / "cc"
    compiler.write_text("#!/bin/sh\nprintf 'ung\\201ltig' >&2\nexit 1\n")
    compiler.chmod(0o700)
    monkeypatch.setattr(compiled_policy, "COMPILERS", (str(compiler),))
    with pytest.raises(InputError, match=r"refuses it .ung.ltig"):
        CompiledPolicy(load_checkpoint("tiny41"), tmp_path / "steer.c")


def test_without_a_compiler_it_says_that_nothing_was_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(compiled_policy, "COMPILERS", ())
    drawn = Frames(drawn_frames((160, 320)), [0.0] * 4, str(tmp_path / "nowhere"))
    monkeypatch.setattr("zoo.scoring.parity.take_frames", lambda *_: drawn)
    export_checkpoint("tiny41", str(tmp_path / "steer.c"), None, Console(), to="c")
    assert "not compared" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["to=c", "out=model.onnx"], "must end in .c"),
        (["to=donkeycar", "out=steer.c"], "must end in .h5"),
    ],
)
def test_a_name_of_another_kind_is_refused(words: list[str], text: str, tmp_path: Path) -> None:
    path = str(write_constant(tmp_path / "constant.ckpt", 0.1))
    assert text in only_line(run_here(tmp_path, path, *words, module="zoo.commands.export"))


def test_a_curvature_is_not_written_as_steering(tmp_path: Path) -> None:
    path = write_constant(tmp_path / "constant.ckpt", 0.1)
    contents = torch.load(path, weights_only=True)
    contents["drivezoo"]["data"][CURVATURE] = 0.1
    torch.save(contents, path)
    with pytest.raises(InputError, match=r"data\.label=steering"):
        export_checkpoint(str(path), str(tmp_path / "steer.c"), None, Console(quiet=True))
