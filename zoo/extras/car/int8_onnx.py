"""An ONNX graph whose weights and values are whole numbers of 8 bits, by onnxruntime."""

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np
from onnxruntime.quantization import (
    CalibrationDataReader,
    QuantType,
    quant_pre_process,
    quantize_static,
)

from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.checkpoints.onnx_policy import OnnxPolicy
from zoo.scoring.parity import Frames


def int8_graph(checkpoint: Checkpoint, frames: Frames) -> bytes:
    """Return a checkpoint's network as an ONNX file of 8 bits, without a card.

    Weights have a scale for each output; values between the layers have one for each layer, from
    their range over the frames. Weights use 7 of the 8 bits: sums of pairs of larger products
    overflow on x86 processors without VNNI.

    Args:
        checkpoint: checkpoint.
        frames: frames of one drive, for the ranges of the values.
    """
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        path, merged, out = (Path(folder, f"{name}.onnx") for name in ("float", "merged", "int8"))
        path.write_bytes(onnx_bytes(checkpoint))
        quant_pre_process(path, merged, skip_symbolic_shape=True)
        quantize_static(
            merged,
            out,
            _Inputs(OnnxPolicy(path), frames),
            per_channel=True,
            reduce_range=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
        )
        return out.read_bytes()


class _Inputs(CalibrationDataReader):
    """The graph's inputs while a policy drives over frames, with the state of one with memory."""

    def __init__(self, policy: OnnxPolicy, frames: Frames) -> None:
        fed: list[Mapping[str, np.ndarray]] = []
        session = policy.onnx

        def run(names: Any, inputs: Mapping[str, np.ndarray]) -> list[np.ndarray]:
            fed.append(inputs)
            return session.run(names, inputs)

        policy.onnx, policy.data = SimpleNamespace(run=run), {}  # a curvature stays as it is
        for frame, speed_mph in zip(frames.frames, frames.speeds_mph, strict=True):
            policy(frame, speed_mph)
        self._fed = iter(fed)

    def get_next(self) -> Mapping[str, np.ndarray] | None:
        """Return the next inputs; None at the end."""
        return next(self._fed, None)
