"""A policy from an ONNX file that `python -m zoo.export` wrote.

The frame passes through the same `View` as in training; onnxruntime runs only the network.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from datamodules.errors import InputError
from datamodules.regular_file import read_regular
from datamodules.view import View
from zoo.checkpoints.command import Command

if TYPE_CHECKING:
    import onnxruntime

SUFFIX = ".onnx"
MOST_BYTES = 2_000_000_000  # ONNX's limit for a single file
CARD = "drivezoo"  # key in the metadata; the value is JSON
IMAGES, SPEED = "images", "speed"  # the graph's inputs
INSTALL = "pip install 'drivezoo[onnx]'"


def is_onnx(path: str | Path) -> bool:
    """Return whether a file's name ends in `.onnx`."""
    return Path(path).suffix.lower() == SUFFIX


class OnnxPolicy:
    """A policy of an ONNX file, called as `zoo.checkpoints.policy.Policy`.

    Args:
        path: ONNX file.
        threads: number of onnxruntime's threads; one is fastest for a single small image.

    Attributes:
        path: ONNX file.
        view: the network's input.
        config, data: the experiment's config, and the recording's `fingerprint` and `rows`.
        name, parameters: the network's class, and its number of parameters.
        takes_speed, outputs, predicts_spread: as in the networks of `zoo.models`.

    Raises:
        InputError: the file does not exist, is not an ONNX file of drivezoo or returns NaN; or
            onnxruntime is not installed.
    """

    def __init__(self, path: str | Path, threads: int = 1) -> None:
        self.path = Path(path)
        self.session = open_session(self.path, threads)
        card = _read_card(self.path, self.session)
        self.view, self.config, self.data = card["view"], card["config"], card["data"]
        self.name, self.parameters = card["network"], card["parameters"]
        self.takes_speed = SPEED in [one.name for one in self.session.get_inputs()]
        self.predicts_spread = card["predicts_spread"]
        self.outputs = self.session.get_outputs()[0].shape[1] - self.predicts_spread
        _check_finite(self)

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the command for a frame.

        Args:
            frame: RGB image of the centre camera, uint8 [160, 320, 3].
            speed_mph: the car's speed in mph.
        """
        out = self.predict(self.view(frame)[None], np.array([speed_mph]))[0].tolist()
        if self.predicts_spread:
            return Command(out[0], out[1] if self.outputs > 1 else None, out[-1])
        return Command(*out)

    def predict(self, images: np.ndarray, speed_mph: np.ndarray) -> np.ndarray:
        """Return the outputs for a batch, float32 [N, outputs] in -1..1, then the spread, if any.

        Args:
            images: images after the view, uint8 [N, H, W, C].
            speed_mph: speeds in mph [N].
        """
        feed = {IMAGES: np.ascontiguousarray(images.transpose(0, 3, 1, 2))}
        if self.takes_speed:
            feed[SPEED] = speed_mph.astype(np.float32)
        out = self.session.run(None, feed)[0]
        if self.predicts_spread:
            return np.hstack([out[:, :-1].clip(-1, 1), np.exp(out[:, -1:])])
        return out.clip(-1, 1)


def _check_finite(policy: OnnxPolicy) -> None:
    """Check the output for an image of noise: NaN weights make every output NaN."""
    frame = np.random.default_rng(0).integers(0, 256, (1, *policy.view.shape), np.uint8)
    if not np.isfinite(policy.predict(frame, np.array([20.0]))).all():
        raise InputError(
            f"{policy.path}: returns NaN: the training diverged; train again with a smaller "
            "optim.lr, and export the new checkpoint"
        )


def open_session(path: Path, threads: int) -> "onnxruntime.InferenceSession":
    """Open a file with onnxruntime on the CPU, and return the session.

    Raises:
        InputError: the file does not exist, is a folder or is damaged; or onnxruntime is not
            installed.
    """
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name a file that python -m zoo.export wrote")
    if not path.is_file():
        raise InputError(
            f"{path}: no such file; write it with python -m zoo.export CKPT out={path}"
        )
    try:
        import onnxruntime
    except ImportError:
        raise InputError(
            f"{path}: onnxruntime, which runs it, is not installed; {INSTALL}"
        ) from None
    try:
        model = read_regular(path, MOST_BYTES)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    if not model:
        raise InputError(f"{path}: is empty (0 bytes); export it again")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.log_severity_level = 4  # errors are raised; do not print them, too
    # Read external weights only from the model's own folder.
    options.add_session_config_entry(
        "session.model_external_initializers_file_folder_path", str(path.absolute().parent)
    )
    try:
        return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises any error on damaged bytes
        reason = type(error).__name__
        raise InputError(
            f"{path}: is damaged, or onnxruntime {onnxruntime.__version__} cannot run it "
            f"({reason}); export it again"
        ) from None


def _read_card(path: Path, session: "onnxruntime.InferenceSession") -> dict:
    """Return the metadata that `zoo.export` wrote, with the view as a `View`."""
    from zoo.checkpoints.checkpoint import FORMAT  # imports torch
    from zoo.runs.bounded_files import check_text, parse_json

    text = session.get_modelmeta().custom_metadata_map.get(CARD)
    if text is None:
        raise InputError(
            f"{path}: is not a file of drivezoo: it has no {CARD} metadata; name a file that "
            "python -m zoo.export wrote"
        )
    try:
        card = check_text(parse_json(text))
        if card["format"] != FORMAT:
            raise InputError(f"has format {card['format']}, this version reads {FORMAT}")
        view = View.from_dict(card["view"])
        predicts_spread = card.get("predicts_spread") is True  # earlier files lack it
        _check_inputs(session, view, predicts_spread)
        return {
            "predicts_spread": predicts_spread,
            "view": view,
            "config": dict(card["config"]),
            "data": dict(card["data"]),
            "network": str(card["network"]),
            "parameters": int(card["parameters"]),
        }
    except (InputError, ValueError, KeyError, TypeError, ArithmeticError, RecursionError) as error:
        reason = str(error) or type(error).__name__
        raise InputError(
            f"{path}: its {CARD} metadata cannot be used ({reason}); export it again"
        ) from None


def _check_inputs(session: "onnxruntime.InferenceSession", view: View, spread: bool) -> None:
    height, width, channels = view.shape
    inputs = {one.name: (one.type, list(one.shape[1:])) for one in session.get_inputs()}
    images = inputs.pop(IMAGES, None)
    speed = inputs.pop(SPEED, None)
    outputs = [one.shape for one in session.get_outputs()]
    if (
        images != ("tensor(uint8)", [channels, height, width])
        or speed not in (None, ("tensor(float)", []))
        or inputs
        or [shape[1:] for shape in outputs] not in ([[1 + spread]], [[2 + spread]])
    ):
        raise InputError(f"its graph does not take its view, {width} x {height} {view.colour}")
