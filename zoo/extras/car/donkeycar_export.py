"""The kind of `drivezoo export` that Donkeycar loads."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zoo.scoring.exported_file import ExportedFile

# torch, a slow import, comes late: --help and typos answer at once.
if TYPE_CHECKING:
    from zoo.checkpoints.checkpoint import Checkpoint
    from zoo.checkpoints.frame_memory import SessionPolicy
    from zoo.scoring.parity import Frames

# The largest difference where Keras computes the view, which is not rounded to whole numbers.
ROUNDED_TOLERANCE = 0.02


class SizedFile(ExportedFile):
    """A checkpoint as a file that takes frames of the training's size."""

    def shown(self, frames: "Frames") -> "Frames":
        """Return frames of that size, see `ExportedFile`."""
        from zoo.extras.car.donkeycar_file import whole_view

        whole = whole_view(self.checkpoint.view)
        return replace(frames, frames=[whole(frame) for frame in frames.frames])


class DonkeycarFile(SizedFile):
    """A checkpoint as a Keras 2 file that Donkeycar loads."""

    default = "pilot.h5"
    packages: tuple[str, ...] = ("h5py",)
    install = "pip install h5py"
    keys = ("throttle",)
    engine = "the file's layers"
    keras = 2

    def __init__(self, checkpoint: "Checkpoint", *options: Any) -> None:
        from zoo.extras.car.donkeycar_file import bounded

        super().__init__(checkpoint, *options)
        if self.throttle is not None:
            self.checkpoint = bounded(checkpoint, self.throttle)
        if checkpoint.view.size or checkpoint.view.colour != "rgb":
            self.tolerance = ROUNDED_TOLERANCE

    def files(self, model_card: str) -> Mapping[str, bytes]:
        """Return the file, see `ExportedFile`."""
        return {self.out.suffix: self._written[0]}

    @cached_property
    def _written(self) -> tuple[bytes, str]:
        from zoo.extras.car.donkeycar_file import donkeycar_bytes

        return donkeycar_bytes(self.checkpoint, self.keras)

    def policy(self, path: Path) -> "SessionPolicy | None":
        """Return the policy, see `ExportedFile`."""
        from zoo.extras.car.donkeycar_file import donkeycar_policy

        return donkeycar_policy(self.checkpoint, path)

    def changes(self, original: "Checkpoint", frames: "Frames") -> list[str]:
        """Return which throttle the car gets, see `ExportedFile`."""
        from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
        from zoo.extras.car.donkeycar_file import inferred_throttle

        policy = CheckpointPolicy(self.checkpoint)
        steering, throttle = zip(*(policy(frame, 0.0) for frame in frames.frames), strict=True)
        if self._written[1].endswith("inferred"):  # Donkeycar computes it
            throttle = tuple(inferred_throttle(steering))
        line = f"Throttle: {min(throttle):.2f} to {max(throttle):.2f} over these frames"
        risk = "; it may be too fast for a car: bound it with throttle=0.2"
        return [f"{line}{risk if self.throttle is None else ''}."]

    def hints(self) -> list[str]:
        """Return what to type in Donkeycar, see `ExportedFile`."""
        from zoo.extras.car.donkeycar_file import bins_of

        rows, columns = self.checkpoint.view.frame
        settings = [f"IMAGE_W = {columns}", f"IMAGE_H = {rows}"]
        for bins in bins_of(self.checkpoint.network):
            count, low, step = bins.groups[1]
            settings.append(f"MODEL_CATEGORICAL_MAX_THROTTLE_RANGE = {low + count * step:g}")
        return [
            f"in Donkeycar: {' and '.join(settings)} in myconfig.py; python "
            f"manage.py drive --model {self.out} --type {self._written[1]}"
        ]


class KerasFile(DonkeycarFile):
    """A checkpoint as a Keras 3 file, which Donkeycar loads from 5.4 on."""

    default = "pilot.keras"
    keras = 3
