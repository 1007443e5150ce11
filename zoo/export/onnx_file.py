"""A checkpoint as an ONNX file, compared with the checkpoint."""

import importlib.util
import io
import json
import math
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from zoo.base.errors import InputError
from zoo.base.rig import CURVATURE
from zoo.base.terminal import print_written
from zoo.base.whole_file import output_path
from zoo.base.written_files import checked_file
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.checkpoints.onnx_policy import (
    CARD,
    IMAGES,
    INSTALL,
    NEXT,
    SPEED,
    STATE,
    SUFFIX,
    OnnxPolicy,
    is_onnx,
)
from zoo.cli.console_progress import loading
from zoo.verdict.evidence import next_drive

# torch, a slow import, comes late: --help and typos answer at once.
if TYPE_CHECKING:
    import torch

    from zoo.checkpoints.checkpoint import Checkpoint
    from zoo.export.parity import Parity

# PyTorch from 2.4 writes this version, and onnxruntime from 1.14 runs it.
OPSET = 17
CONTROLS = "controls"
# Largest difference of steering and throttle (-1..1): the last digit sent to a simulator.
TOLERANCE = 1e-4
# The same where Keras computes the view, which is not rounded to whole numbers.
ROUNDED_TOLERANCE = 0.02
DONKEYCAR_SUFFIX = ".h5"

# The view's words for other programs: colours by OpenCV's conversion, and ways to resize.
COLOURS = {
    "rgb": "RGB",
    "bgr": "BGR",
    "yuv": "YUV (OpenCV's RGB2YUV)",
    "yuv_old": "YUV with red and blue exchanged (OpenCV's BGR2YUV of an RGB image)",
    "hsv": "HSV (OpenCV's RGB2HSV, hue 0..179)",
    "gray": "gray",
    "hsv_s": "the saturation of HSV (OpenCV's RGB2HSV)",
}
WAYS = {
    "area": "area (OpenCV's INTER_AREA)",
    "linear": "bilinear (OpenCV's INTER_LINEAR)",
    "blur_linear": "bilinear (OpenCV's INTER_LINEAR) after a blur (GaussianBlur, 3 x 3 pixels)",
}


def export_checkpoint(
    checkpoint_path: str, file: str, recording: str | None, console: Console
) -> Path:
    """Export a checkpoint, print the comparison with it, and return the file's path.

    Args:
        checkpoint_path: checkpoint as users name it.
        file: ONNX file to write.
        recording: recording whose frames are compared; None for the training's.
        console: console to print on.

    Raises:
        InputError: the checkpoint or recording does not exist, a package is not installed, the
            file cannot be written, or it steers differently from the checkpoint.
    """
    path = find_checkpoint(checkpoint_path)
    out = _checked_out(path, file)
    with loading():
        from zoo.checkpoints.checkpoint import load_checkpoint
        from zoo.checkpoints.policy import CheckpointPolicy
        from zoo.export.donkeycar_file import donkeycar_bytes, donkeycar_policy, whole_view
        from zoo.export.parity import compare, take_frames

        checkpoint = load_checkpoint(path)
        frames = take_frames(recording, checkpoint.config)
        of_donkeycar = out.suffix == DONKEYCAR_SUFFIX
        contents, model_type = b"", ""
        if of_donkeycar and CURVATURE in checkpoint.data:
            raise InputError(
                f"{path}: Donkeycar cannot convert its curvature to steering; train with "
                "data.label=steering, or name a file that ends in .onnx"
            )
        if of_donkeycar:
            contents, model_type = donkeycar_bytes(checkpoint)
            whole = whole_view(checkpoint.view)
            frames = replace(frames, frames=[whole(frame) for frame in frames.frames])
        else:
            contents = onnx_bytes(checkpoint)
    exact = not (of_donkeycar and (checkpoint.view.size or checkpoint.view.colour != "rgb"))
    allowed = TOLERANCE if exact else ROUNDED_TOLERANCE
    with output_path(out, inputs=[path]) as part:
        part.write_bytes(contents)
        exported = donkeycar_policy(checkpoint, part) if of_donkeycar else OnnxPolicy(part)
        # The outputs are compared as they are, before a curvature becomes a car's steering.
        exported.data = checkpoint.data | {CURVATURE: None}
        policy = CheckpointPolicy(replace(checkpoint, data=exported.data))
        parity = compare(policy, exported, frames)
        _check_parity(path, parity, allowed)
    height, width, _ = checkpoint.view.shape
    kind = "Keras 2" if of_donkeycar else f"opset {OPSET}"
    lines = [
        f"{out}: {exported.name} of {exported.parameters:,} parameters, sees {width} x {height} "
        f"{checkpoint.view.colour}, {len(contents) / 1e3:,.0f} kB, {kind}",
        f"largest difference from the checkpoint {parity.difference:.1e} ({allowed:g} allowed), "
        f"over {len(frames.frames)} frames {frames.source}",
    ]
    if of_donkeycar:
        rows, columns = checkpoint.view.frame
        lines.append(
            f"in Donkeycar: IMAGE_W = {columns} and IMAGE_H = {rows} in myconfig.py; python "
            f"manage.py drive --model {out} --type {model_type}"
        )
    else:
        lines.append(
            f"a frame takes {parity.checkpoint_ms:.2f} ms with PyTorch, {parity.onnx_ms:.2f} ms "
            "with onnxruntime, on one thread (median)"
        )
    for line in lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    following = next_drive(out, checkpoint.data, ["drive", out])
    print_written([out], [] if of_donkeycar else following, console)
    return out


