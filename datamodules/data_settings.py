"""The settings of a training's data: all keys of `data`, and the datamodule that they load."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from rich.console import Console

from datamodules.augment import Change
from datamodules.augmented_batch import Augment
from datamodules.balance import BatchOptions, Least0
from datamodules.driving import DrivingData
from datamodules.format_options import said_in
from datamodules.looking.findings import report_lines
from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from datamodules.row_views import RowViews, load_row_views
from datamodules.samples import camera_numbers, make_samples
from datamodules.split import KINDS, SHARE, split_rows, split_words
from datamodules.steering_label import curvature_label, in_label, label_lines
from datamodules.view import View
from datamodules.windows import Windows
from zoo.base.command_keys import Untyped, keys_of
from zoo.base.errors import InputError
from zoo.base.key_values import convert
from zoo.base.rig import STEERING

MOST_WINDOW = 256  # frames, rows or targets of a window
# Keys whose values are checked where they are read.
READ_LATER = ("root", "weights", "crop", "cameras", "augment", "columns", "steering", "each")


@dataclass(frozen=True, kw_only=True)
class DataSettings(BatchOptions):
    """The keys of `data`, each with its type, default and meaning; checked when it is created.

    `conf/data/recording.yaml` and the manual's table have the same defaults and meanings: a test
    compares them. Where a key of `ReadOptions` has another meaning here, it is the shorter one
    that `drivezoo train --help` prints.

    Args:
        root: folder or file of a recording of any format, or a list of them
        format: format's name, such as table; null: found by the files
        columns: columns of a table: {image: NAME, steering: NAME}
        steering: what its numbers mean, {unit: deg, full: 540, right: positive}; null: the format's
        camera: camera that looks ahead, in a LeRobot dataset
        speed_unit: mph, mps or kmh, of a speed whose name has no unit
        each: {2: {steering: NAME}}: keys of the second recording alone
        rig: name or YAML file of the car; null: rig.yaml, or the format's
        label: steering, or curvature, in one unit for all cars whose rigs are known
        images: folder of the images, if not IMG/
        offset: steering added for the left camera, subtracted for the right
        recover_s: replaces offset: seconds in which to return to the centreline
        crop: rows cut off at the top and the bottom of a frame of 160
        split: blocks, random, recording, or a CSV file of image,part
        val_share: share of the rows for validation
        test_share: share of the rows for the test
        block_s: seconds of a block, for split=blocks; null: the format's
        gap_s: seconds left out between two parts; null: the format's
        split_seed: random seed of the split
        augment: changes of training images, chosen by augment=[...]
        on_bad_image: fail, or skip: leave out rows with a damaged image
        on_bad_row: fail, or skip: leave out rows of the log that cannot be read
        cache: folder of decoded views; null keeps them in memory
        cache_gb: most GB of shards from an address, in data.cache
        sequence: frames in a window; null: as the network needs
        stride: rows from one frame of a window to the next
        ahead: targets after a window's newest frame
        colour: colour of the view, see `View`; of the model, as `size` and `resize`
        size: height and width of the view; None to keep the cropped size
        resize: how the view is resized

    Attributes:
        view: what the network sees of a frame of the usual size.

    Raises:
        InputError: a value is wrong.
    """

    root: str | Sequence[str] = field(kw_only=False)
    label: Literal["steering", "curvature"] = "steering"
    offset: Annotated[float, Field(ge=-1, le=1)] = 0.275
    recover_s: Annotated[float, Field(gt=0)] | None = None
    crop: tuple[int, int] = (40, 20)
    split: str = KINDS[0]
    val_share: Least0 = SHARE
    test_share: Least0 = SHARE
    block_s: Least0 | None = None
    gap_s: Least0 | None = None
    split_seed: Annotated[int, Field(ge=0)] = 0
    augment: Mapping[str, Any] = field(default_factory=dict)
    sequence: Annotated[int, Field(ge=1, le=MOST_WINDOW)] | None = None
    stride: Annotated[int, Field(ge=1, le=MOST_WINDOW)] | None = None
    ahead: Annotated[int, Field(ge=0, le=MOST_WINDOW)] | None = None
    colour: Annotated[str, Untyped()]
    size: Annotated[tuple[int, int] | None, Untyped()]
    resize: Annotated[str, Untyped()] = View.resize
    view: View = field(init=False)

    def __post_init__(self) -> None:
        """Check the values."""
        if self.root is None:
            raise InputError("data.root is not set: name your recording, data.root=FOLDER")
        for key in keys_of(DataSettings):
            if key.name not in READ_LATER:
                value = convert(f"data.{key.name}", key.kind, getattr(self, key.name))
                if not isinstance(value, float):  # such as a text of a number, 1000 of 1e3
                    object.__setattr__(self, key.name, value)
        camera_numbers(self.cameras)
        object.__setattr__(self, "view", View(self.crop, self.colour, self.size, self.resize))

    def load(self, console: Console) -> DrivingData:
        """Read the recordings, decode images that are not cached, split the rows, make samples.

        Raises:
            InputError: a recording cannot be read, or a value does not fit it.
        """
        recording = read_recordings(self.root, **said_in(vars(self)))
        count = len(recording.names)
        if self.weights is not None and not _are_weights(self.weights, count):
            raise InputError(
                f"data.weights={self.weights} is not null, or a list of {count} numbers above 0, "
                "one for each recording of data.root"
            )
        size = recording.frame_size()
        view = replace(self.view, frame=size) if size else self.view
        recording, views = self._decode(recording, view, console)
        label = curvature_label(recording) if self.label == "curvature" else STEERING
        transforms = [transform for transform in self.augment.values() if transform]
        for transform in transforms:
            if isinstance(transform, Change):
                transform.fit(view.crop, recording.rig)
        labelled = replace(recording, steering=in_label(recording, recording.steering, label))
        for line in [*report_lines(recording), *label_lines(recording, label)]:
            console.print(line, highlight=False, markup=False, emoji=False)
        lengths = (self.block_s, self.gap_s)
        split = split_rows(
            recording, self.split, self.val_share, self.test_share, *lengths, self.split_seed
        )
        windows = Windows(self.sequence or 1, self.stride or 1, self.ahead or 0)
        if windows.is_windowed:
            console.print(windows.line(recording, split), highlight=False)
        rows, both_ways = windows.whole(recording, split.train), self.flip == "both"
        corrected = (list(self.cameras), self.offset, self.recover_s)
        data = DrivingData(
            options=self,
            recording=recording,
            labelled=labelled,
            label=label,
            view=view,
            views=views,
            split=split,
            split_by=split_words(recording, self.split, *lengths),
            samples=make_samples(labelled, rows, *corrected, both_ways, windows, label),
            augment=Augment(transforms, view.colour, label),
        )
        if data.batch_size < self.batch_size:
            line = (
                f"data.batch_size={self.batch_size}: there are {data.batch_size} training samples"
            )
            console.print(f"{line}, which are one batch", highlight=False)
        next(iter(data.sampler()))  # to report a wrong straight_cap now
        return data

    def _decode(
        self, recording: Recording, view: View, console: Console
    ) -> tuple[Recording, RowViews]:
        """Return the rows whose images can be decoded, with their views."""
        cameras = sorted({*self.cameras, "center"})  # the centre for validation and test
        views, faults = load_row_views(recording, cameras, view, self.cache_folder, console)
        if not faults:
            return recording, views
        lines = tuple(f"{recording.place(row)}: {faults[row]}" for row in sorted(faults))
        good = ~np.isin(np.arange(len(recording)), list(faults))
        self.check_images(lines, len(recording))
        return recording.keep(good, lines), views.keep(good)


def _are_weights(value: Any, count: int) -> bool:
    listed = isinstance(value, list | tuple) and len(value) == count
    return listed and all(type(each) in (int, float) and 0 < each <= 1000 for each in value)
