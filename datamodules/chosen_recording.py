"""The part of a recording that `drivezoo convert` writes: chosen rows, in another size."""

from dataclasses import replace
from functools import partial

import cv2
import numpy as np

from datamodules.format_options import WriteOptions
from datamodules.formats.recording_writer import left_out_note, whole_rows
from datamodules.image import AnyImage, StoredImage, read_image
from datamodules.recording import Recording
from datamodules.recording_edits import typed_edits


def chosen_recording(
    recording: Recording, options: WriteOptions
) -> tuple[Recording, tuple[str, ...]]:
    """Return the rows of `keep` with images of `size`, and a line on what that changes.

    Raises:
        InputError: no row has whole images.
        UsageError: `keep` names no rows of the recording.
    """
    notes: list[str] = []
    if options.keep is not None:
        kept = typed_edits(len(recording), keep_text=options.keep).kept()
        notes.append(f"{int(kept.sum()):,} of {len(recording):,} rows kept: {options.keep}")
        recording = recording.keep(kept)
    if options.size is not None:
        recording, faults = whole_rows(recording)
        notes += left_out_note(faults, "an image is damaged")
        images = recording.images.copy()
        for place, image in np.ndenumerate(images):
            if image:
                images[place] = _resized(image, options.size)
        # The camera of images in another shape is another one.
        recording = replace(recording, images=images, rig=None, rigs=())
        height, width = options.size
        notes.append(f"images resized to {width} x {height}: the car's rig is not written")
    return recording, tuple(notes)


def _resized(image: AnyImage, size: tuple[int, int]) -> StoredImage:
    if isinstance(image, StoredImage):
        file, number = image.file, image.number
    else:
        file, number = str(image), 0
    return StoredImage(file, number, partial(_resized_pixels, image, size))


def _resized_pixels(image: AnyImage, size: tuple[int, int], *_: object) -> np.ndarray:
    return cv2.resize(read_image(image), size[::-1], interpolation=cv2.INTER_AREA)
