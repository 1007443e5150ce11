"""A policy from an ONNX file that `drivezoo export` wrote.

The frame passes through the same `View` as in training; onnxruntime runs only the network.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from datamodules.view import View
from zoo.base.bounded_files import read_regular
from zoo.base.errors import InputError, file_errors, optional_import
from zoo.checkpoints.frame_memory import SessionPolicy
from zoo.checkpoints.policy_base import Command, output_command
from zoo.models.frame_window import Window

if TYPE_CHECKING:
    import onnxruntime

SUFFIX = ".onnx"
ONNX = "onnx"  # name of the engine
# Largest difference of steering and throttle (-1..1): the last digit sent to a simulator.
TOLERANCE = 1e-4
MOST_BYTES = 2_000_000_000  # ONNX's limit for a single file
CARD = "drivezoo"  # key in the metadata; the value is JSON
IMAGES, SPEED = "images", "speed"  # the graph's inputs
STATE, NEXT = "state_", "next_"  # beginning of the names of a state's inputs and outputs
# An operation's type, field 4 of a node, in protobuf's bytes: the only one that may run for ever.
LOOP = re.compile(rb"(?:\x22|\xa2\x80*\x00)(?:\x04|\x84\x80*\x00)Loop")
# The key, field 1 of an entry, that names a file with weights: onnxruntime 1.23, the last for
# Python 3.10, reads one anywhere.
ELSEWHERE = re.compile(rb"(?:\x0a|\x8a\x80*\x00)(?:\x08|\x88\x80*\x00)location")
INSTALL = 'pip install "drivezoo[onnx]"'
# What reading a damaged card raises.
UNUSABLE = (InputError, ValueError, KeyError, TypeError, ArithmeticError, RecursionError)


def is_onnx(path: str | Path) -> bool:
    """Return whether a file's name ends in `.onnx`."""
    return Path(path).suffix.lower() == SUFFIX


