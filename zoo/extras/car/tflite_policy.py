"""The policy of an exported `.tflite` file, run by the LiteRT that is installed."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import torch

from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.frame_memory import SessionPolicy
from zoo.checkpoints.frozen_graph import NetworkPolicy
from zoo.checkpoints.policy_base import Command, output_command
from zoo.models.layers import Unbin

RUNTIMES = ("ai_edge_litert.interpreter", "tflite_runtime.interpreter", "tensorflow.lite")


def find_interpreter() -> Any:
    """Return the class that runs `.tflite` files; None without one."""
    for name in RUNTIMES:
        try:
            return import_module(name).Interpreter
        except (ImportError, AttributeError):
            continue
    return None


class TflitePolicy(NetworkPolicy, SessionPolicy):
    """A policy that runs a `.tflite` file as Donkeycar does.

    Args:
        checkpoint: checkpoint that the file was written from.
        path: the file.
    """

    def __init__(self, checkpoint: Checkpoint, path: Path) -> None:
        super().__init__(checkpoint)
        self._run = find_interpreter()(str(path), num_threads=1).get_signature_runner()
        (self._input,) = self._run.get_input_details()
        modules = checkpoint.network.modules()
        self._unbin = next((module for module in modules if isinstance(module, Unbin)), None)

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the command for a frame, uint8 [H, W, 3] RGB of the training's size."""
        found = self._run(**{self._input: frame[None].astype(np.float32) / 255})
        values = np.concatenate([found[name] for name in sorted(found)], axis=1)
        if self._unbin is not None:
            values = self._unbin(torch.from_numpy(values)).numpy()
        return output_command(values[0].tolist(), predicts_spread=False)
