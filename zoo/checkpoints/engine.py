"""The engine that runs a network in driving: PyTorch's frozen graph, or onnxruntime.

Milliseconds per frame of random weights on one thread: see `make bench ONLY=driver`.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, Literal

import torch
from torch import Tensor

from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.frozen_graph import as_step, largest_difference, quick_forward, trials
from zoo.checkpoints.onnx_file import graph_bytes
from zoo.checkpoints.onnx_policy import INSTALL, ONNX, TOLERANCE, start_session
from zoo.models.make_network import multiply_adds

Engine = Literal["auto", "torch", "onnx"]
TORCH = "torch"
# EfficientNet-Lite0 has 157 million, and a third of the time in onnxruntime; PilotNet has 27.
LEAST_OPERATIONS = 100_000_000  # multiply-adds a frame from which `auto` is onnxruntime


def chosen_forward(
    checkpoint: Checkpoint, engine: Engine = "torch", threads: int = 1
) -> tuple[Callable[..., Any], Mapping[str, Any]]:
    """Return a fast function with a network's outputs, and facts about what runs it.

    `auto` runs onnxruntime if it is installed, steers as PyTorch within `TOLERANCE`, and the
    network has `LEAST_OPERATIONS`.

    Args:
        checkpoint: checkpoint with the network.
        engine: engine to use.
        threads: number of onnxruntime's threads.

    Returns:
        The function, see `quick_forward`; and the facts: `name`, torch or onnx; `note`, why
        onnxruntime does not run the network, if `auto` asked for it.

    Raises:
        InputError: engine=onnx, but onnxruntime is not installed, or cannot run the network or
            steers differently.
    """
    height, width, channels = checkpoint.view.shape
    forward, shape = quick_forward(checkpoint.network, checkpoint.view), (channels, height, width)
    if engine == TORCH or (
        engine == "auto" and multiply_adds(checkpoint.network, shape) < LEAST_OPERATIONS
    ):
        return forward, {"name": TORCH}
    try:
        onnx = _onnx_forward(checkpoint, threads)
        inputs, wanted = trials(checkpoint.network, as_step(checkpoint.network), checkpoint.view)
        most = largest_difference([onnx(*row) for row in inputs], wanted)
        if not most <= TOLERANCE:
            raise InputError(f"its outputs differ by {most:.2g}, more than {TOLERANCE:g}")
    except Exception as error:  # onnxruntime raises any error on a graph that it cannot run
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        note = f"onnxruntime does not run it ({reason:.200})"
        if isinstance(error, ImportError):
            note = f"onnxruntime, which is faster, is not installed: {INSTALL}"
        if engine == ONNX:
            raise InputError(f"engine=onnx: {note}; add engine=torch") from None
        return forward, {"name": TORCH, "note": note}
    return onnx, {"name": ONNX}


def engine_text(facts: Mapping[str, Any]) -> str:
    """Describe what `chosen_forward` chose; empty for a network that PyTorch runs as it should.

    >>> engine_text({"name": "onnx"}), engine_text({"name": "torch"})
    ('engine onnx', '')
    """
    note = f" ({facts['note']})" if "note" in facts else ""
    return f"engine {facts['name']}{note}" if note or facts.get("name") == ONNX else ""


def _onnx_forward(checkpoint: Checkpoint, threads: int) -> Callable[..., Any]:
    """Return a network, or its step if it has memory, as a function that onnxruntime runs."""
    for package in ("onnx", "onnxruntime"):  # before the slow export
        import_module(package)
    session = start_session(graph_bytes(checkpoint, one_frame=True), threads)
    names = [item.name for item in session.get_inputs()]

    def forward(*inputs: Tensor) -> Any:
        arrays = (tensor.contiguous().numpy() for tensor in inputs)
        outs = session.run(None, dict(zip(names, arrays, strict=True)))
        tensors = tuple(map(torch.from_numpy, outs))
        return tensors if len(tensors) > 1 else tensors[0]

    return forward
