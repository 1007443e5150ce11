"""The export of a checkpoint, compared with the checkpoint before a file is written."""

import importlib.util
import math
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from rich.console import Console

from zoo.base.console_progress import loading
from zoo.base.errors import InputError, UsageError, hint
from zoo.base.output_files import check_output, checked_file
from zoo.base.rig import CURVATURE
from zoo.base.terminal import print_written
from zoo.base.whole_file import write_output
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.checkpoints.onnx_policy import SUFFIX, is_onnx
from zoo.scoring.evidence import next_drive
from zoo.scoring.exported_file import FLOAT, ExportedFile, export_names, exports

# torch, a slow import, comes late: --help and typos answer at once.
if TYPE_CHECKING:
    from zoo.scoring.parity import Parity


def export_checkpoint(
    checkpoint_path: str,
    file: str | None,
    recording: str | None,
    console: Console,
    to: str | None = None,
    weights: str = FLOAT,
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
        throttle: largest throttle that the file returns; None for no bound.

    Raises:
        InputError: the checkpoint or recording does not exist, a package is not installed, the
            file cannot be written, or it steers differently from the checkpoint.
    """
    path = find_checkpoint(checkpoint_path)
    kind, out = _checked_out(path, file, to, weights)
    _check_keys(kind, calibration=calibration, throttle=throttle)
    with loading():
        from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
        from zoo.scoring.model_card import card_text, describe
        from zoo.scoring.parity import PYTORCH, compare, latency, own_latency, take_frames

        described = describe(path)
        checkpoint = described.checkpoint
        if CURVATURE in checkpoint.data and not kind.drives:
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
                parity = compare(CheckpointPolicy(exported.checkpoint), policy, frames)
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
                agrees = f"not compared with the checkpoint: {exported.not_run}"
        points = [took, *exported.changes(checkpoint, frames)]
        files = exported.files(card_text(described, points))
    for suffix, contents in files.items():
        write_output(out.with_suffix(suffix), contents)
    height, width, _ = checkpoint.view.shape
    network = checkpoint.network
    parameters = sum(tensor.numel() for tensor in network.parameters())
    lines = [
        f"{out}: {type(network).__name__} of {parameters:,} parameters, sees {width} x {height} "
        f"{checkpoint.view.colour}, {len(files[out.suffix]) / 1e3:,.0f} kB",
        agrees,
        *points,
        *exported.hints(),
    ]
    for line in lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    following = next_drive(out, checkpoint.data, ["drive", out]) if kind.drives else []
    print_written([out.with_suffix(suffix) for suffix in files], following, console)
    return out


def _checked_out(
    path: Path, file: str | None, to: str | None, weights: str
) -> tuple[type[ExportedFile], Path]:
    """Return the kind and the path to write; report wrong arguments before torch is imported."""
    if is_onnx(path):
        raise InputError(f"{path}: is ONNX already; name the checkpoint")
    by_ending: dict[str, tuple[str, type[ExportedFile]]] = {}
    for name, kind in exports(to):
        by_ending.setdefault(Path(kind.default).suffix, (name, kind))
        if Path(file or kind.default).suffix in by_ending:
            break
    if not by_ending:
        raise UsageError(f"to={to}: no such kind of file; {hint(str(to), export_names())}")
    (_, first), *_ = by_ending.values()
    out = checked_file(file or first.default, [*by_ending], inputs=[path], into_folder=True)
    name, kind = by_ending[out.suffix]
    if weights != FLOAT:
        kinds = dict(exports(weights=weights))
        if name not in kinds:
            raise UsageError(f"weights={weights}: {_belongs(f'to={taker}' for taker in kinds)}")
        kind = kinds[name]
    kind.check_name(out)
    for ending in kind.beside:
        check_output(out.with_suffix(ending), inputs=[path])
    if missing := [package for package in kind.packages if not importlib.util.find_spec(package)]:
        raise InputError(f"exporting needs {' and '.join(missing)}: {kind.install}")
    return kind, out


def _check_keys(kind: type[ExportedFile], **values: object) -> None:
    """Raise UsageError for a key that is given but that a kind does not take."""
    for key, value in values.items():
        if value is not None and key not in kind.keys:
            takers = [
                f"to={name}{'' if weights == FLOAT else f' weights={weights}'}"
                for weights in (FLOAT, "int8")
                for name, taker in exports(weights=weights)
                if key in taker.keys
            ]
            raise UsageError(f"{key}: {_belongs(takers)}")


def _belongs(takers: Iterable[str]) -> str:
    kinds = " and ".join(takers) or "a kind of file that is not installed"
    return f"belongs to {kinds}; leave it out"


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
