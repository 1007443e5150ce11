"""A checkpoint as a file for other programs, compared with the checkpoint before it is written."""

import importlib.util
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from rich.console import Console

from zoo.base.console_progress import loading
from zoo.base.errors import InputError, UsageError
from zoo.base.output_files import check_output, checked_file
from zoo.base.rig import CURVATURE
from zoo.base.terminal import print_written
from zoo.base.whole_file import write_output
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.checkpoints.onnx_policy import INSTALL, SUFFIX, TOLERANCE, OnnxPolicy, is_onnx
from zoo.scoring.evidence import next_drive

# torch, a slow import, comes late: --help and typos answer at once.
if TYPE_CHECKING:
    from zoo.checkpoints.checkpoint import Checkpoint
    from zoo.checkpoints.frame_memory import SessionPolicy
    from zoo.scoring.parity import Frames, Parity

# The largest difference where Keras computes the view, which is not rounded to whole numbers.
ROUNDED_TOLERANCE = 0.02
# The largest difference of a network whose values have 8 bits.
INT8_TOLERANCE = 0.1
HEADER = ".h"


class ExportedFile:
    """A checkpoint as a file of one kind; a subclass defines the file.

    Args:
        checkpoint: checkpoint to write.
        out: file to write.
        calibration: recording whose frames give the ranges of values of 8 bits; None for the
            training's.
        throttle: largest throttle of a Donkeycar file; None for no bound.

    Attributes:
        default: name of the file if the user names none.
        packages: packages that write it.
        install: command that installs them.
        engine: what runs the file.
        tolerance: largest allowed difference from the checkpoint.
        remedy: what to do after a larger difference.
    """

    default: str
    packages: tuple[str, ...]
    install = INSTALL
    engine: str
    tolerance = TOLERANCE
    remedy = "try another version of what runs it"

    def __init__(
        self,
        checkpoint: "Checkpoint",
        out: Path,
        calibration: str | None = None,
        throttle: float | None = None,
    ) -> None:
        self.checkpoint, self.out = checkpoint, out
        self.calibration, self.throttle = calibration, throttle

    @classmethod
    def check_name(cls, out: Path, inputs: Sequence[Path]) -> None:
        """Raise UsageError or InputError for a file that this kind cannot be written to."""

    def files(self, model_card: str) -> Mapping[str, bytes]:
        """Return the contents of its files by the endings of their names."""
        raise NotImplementedError

    def policy(self, path: Path) -> "SessionPolicy | None":
        """Return the policy of a written file; None if no program here can run it."""
        raise NotImplementedError

    def shown(self, frames: "Frames") -> "Frames":
        """Return frames as the file's policy takes them."""
        return frames

    def changes(self, original: "Checkpoint", frames: "Frames") -> list[str]:
        """Return sentences on what differs from the checkpoint, for its card."""
        return []

    def hints(self) -> list[str]:
        """Return lines on how to use it."""
        return []


class OnnxFile(ExportedFile):
    """A checkpoint as an ONNX file."""

    default = f"model{SUFFIX}"
    packages = ("onnx", "onnxruntime")
    engine = "onnxruntime"
    graph = b""

    def files(self, model_card: str) -> Mapping[str, bytes]:
        """Return the file, see `ExportedFile`."""
        from zoo.checkpoints.onnx_file import onnx_bytes

        return {SUFFIX: onnx_bytes(self.checkpoint, model_card, self.graph)}

    def policy(self, path: Path) -> OnnxPolicy:
        """Return the policy, see `ExportedFile`."""
        return OnnxPolicy(path)


class Int8OnnxFile(OnnxFile):
    """A checkpoint as an ONNX file of 8 bits."""

    tolerance = INT8_TOLERANCE
    remedy = "name frames of more places, calibration=RECORDING, or leave weights=int8 out"

    @cached_property
    def graph(self) -> bytes:  # type: ignore[override]
        """Return the graph of 8 bits."""
        from zoo.export.int8_onnx import int8_graph
        from zoo.scoring.parity import CALIBRATION, take_frames

        frames = take_frames(self.calibration, self.checkpoint, CALIBRATION)
        return int8_graph(self.checkpoint, frames)

    def changes(self, original: "Checkpoint", frames: "Frames") -> list[str]:
        """Return that it has 8 bits, see `ExportedFile`."""
        return ["Weights, and values between the layers: 8 bits."]


