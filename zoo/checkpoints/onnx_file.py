"""A checkpoint's network as an ONNX graph, and as a file for onnxruntime."""

import io
import json
import warnings
from typing import TYPE_CHECKING

from zoo.base.errors import InputError
from zoo.base.rig import CURVATURE
from zoo.checkpoints.onnx_policy import CARD, IMAGES, NEXT, SPEED, STATE

# torch, a slow import, comes late: --help and typos answer at once.
if TYPE_CHECKING:
    from zoo.checkpoints.checkpoint import Checkpoint

# PyTorch from 2.4 writes this version, and onnxruntime from 1.14 runs it.
OPSET = 17
CONTROLS = "controls"
MODEL_CARD = "model_card"  # key in the metadata; the value is Markdown

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


def onnx_bytes(checkpoint: "Checkpoint", model_card: str = "", graph: bytes = b"") -> bytes:
    """Return a checkpoint's network and card as an ONNX file with a variable batch size.

    Args:
        checkpoint: checkpoint.
        model_card: text for people, see `zoo.scoring.model_card`; empty for none.
        graph: ONNX file without a card; empty: `graph_bytes` writes it.

    Raises:
        InputError: the network has an operation that ONNX lacks.
    """
    import onnx  # optional, see INSTALL

    from zoo.checkpoints.checkpoint import make_card
    from zoo.checkpoints.new_checkpoint import without_private
    from zoo.models.network_facts import facts_of

    network, view = checkpoint.network, checkpoint.view
    facts = facts_of(network)
    card = make_card(without_private(checkpoint.config), view, without_private(checkpoint.data)) | {
        "network": type(network).__name__,
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
        "predicts_spread": facts.predicts_spread,
    }
    if facts.window:
        card["window"] = vars(facts.window)
    model = onnx.load_from_string(graph or graph_bytes(checkpoint))
    texts = {CARD: json.dumps(card)} | ({MODEL_CARD: model_card} if model_card else {})
    onnx.helper.set_model_props(model, texts)
    model.doc_string = _how_to_feed(checkpoint, [item.name for item in model.graph.input])
    onnx.checker.check_model(model)
    return model.SerializeToString()


def _how_to_feed(checkpoint: "Checkpoint", inputs: list[str]) -> str:
    """Describe inputs and outputs for other programs that run the file."""
    from zoo.models.network_facts import facts_of

    facts, view = facts_of(checkpoint.network), checkpoint.view
    height, width, channels = view.shape
    colour, way = COLOURS[view.colour], view.resize.removesuffix("_first")
    steps = [f"in {colour}", f"resized by {WAYS[way]}"] if view.size else [f"in {colour}"]
    steps = steps[::-1] if view.resize.endswith("_first") else steps
    speed = f", and {SPEED}: mph, float32 [batch]" if facts.takes_speed else ""
    throttle = " and throttle" if facts.outputs > 1 else ""
    back = facts.window.stride if facts.window else 1
    state = f", and {STATE}...: 0 at a start, then the {NEXT}... of the frame {back} before it"
    state = state if f"{STATE}0" in inputs else ""
    rows = ", for now and each step ahead" if facts.window and facts.window.ahead else ""
    spread = ", and the logarithm of the steering's standard deviation" * facts.predicts_spread
    scale = checkpoint.data.get(CURVATURE)
    steering = f"curvature of the path in {scale:.6g} 1/m, right positive" if scale else "steering"
    return (
        f"{IMAGES}: uint8 [batch, {channels}, {height}, {width}], less "
        f"{view.crop_text}, {', then '.join(steps)}"
        f"{speed}{state} -> {CONTROLS}: {steering}{throttle}{rows}, float32, to be "
        f"clipped to -1..1{spread}"
    )


def graph_bytes(checkpoint: "Checkpoint", one_frame: bool = False) -> bytes:
    """Return a checkpoint's network as an ONNX file without a card.

    Args:
        checkpoint: checkpoint.
        one_frame: whether the batch is always one frame, else its size is variable.

    Raises:
        InputError: the network has an operation that ONNX lacks.
    """
    import torch
    from torch.onnx.errors import OnnxExporterError

    from zoo.checkpoints.frozen_graph import quiet_tracing
    from zoo.models.memory import Memory, Step
    from zoo.models.network_facts import facts_of

    network, (height, width, channels) = checkpoint.network, checkpoint.view.shape
    batch = 1 if one_frame else 2  # the exporter takes a size of one for a constant
    inputs = {IMAGES: torch.zeros((batch, channels, height, width), dtype=torch.uint8)}
    if facts_of(network).takes_speed:
        inputs[SPEED] = torch.zeros(batch)
    if isinstance(network, Memory):
        states = enumerate(network.first_state(batch))
        inputs |= {f"{STATE}{number}": state for number, state in states}
        network = Step(network)
    buffer = io.BytesIO()
    outputs = [CONTROLS, *(name.replace(STATE, NEXT) for name in inputs if name.startswith(STATE))]
    variable = {name: {0: "batch"} for name in (*inputs, *outputs)}
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
                buffer,  # type: ignore[arg-type]  # newer stubs lack files
                input_names=list(inputs),
                output_names=outputs,
                dynamic_axes=None if one_frame else variable,
                opset_version=OPSET,
                dynamo=False,
            )
    except OnnxExporterError as error:
        reason = str(error).splitlines()[0]
        name = type(checkpoint.network).__name__
        raise InputError(f"{name} cannot be written as ONNX ({reason})") from None
    return buffer.getvalue()
