"""The engine that runs a network in driving: PyTorch's frozen graph, or onnxruntime if faster here.

Milliseconds per frame of random weights on one thread: see `make bench ONLY=driver`.
"""

import time
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

Engine = Literal["auto", "torch", "onnx"]
TORCH = "torch"
QUICK_MS = 5.0  # a frame at 60 fps has 16.7 ms: below, a trial gains less than it delays the start
ROUNDS, TRIAL_S = 7, 0.5


def chosen_forward(
    checkpoint: Checkpoint, engine: Engine = "torch", threads: int = 1
) -> tuple[Callable[..., Any], Mapping[str, Any]]:
    """Return a fast function with a network's outputs, and facts about what runs it.

    `auto` runs onnxruntime if it is installed, steers as PyTorch within `TOLERANCE`, and takes less
    time here, where PyTorch takes 5 ms or more.

    Args:
        checkpoint: checkpoint with the network.
        engine: engine to use.
        threads: number of onnxruntime's threads.

    Returns:
        The function, see `quick_forward`; and the facts: `name`, torch or onnx; `ms`, the shortest
        time that a frame took by engine, if it was measured; `note`, why onnxruntime does not run
        the network, if it cannot.

    Raises:
        InputError: engine=onnx, but onnxruntime is not installed, or cannot run the network or
            steers differently.
    """
    forward = quick_forward(checkpoint.network, checkpoint.view)
    if engine == TORCH:
        return forward, {"name": TORCH}
    inputs, wanted = trials(checkpoint.network, as_step(checkpoint.network), checkpoint.view)
    ms = _shortest_ms({TORCH: forward}, inputs[0])
    if engine == "auto" and ms[TORCH] < QUICK_MS:
        return forward, {"name": TORCH, "ms": ms}
    try:
        onnx = _onnx_forward(checkpoint, threads)
        most = largest_difference([onnx(*one) for one in inputs], wanted)
        if not most <= TOLERANCE:
            raise InputError(f"its outputs differ by {most:.2g}, more than {TOLERANCE:g}")
    except Exception as error:  # onnxruntime raises any error on a graph that it cannot run
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        note = f"onnxruntime does not run it ({reason:.200})"
        if isinstance(error, ImportError):
            note = f"onnxruntime is not tried: {INSTALL}"
        if engine == ONNX:
            raise InputError(f"engine=onnx: {note}; add engine=torch") from None
        return forward, {"name": TORCH, "ms": ms, "note": note}
    ms = _shortest_ms({TORCH: forward, ONNX: onnx}, inputs[0])
    name = ONNX if engine == ONNX else min(ms, key=ms.__getitem__)
    return (onnx if name == ONNX else forward), {"name": name, "ms": ms}


def engine_text(facts: Mapping[str, Any]) -> str:
    """Describe what `chosen_forward` chose; empty if nothing was measured.

    >>> engine_text({"name": "onnx", "ms": {"torch": 17.84, "onnx": 9.12}})
    'engine onnx (torch 17.8 ms, onnx 9.1 ms a frame)'
    """
    if not (ms := facts.get("ms")):
        return ""
    times = ", ".join(f"{name} {time_ms:.1f} ms" for name, time_ms in ms.items())
    note = f"; {facts['note']}" if "note" in facts else ""
    return f"engine {facts['name']} ({times} a frame{note})"


def _onnx_forward(checkpoint: Checkpoint, threads: int) -> Callable[..., Any]:
    """Return a network, or its step if it has memory, as a function that onnxruntime runs."""
    for package in ("onnx", "onnxruntime"):  # before the slow export
        import_module(package)
    session = start_session(graph_bytes(checkpoint, one_frame=True), threads)
    names = [one.name for one in session.get_inputs()]

    def forward(*inputs: Tensor) -> Any:
        arrays = (one.contiguous().numpy() for one in inputs)
        outs = session.run(None, dict(zip(names, arrays, strict=True)))
        found = tuple(map(torch.from_numpy, outs))
        return found if len(found) > 1 else found[0]

    return forward


@torch.inference_mode()
def _shortest_ms(
    engines: Mapping[str, Callable[..., Any]], inputs: tuple[Tensor, ...]
) -> dict[str, float]:
    """Return the shortest time of each engine in turns: other processes only lengthen times."""
    times_ms: dict[str, list[float]] = {name: [] for name in engines}
    end_s = time.perf_counter() + TRIAL_S
    for _ in range(ROUNDS):
        for name, forward in engines.items():
            began = time.perf_counter()
            forward(*inputs)
            times_ms[name].append(1000 * (time.perf_counter() - began))
        if time.perf_counter() > end_s:
            break
    return {name: round(min(times), 3) for name, times in times_ms.items()}