class DonkeycarFile(ExportedFile):
    """A checkpoint as a Keras 2 file that Donkeycar loads."""

    default = "pilot.h5"
    packages = ("h5py",)
    install = "pip install h5py"
    engine = "the file's layers"

    def __init__(self, checkpoint: "Checkpoint", *more: Any) -> None:
        from zoo.export.donkeycar_file import bounded

        super().__init__(checkpoint, *more)
        if self.throttle is not None:
            self.checkpoint = bounded(checkpoint, self.throttle)
        if checkpoint.view.size or checkpoint.view.colour != "rgb":
            self.tolerance = ROUNDED_TOLERANCE

    def files(self, model_card: str) -> Mapping[str, bytes]:
        """Return the file, see `ExportedFile`."""
        return {self.out.suffix: self._written[0]}

    @cached_property
    def _written(self) -> tuple[bytes, str]:
        from zoo.export.donkeycar_file import donkeycar_bytes

        return donkeycar_bytes(self.checkpoint)

    def policy(self, path: Path) -> "SessionPolicy":
        """Return the policy, see `ExportedFile`."""
        from zoo.export.donkeycar_file import donkeycar_policy

        return donkeycar_policy(self.checkpoint, path)

    def shown(self, frames: "Frames") -> "Frames":
        """Return frames of the training's size, see `ExportedFile`."""
        from zoo.export.donkeycar_file import whole_view

        whole = whole_view(self.checkpoint.view)
        return replace(frames, frames=[whole(frame) for frame in frames.frames])

    def changes(self, original: "Checkpoint", frames: "Frames") -> list[str]:
        """Return which throttle the car gets, see `ExportedFile`."""
        from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
        from zoo.export.donkeycar_file import inferred_throttle

        policy = CheckpointPolicy(self.checkpoint)
        steering, throttle = zip(*(policy(one, 0.0) for one in frames.frames), strict=True)
        if self._written[1] == "inferred":  # Donkeycar computes it
            throttle = inferred_throttle(steering)
        line = f"Throttle: {min(throttle):.2f} to {max(throttle):.2f} over these frames"
        risk = "; it may be too fast for a car: bound it with throttle=0.2"
        return [f"{line}{risk if self.throttle is None else ''}."]

    def hints(self) -> list[str]:
        """Return what to type in Donkeycar, see `ExportedFile`."""
        rows, columns = self.checkpoint.view.frame
        return [
            f"in Donkeycar: IMAGE_W = {columns} and IMAGE_H = {rows} in myconfig.py; python "
            f"manage.py drive --model {self.out} --type {self._written[1]}"
        ]


class CFile(ExportedFile):
    """A checkpoint as a C99 file and its header."""

    default = "steer.c"
    packages = ("onnx",)
    engine = "the compiled file"
    weights: str = "float"

    @classmethod
    def check_name(cls, out: Path, inputs: Sequence[Path]) -> None:
        """Check the function's name and the header, see `ExportedFile`."""
        from zoo.export.c_source import function_name

        function_name(out)
        check_output(out.with_suffix(HEADER), inputs=inputs)

    def files(self, model_card: str) -> Mapping[str, bytes]:
        """Return both files, see `ExportedFile`."""
        from zoo.export.c_file import c_header

        header = c_header(self.checkpoint, self.out.stem, model_card)
        return {HEADER: header.encode(), self.out.suffix: self._source.encode()}

    @cached_property
    def _source(self) -> str:
        from zoo.export.c_file import c_source

        return c_source(self.checkpoint, self.out.stem, self.weights)

    def policy(self, path: Path) -> "SessionPolicy | None":
        """Return the policy of the compiled file, see `ExportedFile`."""
        from zoo.export.compiled_policy import CompiledPolicy, find_compiler

        return CompiledPolicy(self.checkpoint, path) if find_compiler() else None

    def hints(self) -> list[str]:
        """Return how to call it, see `ExportedFile`."""
        rows, columns = self.checkpoint.view.frame
        name = self.out.stem
        return [
            f'in C: #include "{self.out.with_suffix(HEADER).name}", compile {self.out.name} with '
            f"-std=c99 -O2, and call {name}(rgb, {columns}, {rows}, speed_mph)"
        ]


class Int8CFile(CFile):
    """A checkpoint as a C99 file with weights of 8 bits."""

    weights = "int8"

    def __init__(self, checkpoint: "Checkpoint", *more: Any) -> None:
        from zoo.export.c_file import rounded

        super().__init__(rounded(checkpoint), *more)

    def changes(self, original: "Checkpoint", frames: "Frames") -> list[str]:
        """Return what the rounding changes, see `ExportedFile`."""
        from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
        from zoo.scoring.parity import compare

        lost = compare(CheckpointPolicy(original), CheckpointPolicy(self.checkpoint), frames)
        return [
            f"Weights: 8 bits; they change the steering by {lost.difference:.1e} at most, by "
            f"{lost.mean:.1e} on average, over {len(frames.frames)} frames."
        ]


KINDS: dict[str, type[ExportedFile]] = {"onnx": OnnxFile, "donkeycar": DonkeycarFile, "c": CFile}
INT8: dict[type[ExportedFile], type[ExportedFile]] = {OnnxFile: Int8OnnxFile, CFile: Int8CFile}


