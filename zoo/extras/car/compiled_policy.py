"""The policy of an exported C file, compiled by this machine's C compiler."""

import ctypes
import math
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from zoo.base.child_process import find_program
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.frame_memory import SessionPolicy
from zoo.checkpoints.frozen_graph import NetworkPolicy
from zoo.checkpoints.policy_base import Command, output_command

COMPILERS = ("cc", "gcc", "clang")
FLAGS = ("-std=c99", "-O2")
WAIT_S = 300.0


def find_compiler() -> str | None:
    """Return the path of a C compiler; None without one."""
    return next(filter(None, map(find_program, COMPILERS)), None)


class CompiledPolicy(NetworkPolicy, SessionPolicy):
    """A policy that calls a C file of `drivezoo export`.

    Args:
        checkpoint: checkpoint that the file was written from.
        path: C file, with its header beside it.
        flags: flags of the compiler.

    Raises:
        InputError: there is no compiler, or it refuses the file.
    """

    def __init__(self, checkpoint: Checkpoint, path: Path, flags: tuple[str, ...] = FLAGS) -> None:
        super().__init__(checkpoint)
        compiler = find_compiler()
        if compiler is None:
            raise InputError(f"{path}: no C compiler ({', '.join(COMPILERS)}) is in PATH")
        # On Windows, a loaded library cannot be removed.
        with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            library = Path(folder, "steer.so")
            words = [compiler, *flags, "-shared", "-fPIC", str(path), "-o", str(library)]
            finished = subprocess.run(words, capture_output=True, timeout=WAIT_S)
            if finished.returncode:
                # On Windows, in the code page of its terminal.
                lines = finished.stderr.decode(errors="replace").splitlines()
                reason = next(iter(lines), "without a message")
                raise InputError(f"{path}: {compiler} refuses it ({reason:.200})")
            self._library = ctypes.CDLL(str(library))
        self._steer = self._library[path.stem]
        self._steer.restype = ctypes.c_float
        self._steer.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_int, ctypes.c_float]
        self._throttle = self._library[f"{path.stem}_throttle"] if self.outputs > 1 else None
        if self._throttle is not None:
            self._throttle.restype = ctypes.c_float

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the command for a frame.

        Args:
            frame: RGB image of the centre camera, uint8 [H, W, 3].
            speed_mph: the car's speed in mph.

        Raises:
            InputError: the frame has another size than those of the training.
        """
        height, width, _ = frame.shape
        data = np.ascontiguousarray(frame, np.uint8)
        steering = self._steer(data.ctypes.data, width, height, speed_mph)
        if math.isnan(steering) and (height, width) != self.view.frame:
            rows, columns = self.view.frame
            raise InputError(
                f"frame: is {width} x {height} pixels; the C file takes {columns} x {rows}, the "
                "size of the training's frames: resize it, or train on frames of that size"
            )
        outputs = [steering] if self._throttle is None else [steering, self._throttle()]
        return output_command(outputs, predicts_spread=False)
