"""Cached features of images, with a simple front that counts its calls."""

import errno
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from datamodules.data_settings import DataSettings
from datamodules.driving import DrivingData
from datamodules.features import (
    MIRRORED,
    FeatureBatches,
    FeaturePlan,
    Front,
    load_features,
    plan_features,
)
from datamodules.view import View
from tests.recordings import Written
from zoo.base.errors import InputError

VIEW = View((60, 20), "rgb", (8, 20))


class Halves:
    """A front that returns every fourth pixel of the left half, divided by a number."""

    def __init__(self, divisor: float = 255.0, fail_after: int | None = None) -> None:
        self.divisor, self.fail_after, self.computed = divisor, fail_after, 0

    def front(self) -> Front:
        return Front(self, (2, 3, 3), f"halves by {self.divisor}")

    def __call__(self, images: np.ndarray) -> np.ndarray:
        if self.fail_after is not None and self.computed >= self.fail_after:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.computed += len(images)
        return (images[:, ::4, :10:4] / self.divisor).astype(np.float16)


def data_of(recorded: Written, cache: Path | None) -> DrivingData:
    view = {"crop": VIEW.crop, "colour": VIEW.colour, "size": VIEW.size}
    settings = {"cameras": ["center", "left"], "block_s": 0.5, "gap_s": 0.1, "batch_size": 16}
    folder, path = str(recorded.folder), str(cache) if cache else None
    return DataSettings(folder, cache=path, **view, **settings).load(Console(quiet=True))


def plan_of(data: DrivingData, front: Front, mirrored: bool = True) -> FeaturePlan:
    cameras, cache = data.options.cameras, data.options.cache_folder
    return plan_features(data.recording, data.views, cameras, data.view, front, mirrored, cache)


@pytest.mark.parametrize("cached", [True, False], ids=["cache", "memory"])
def test_features_are_of_the_images_and_of_the_mirrored(recorded, tmp_path, console, cached):
    data = data_of(recorded, tmp_path if cached else None)
    halves = Halves()
    plan = plan_of(data, halves.front())
    assert (plan.images, plan.missing, plan.missing_bytes) == (480, 480, 480 * 2 * 3 * 3 * 2)

    features = load_features(plan, data.views, console)

    rows, other = np.arange(120), Halves()
    for camera in (0, 1):
        for turned in (False, True):
            images = data.views.take(rows, camera, np.full(120, turned))
            values = features.take(rows, np.full(120, camera + MIRRORED * turned))
            assert values.dtype == np.float16
            np.testing.assert_array_equal(values, other(images))
    assert halves.computed == 480


def test_the_right_files_are_computed_again_and_no_others(recorded, tmp_path, console):
    data, halves = data_of(recorded, tmp_path), Halves()
    load_features(plan_of(data, halves.front(), mirrored=False), data.views, console)
    assert halves.computed == 240
    assert plan_of(data, halves.front(), mirrored=False).missing == 0
    load_features(plan_of(data, halves.front()), data.views, console)
    assert halves.computed == 480, "of the mirrored ones alone"
    load_features(plan_of(data, halves.front()), data.views, console)
    assert halves.computed == 480
    assert plan_of(data, Halves(2.0).front()).missing == 480, "another front's are others"


def test_a_batch_holds_the_features_of_the_images_that_it_would_be_fed(recorded, tmp_path, console):
    data, halves = data_of(recorded, tmp_path), Halves()
    batches = data.training_batches()
    fed = FeatureBatches(batches, load_features(plan_of(data, halves.front()), data.views, console))
    for key in data.sampler():
        given, plain = fed[key], batches[key]
        images = plain["images"].permute(0, 2, 3, 1).numpy()
        np.testing.assert_array_equal(given["images"].permute(0, 2, 3, 1).numpy(), halves(images))
        for name in ("speed", "targets"):
            np.testing.assert_array_equal(given[name], plain[name])


def test_a_disk_that_fills_leaves_no_half_file(recorded, tmp_path, console):
    data, full = data_of(recorded, tmp_path), Halves(fail_after=150)
    with pytest.raises(InputError, match=r"the features' cache, 0 MB .*No space left"):
        load_features(plan_of(data, full.front()), data.views, console)
    assert not list(tmp_path.glob("*.part"))
    again = Halves()
    load_features(plan_of(data, again.front()), data.views, console)
    assert again.computed == 360, "the file that was whole is kept"