def export_checkpoint(
    checkpoint_path: str,
    file: str | None,
    recording: str | None,
    console: Console,
    to: str | None = None,
    weights: str = "float",
    calibration: str | None = None,
    throttle: float | None = None,
) -> Path:
    """Export a checkpoint, print the comparison with it, and return the file's path.

    Args:
        checkpoint_path: checkpoint as users name it.
        file: file to write; None for the kind's usual name.
        recording: recording whose frames are compared; None for the training's.
        console: console to print on.
        to: kind of the file; None for that of the file's ending.
        weights: type of the weights in the file.
        calibration: recording for the ranges of values of 8 bits; None for the training's.
        throttle: largest throttle of a Donkeycar file; None for no bound.

    Raises:
        InputError: the checkpoint or recording does not exist, a package is not installed, the
            file cannot be written, or it steers differently from the checkpoint.
    """
    path = find_checkpoint(checkpoint_path)
    kind, out = _checked_out(path, file, to, weights, calibration)
    if throttle is not None and kind is not DonkeycarFile:
        raise UsageError("throttle: belongs to to=donkeycar; leave it out")
    with loading():
        from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
        from zoo.scoring.model_card import card_text, describe
        from zoo.scoring.parity import PYTORCH, compare, latency, own_latency, take_frames

        described = describe(path)
        checkpoint = described.checkpoint
        if CURVATURE in checkpoint.data and not issubclass(kind, OnnxFile):
            raise InputError(
                f"{path}: its curvature is converted to the steering of a car by drivezoo alone; "
                f"train with data.label=steering, or name a file that ends in {SUFFIX}"
            )
        exported = kind(checkpoint, out, calibration, throttle)
        files = exported.files("")
        frames = exported.shown(take_frames(recording, checkpoint))
        with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            trial = Path(folder, out.name)
            for suffix, contents in files.items():
                trial.with_suffix(suffix).write_bytes(contents)
            if policy := exported.policy(trial):
                # The outputs are compared as they are, before a curvature becomes a car's steering.
                policy.data = checkpoint.data | {CURVATURE: None}
                own = CheckpointPolicy(replace(exported.checkpoint, data=policy.data))
                parity = compare(own, policy, frames)
                _check_parity(path, parity, exported)
                times_ms = {PYTORCH: parity.checkpoint_ms, kind.engine: parity.exported_ms}
                took = latency(times_ms, len(frames.frames))
                agrees = (
                    f"largest difference from the checkpoint {parity.difference:.1e} "
                    f"({exported.tolerance:g} allowed), mean {parity.mean:.1e}, over "
                    f"{len(frames.frames)} frames {frames.source}"
                )
            else:
                took = own_latency(checkpoint)
                agrees = "not compared with the checkpoint: no C compiler is installed here"
        points = [took, *exported.changes(checkpoint, frames)]
        files = exported.files(card_text(described, points))
    for suffix, contents in files.items():
        write_output(out.with_suffix(suffix), contents)
    height, width, _ = checkpoint.view.shape
    network = checkpoint.network
    parameters = sum(one.numel() for one in network.parameters())
    lines = [
        f"{out}: {type(network).__name__} of {parameters:,} parameters, sees {width} x {height} "
        f"{checkpoint.view.colour}, {len(files[out.suffix]) / 1e3:,.0f} kB",
        agrees,
        *points,
        *exported.hints(),
    ]
    for line in lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    following = next_drive(out, checkpoint.data, ["drive", out])
    written = [out.with_suffix(suffix) for suffix in files]
    print_written(written, following if issubclass(kind, OnnxFile) else [], console)
    return out


def _checked_out(
    path: Path, name: str | None, to: str | None, weights: str, calibration: str | None
) -> tuple[type[ExportedFile], Path]:
    """Return the kind and the path to write; report wrong arguments before torch is imported."""
    if is_onnx(path):
        raise InputError(f"{path}: is ONNX already; name the checkpoint")
    kinds = [KINDS[to]] if to else list(KINDS.values())
    endings = {Path(kind.default).suffix: kind for kind in kinds}
    out = checked_file(name or kinds[0].default, [*endings], inputs=[path], into_folder=True)
    kind = endings[out.suffix]
    kind.check_name(out, [path])
    missing = [one for one in kind.packages if importlib.util.find_spec(one) is None]
    if missing:
        raise InputError(f"exporting needs {' and '.join(missing)}: {kind.install}")
    if weights == "int8":
        if kind not in INT8:
            raise UsageError("weights=int8: belongs to to=c and to=onnx; leave it out")
        kind = INT8[kind]
    if calibration is not None and kind is not Int8OnnxFile:
        raise UsageError("calibration: belongs to to=onnx weights=int8; leave it out")
    return kind, out


def _check_parity(path: Path, parity: "Parity", exported: ExportedFile) -> None:
    if not math.isfinite(parity.difference):
        raise InputError(
            f"{path}: steers NaN because its training diverged; nothing was written: train again "
            "with a smaller optim.lr"
        )
    if parity.difference > exported.tolerance:
        raise InputError(
            f"{path}: the file differs by {parity.difference:.2g} from the checkpoint, more "
            f"than {exported.tolerance:g}; nothing was written: {exported.remedy}"
        )