def onnx_bytes(checkpoint: "Checkpoint") -> bytes:
    """Return a checkpoint's network and card as an ONNX file with a variable batch size.

    Raises:
        InputError: the network has an operation that ONNX lacks.
    """
    import onnx  # optional, see INSTALL
    import torch

    from zoo.checkpoints.checkpoint import make_card
    from zoo.models.memory import Memory, Step

    network, view = checkpoint.network, checkpoint.view
    height, width, channels = view.shape
    card = make_card(checkpoint.config, view, checkpoint.data) | {
        "network": type(network).__name__,
        "parameters": sum(one.numel() for one in network.parameters()),
        "predicts_spread": getattr(network, "predicts_spread", False),
    }
    # A batch of two: the exporter takes a size of one for a constant.
    inputs = {IMAGES: torch.zeros((2, channels, height, width), dtype=torch.uint8)}
    if network.takes_speed:
        inputs[SPEED] = torch.zeros(2)
    if isinstance(network, Memory):
        card["window"] = vars(network.window)
        states = enumerate(network.first_state(2))
        inputs |= {f"{STATE}{number}": state for number, state in states}
        network = Step(network)
    model = onnx.load_from_string(_graph_bytes(network, inputs))
    onnx.helper.set_model_props(model, {CARD: json.dumps(card)})
    model.doc_string = _how_to_feed(checkpoint)
    onnx.checker.check_model(model)
    return model.SerializeToString()


def _how_to_feed(checkpoint: "Checkpoint") -> str:
    """Describe inputs and outputs for other programs that run the file."""
    from zoo.models.memory import Memory

    network, view = checkpoint.network, checkpoint.view
    height, width, channels = view.shape
    colour, way = COLOURS[view.colour], view.resize.removesuffix("_first")
    steps = [f"in {colour}", f"resized by {WAYS[way]}"] if view.size else [f"in {colour}"]
    steps = steps[::-1] if view.resize.endswith("_first") else steps
    speed = f", and {SPEED}: mph, float32 [batch]" if network.takes_speed else ""
    throttle = " and throttle" if network.outputs > 1 else ""
    memory = isinstance(network, Memory)
    state = f", and {STATE}...: 0 at a start, then the {NEXT}... of the frame before"
    rows = ", for now and each step ahead" if memory and network.ahead else ""
    spread = ", and the logarithm of the steering's standard deviation"
    spread = spread if getattr(network, "predicts_spread", False) else ""
    scale = checkpoint.data.get(CURVATURE)
    steering = f"curvature of the path in {scale:.6g} 1/m, right positive" if scale else "steering"
    return (
        f"{IMAGES}: uint8 [batch, {channels}, {height}, {width}], less "
        f"{view.crop_text}, {', then '.join(steps)}"
        f"{speed}{state * memory} -> {CONTROLS}: {steering}{throttle}{rows}, float32, to be "
        f"clipped to -1..1{spread}"
    )


def _graph_bytes(network: "torch.nn.Module", inputs: "dict[str, torch.Tensor]") -> bytes:
    import torch
    from torch.onnx.errors import OnnxExporterError

    from zoo.checkpoints.frozen_graph import quiet_tracing

    buffer = io.BytesIO()
    outputs = [CONTROLS, *(name.replace(STATE, NEXT) for name in inputs if name.startswith(STATE))]
    try:
        with quiet_tracing(), warnings.catch_warnings():
            # Ignored: this exporter is deprecated, and sizes computed in Python become constants,
            # as they should. PyTorch 2.4 to 2.14 has it; the new one needs PyTorch 2.5 and
            # onnxscript, and takes 4 s instead of 0.1 s.
            warnings.simplefilter("ignore", DeprecationWarning)
            # Of unequal padding; the exported file is compared with the network.
            warnings.filterwarnings("ignore", message="Constant folding", category=UserWarning)
            torch.onnx.export(
                network,
                tuple(inputs.values()),
                buffer,
                input_names=list(inputs),
                output_names=outputs,
                dynamic_axes={name: {0: "batch"} for name in (*inputs, *outputs)},
                opset_version=OPSET,
                dynamo=False,
            )
    except OnnxExporterError as error:
        reason = str(error).splitlines()[0]
        name = type(network).__name__
        raise InputError(f"{name} cannot be written as ONNX ({reason})") from None
    return buffer.getvalue()


def _checked_out(path: Path, name: str) -> Path:
    """Return the path to write; report wrong arguments before torch is imported."""
    if is_onnx(path):
        raise InputError(f"{path}: is ONNX already; name the checkpoint")
    out = checked_file(name, (SUFFIX, DONKEYCAR_SUFFIX), inputs=[path], into_folder=True)
    needed, install = ["onnx", "onnxruntime"], INSTALL
    if out.suffix == DONKEYCAR_SUFFIX:
        needed, install = ["h5py"], "pip install h5py"
    missing = [one for one in needed if importlib.util.find_spec(one) is None]
    if missing:
        raise InputError(f"exporting needs {' and '.join(missing)}: {install}")
    return out


def _check_parity(path: Path, parity: "Parity", allowed: float) -> None:
    if not math.isfinite(parity.difference):
        raise InputError(
            f"{path}: steers NaN because its training diverged; nothing was written: train again "
            "with a smaller optim.lr"
        )
    if parity.difference > allowed:
        raise InputError(
            f"{path}: the file differs by {parity.difference:.2g} from the checkpoint, more "
            f"than {allowed:g}; nothing was written: try another version of onnxruntime"
        )