class OnnxPolicy(SessionPolicy):
    """A policy of an ONNX file, called as `CheckpointPolicy`.

    Args:
        path: ONNX file.
        threads: number of onnxruntime's threads; one is fastest for a single small image.

    Attributes:
        path: ONNX file.
        onnx: session of onnxruntime.
        engine: facts about what runs it, as in `CheckpointPolicy`.

    Raises:
        InputError: the file does not exist, is not an ONNX file of drivezoo or returns NaN; or
            onnxruntime is not installed.
    """

    engine = MappingProxyType({"name": ONNX})
    tied = "onnxruntime computes in single precision"

    def __init__(self, path: str | Path, threads: int = 1) -> None:
        self.path = Path(path)
        self.onnx = open_session(self.path, threads)
        window = self._read_card()
        self.takes_speed = SPEED in [item.name for item in self.onnx.get_inputs()]
        self._controls = self.onnx.get_outputs()[0].shape[1:]
        self.outputs = self._controls[-1] - self.predicts_spread
        if window is not None:
            self.keep_memory(self._first_state(1), window, self.data)
        _check_finite(self)

    def _read_card(self) -> Window | None:
        """Take the facts in the metadata that an export wrote; return the window, if any."""
        from zoo.base.plain_files import check_text, check_version, parse_json
        from zoo.checkpoints.checkpoint import FORMAT  # imports torch

        try:  # decoding raises UnicodeDecodeError
            text = self.onnx.get_modelmeta().custom_metadata_map.get(CARD)
            if text is None:
                raise InputError("there is none: name a file that drivezoo export wrote")
            card = check_text(parse_json(text))
            check_version(card["format"], FORMAT, CARD)
            self.view = View.from_dict(card["view"])
            window = card.get("window")
            window = None if window is None else Window(**window)
            self.predicts_spread = card.get("predicts_spread") is True
            _check_inputs(self.onnx, self.view, window, self.predicts_spread)
            self.config, self.data = dict(card["config"]), dict(card["data"])
            self.name, self.parameters = str(card["network"]), int(card["parameters"])
        except UNUSABLE as error:
            reason = str(error) or type(error).__name__
            raise InputError(
                f"{self.path}: its {CARD} metadata cannot be used ({reason:.200}); export it again"
            ) from None
        return window

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the command for a frame.

        Args:
            frame: RGB image of the centre camera, uint8 [H, W, 3].
            speed_mph: the car's speed in mph.
        """
        inputs = self._inputs(self.view(frame)[None], np.array([speed_mph]))
        if self.memory is None:
            outputs = self._run(inputs)[0][0].tolist()
            return self.for_car(output_command(outputs, self.predicts_spread))
        steps = self.memory.step(self._run, inputs)[0].clip(-1, 1)
        return Command(*self.in_time(steps, speed_mph).tolist())

    def predict(self, images: np.ndarray, speed_mph: np.ndarray) -> np.ndarray:
        """Return the outputs for a batch, float32 [N, outputs] in -1..1, then the spread, if any.

        A network with memory gets each image as the first frame of a drive, and returns
        [N, 1 + ahead, outputs].

        Args:
            images: images after the view, uint8 [N, H, W, C].
            speed_mph: speeds in mph [N].
        """
        out = self._run(self._inputs(images, speed_mph), *self._first_state(len(images)))[0]
        if self.predicts_spread:
            return np.concatenate([out[..., :-1].clip(-1, 1), np.exp(out[..., -1:])], -1)
        return out.clip(-1, 1)

    def _inputs(self, images: np.ndarray, speed_mph: np.ndarray) -> dict[str, np.ndarray]:
        inputs = {IMAGES: np.ascontiguousarray(images.transpose(0, 3, 1, 2))}
        if self.takes_speed:
            inputs[SPEED] = speed_mph.astype(np.float32)
        return inputs

    def _run(self, inputs: dict[str, np.ndarray], *state: np.ndarray) -> list[np.ndarray]:
        """Return the outputs and the new state."""
        states = {f"{STATE}{number}": tensor for number, tensor in enumerate(state)}
        outputs = run_network(self.onnx, self.path, inputs | states)
        if outputs[0].shape != (len(inputs[IMAGES]), *self._controls):
            raise InputError(
                f"{self.path}: its graph returns an array of {outputs[0].shape} for "
                f"{len(inputs[IMAGES])} images; export it again"
            )
        return outputs

    def _first_state(self, count: int) -> list[np.ndarray]:
        """Return zeros, the state before the first frame, for `count` cars."""
        return [
            np.zeros((count, *item.shape[1:]), STATE_TYPES[item.type])
            for item in self.onnx.get_inputs()
            if item.name.startswith(STATE)
        ]


def _check_finite(policy: OnnxPolicy) -> None:
    """Check the output for an image of noise: NaN weights make every output NaN."""
    frame = np.random.default_rng(0).integers(0, 256, (1, *policy.view.shape), np.uint8)
    if not np.isfinite(policy.predict(frame, np.array([20.0]))).all():
        raise InputError(
            f"{policy.path}: returns NaN: the training diverged; train again with a smaller "
            "optim.lr, and export the new checkpoint"
        )


def run_once(path: Path) -> None:
    """Open a file and run its network on an image, to learn whether that ends.

    Raises:
        InputError: see `open_session`; or the network cannot be run.
    """
    session, rng = open_session(path, 1), np.random.default_rng(0)
    inputs = {}
    for item in session.get_inputs():
        shape = [size if isinstance(size, int) else 1 for size in item.shape]
        if item.type not in STATE_TYPES:
            return  # `OnnxPolicy` refuses it before it runs
        inputs[item.name] = rng.integers(0, 256, shape).astype(STATE_TYPES[item.type])
    run_network(session, path, inputs)


def run_network(
    session: "onnxruntime.InferenceSession", path: Path, inputs: Mapping[str, np.ndarray]
) -> list[np.ndarray]:
    """Return a network's outputs.

    Raises:
        InputError: the graph cannot be run.
    """
    try:
        return session.run(None, inputs)
    except Exception as error:  # onnxruntime raises any error on a damaged graph
        raise InputError(
            f"{path}: its graph cannot be run ({reason_of(error)}); export it again"
        ) from None


def open_session(path: Path, threads: int) -> "onnxruntime.InferenceSession":
    """Open a file with onnxruntime on the CPU, and return the session.

    Raises:
        InputError: the file does not exist, is a folder or is damaged; or onnxruntime is not
            installed.
    """
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name a file that drivezoo export wrote")
    if not path.is_file():
        raise InputError(f"{path}: no such file; write it with drivezoo export CKPT out={path}")
    with optional_import(f"{path}: onnxruntime, which runs it, is not installed; {INSTALL}"):
        import onnxruntime
    with file_errors(path, "cannot be read ({})"):
        model = read_regular(path, MOST_BYTES)
    if not model:
        raise InputError(f"{path}: is empty (0 bytes); export it again")
    if LOOP.search(model):
        raise InputError(f"{path}: has a loop, which may never end; name a file of drivezoo export")
    if ELSEWHERE.search(model):
        raise InputError(f"{path}: has weights in another file; name a file of drivezoo export")
    try:
        return start_session(model, threads)
    except Exception as error:  # onnxruntime raises any error on damaged bytes
        raise InputError(
            f"{path}: is damaged, or onnxruntime {onnxruntime.__version__} cannot run it "
            f"({reason_of(error)}); export it again"
        ) from None


def reason_of(error: Exception) -> str:
    """Return the name and the end of an error of onnxruntime, which begins with codes."""
    return f"{type(error).__name__}: {' '.join(str(error).split())[-80:]}"


def start_session(model: bytes, threads: int) -> "onnxruntime.InferenceSession":
    """Return a session of onnxruntime on the CPU.

    Args:
        model: contents of an ONNX file.
        threads: number of threads.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.log_severity_level = 4  # errors are raised; do not print them, too
    # Not onnxruntime's own format, whose bytes `open_session` does not know.
    options.add_session_config_entry("session.load_model_format", "ONNX")
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


# Memory that a damaged file may ask for; the frames of `MOST_FRAMES` windows are smaller.
MOST_STATE = 100_000_000
STATE_TYPES = {"tensor(uint8)": np.uint8, "tensor(float)": np.float32}


def _check_inputs(
    session: "onnxruntime.InferenceSession", view: View, window: Window | None, spread: bool
) -> None:
    height, width, channels = view.shape
    inputs = {item.name: (item.type, list(item.shape[1:])) for item in session.get_inputs()}
    images = inputs.pop(IMAGES, None)
    speed = inputs.pop(SPEED, None)
    controls, *states = session.get_outputs()
    rows = [] if window is None else [1 + window.ahead]
    if (
        images != ("tensor(uint8)", [channels, height, width])
        or speed not in (None, ("tensor(float)", []))
        or controls.shape[1:] not in ([*rows, 1 + spread], [*rows, 2 + spread])
    ):
        raise InputError(f"its graph does not take its view, {width} x {height} {view.colour}")
    returned = {state.name: (state.type, list(state.shape[1:])) for state in states}
    wanted = {f"{STATE}{number}": returned.get(f"{NEXT}{number}") for number in range(len(states))}
    if inputs != wanted or (inputs and window is None):
        raise InputError("its graph does not return the state that it takes")
    for kind, shape in inputs.values():
        whole = all(type(size) is int for size in shape)
        if kind not in STATE_TYPES or not whole or math.prod(shape) > MOST_STATE:
            raise InputError("its graph takes a state of another type, or too large a state")
