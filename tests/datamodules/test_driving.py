"""The datamodule as training uses it: from a folder to batches."""

import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from datamodules.augment import Brightness, Shift
from datamodules.balance import BatchKey
from datamodules.data_settings import DataSettings
from datamodules.driving import DrivingData
from datamodules.image import decode_image
from datamodules.samples import LEFT
from datamodules.view import View
from tests.recordings import write_recording, write_resized
from tests.refusals import refusal
from zoo.base.errors import InputError

VIEW = View((60, 25), "yuv", (66, 200))


@pytest.fixture
def load(recorded, console):
    """Create and load a datamodule; its default is the shared recording."""

    def make(root=None, view: View = VIEW, **settings) -> DrivingData:
        settings = {"batch_size": 16, "cache": str(recorded.views)} | settings
        settings |= {"crop": view.crop, "colour": view.colour, "size": view.size}
        return DataSettings(str(root or recorded.folder), **settings).load(console)

    return make


@pytest.mark.parametrize("size", [(66, 200), None])
def test_recordings_of_several_sizes_crop_the_same_shares(tmp_path, console, size):
    small = write_recording(tmp_path / "small", rows=20)
    folders = [str(write_resized(small, tmp_path / "large", 640, 480).folder), str(small.folder)]
    settings = DataSettings(folders, crop=(60, 25), colour="gray", size=size, cache=None)
    data = settings.load(console)
    assert data.view == replace(settings.view, frame=(480, 640)), "of the first image"
    for row in (0, len(data.recording) - 1):
        image = data.views.take(np.array([row]), 0)[0]
        np.testing.assert_array_equal(image, data.view(data.recording.image(row)))


def assert_same(batch: dict, other: dict) -> None:
    assert batch.keys() == other.keys()
    for name, tensor in batch.items():
        assert torch.equal(tensor, other[name]), name


def whole(data: DrivingData) -> BatchKey:
    """Return the key of a batch of all training samples."""
    return BatchKey(0, 0, np.arange(len(data.samples)))


@pytest.mark.parametrize(
    "view", [VIEW, View((40, 20), "gray", None), View((50, 0), "hsv_s", (11, 32))]
)
def test_batches_are_as_documented(load, view):
    data = load(view=view, augment={"brightness": Brightness(), "shift": Shift()})
    batches = list(data.train_dataloader())
    assert sum(len(batch["speed"]) for batch in batches) == len(data.samples)
    height, width, channels = view.shape
    first = batches[0]
    assert {name: (tuple(tensor.shape), tensor.dtype) for name, tensor in first.items()} == {
        "images": ((16, channels, height, width), torch.uint8),
        "speed": ((16,), torch.float32),
        "targets": ((16, 2), torch.float32),
    }
    assert first["images"].is_contiguous(memory_format=torch.channels_last)
    assert first["targets"].abs().max() <= 1


def test_unchanged_samples_are_the_views_and_their_corrected_labels(load, recorded):
    data = load(flip=0.0, offset=0.25)
    batch = data.training_batches()[whole(data)]
    for at in (0, 1, 2, 100):
        row, camera = data.samples.row[at], data.samples.camera[at]
        path = recorded.image(row, ("center", "left", "right")[camera])
        frame = VIEW(decode_image(path.read_bytes())).transpose(2, 0, 1)
        np.testing.assert_array_equal(batch["images"][at].numpy(), frame)
        steering = np.clip(recorded.steering[row] + (0, 0.25, -0.25)[camera], -1, 1)
        throttle = recorded.throttle[row] - recorded.brake[row]
        np.testing.assert_allclose(batch["targets"][at], [steering, throttle], atol=1e-6)
        assert batch["speed"][at] == pytest.approx(recorded.speed_mph[row])


@pytest.mark.parametrize(("probability", "tolerance"), [(0.25, 0.08), (1.0, 0.0)])
def test_flip_mirrors_and_negates_with_a_probability(load, probability, tolerance):
    loaded = load(flip=0.0), load(flip=probability)
    straight, flipped = (data.training_batches()[whole(data)] for data in loaded)
    mirrored = (straight["images"] != flipped["images"]).flatten(1).any(dim=1)
    assert mirrored.float().mean() == pytest.approx(probability, abs=tolerance)
    assert torch.equal(flipped["images"][mirrored], straight["images"][mirrored].flip(3))
    assert torch.equal(flipped["targets"][mirrored, 0], -straight["targets"][mirrored, 0])
    assert torch.equal(flipped["targets"][~mirrored], straight["targets"][~mirrored])
    assert torch.equal(flipped["targets"][:, 1], straight["targets"][:, 1])
    assert torch.equal(flipped["speed"], straight["speed"])


def test_steering_before_augmentation_is_that_of_the_batch(load):
    data = load(flip=0.5)
    key = next(iter(data.sampler()))
    batches = data.training_batches()
    np.testing.assert_allclose(batches.steering(key), batches[key]["targets"][:, 0])


def test_shift_reaches_the_targets(load):
    loaded = load(flip=0.0), load(flip=0.0, augment={"shift": Shift(p=1.0)})
    plain, shifted = (data.training_batches()[whole(data)] for data in loaded)
    moved = (plain["targets"] - shifted["targets"])[:, 0].abs()
    assert moved.mean() > 0.03
    assert moved.max() <= 0.16 + 1e-6


def test_augmentations_that_are_switched_off_are_left_out(load):
    plain, without = load(), load(augment={"brightness": None})
    key = next(iter(plain.sampler()))
    assert_same(plain.training_batches()[key], without.training_batches()[key])


@pytest.mark.parametrize("cameras", [["center", "left", "right"], ["left", "right"]])
@pytest.mark.parametrize("part", ["val", "test"])
def test_validation_is_centre_camera_and_true_labels(load, recorded, part, cameras):
    dark = {"dark": Brightness((0.2, 0.2))}
    data = load(cameras=cameras, offset=0.5, flip=1.0, straight_cap=0.1, augment=dark)
    assert len(set(data.samples.camera)) == len(cameras)
    batches = list(getattr(data, f"{part}_dataloader")())
    rows = getattr(data.split, part)
    images = torch.cat([batch["images"] for batch in batches]).numpy()
    targets = torch.cat([batch["targets"] for batch in batches]).numpy()
    wanted = [VIEW(decode_image(recorded.image(row).read_bytes())) for row in rows]
    np.testing.assert_array_equal(images, np.stack(wanted).transpose(0, 3, 1, 2))
    np.testing.assert_allclose(targets[:, 0], recorded.steering[rows], atol=1e-7)
    throttle = recorded.throttle[rows] - recorded.brake[rows]
    np.testing.assert_allclose(targets[:, 1], throttle, atol=1e-7)


def test_sides_are_the_same_rows_through_the_other_cameras(load):
    data = load()
    batches = data.evaluation_batches("val")
    for number, side in enumerate(batches.sides(), start=LEFT):
        [batch] = side
        images = data.views.take(data.split.val, np.full(len(data.split.val), number))
        assert torch.equal(batch["images"], torch.from_numpy(images).permute(0, 3, 1, 2))
        assert torch.equal(batch["targets"], batches[0]["targets"])


def test_without_both_side_cameras_there_are_no_sides(load):
    left, right = load(cameras=["center", "left"]).evaluation_batches("val").sides()
    assert len(left) == len(right) == 0


def test_validation_comes_in_large_batches_and_the_test_part_may_be_empty(load, monkeypatch):
    monkeypatch.setattr("datamodules.batches.EVALUATION_BATCH", 50)
    data = load(val_share=0.7, test_share=0.0, split="random")
    assert [len(batch["speed"]) for batch in data.val_dataloader()] == [50, 34]
    assert len(data.test_dataloader()) == len(data.split.test) == 0


def test_training_and_held_out_rows_never_meet(load):
    data = load()
    assert not set(data.samples.row) & (set(data.split.val) | set(data.split.test))


def test_batches_are_the_same_whoever_prepares_them(load):
    settings = {"augment": {"brightness": Brightness(), "shift": Shift()}, "flip": 0.5}
    alone, helped = load(**settings), load(**settings, workers=1)
    for batch, other in zip(alone.train_dataloader(), helped.train_dataloader(), strict=True):
        assert_same(batch, other)


def test_spawned_processes_do_not_run_the_users_script_again(load, monkeypatch):
    loader, script = load(workers=1).train_dataloader(), sys.modules["__main__"]
    monkeypatch.setattr(DataLoader, "__iter__", lambda _: iter([sys.modules["__main__"]]))
    assert [main.__spec__ or vars(main).get("__file__") for main in loader] == [None]
    assert sys.modules["__main__"] is script


def test_epochs_differ_and_come_back(load):
    loader = load(augment={"brightness": Brightness()}).train_dataloader()
    drawn = []
    for epoch in (0, 1, 0):
        loader.sampler.set_epoch(epoch)
        drawn.append(next(iter(loader)))
    assert_same(drawn[0], drawn[2])
    assert not torch.equal(drawn[0]["images"], drawn[1]["images"])


def test_seed_changes_order_and_augmentation_but_not_the_split(load):
    loaded = load(seed=1), load(seed=2)
    np.testing.assert_array_equal(loaded[0].split.test, loaded[1].split.test)
    batch, other = (next(iter(data.train_dataloader())) for data in loaded)
    assert not torch.equal(batch["targets"], other["targets"])


@pytest.fixture
def damaged(tmp_path):
    """Write a recording whose left image of row 6 is truncated."""
    written = write_recording(tmp_path / "damaged", rows=60)
    image = written.image(5, "left")
    image.write_bytes(image.read_bytes()[:1000])
    return written


def test_bad_image_stops_with_file_row_and_reason(load, damaged):
    message = refusal(load, damaged.folder)
    assert message.startswith(f"{damaged.log}, row 6: {damaged.image(5, 'left')}: ")
    assert "the image is truncated (1 of 60 rows" in message
    assert "data.on_bad_image=skip" in message


def test_a_folder_is_printed_as_it_is_named(load, tmp_path, console):
    written = write_recording(tmp_path / "ï [red] x[!red] :car:", rows=60)
    load(written.folder)
    assert f"{written.folder}: 60 rows" in console.file.getvalue().replace("\n", "")


def test_bad_image_may_be_skipped_and_is_said(load, damaged, console):
    data = load(damaged.folder, on_bad_image="skip")
    assert len(data.recording) == 59
    assert 6 not in data.recording.line
    printed = console.file.getvalue()
    assert "skipped 1 row with a bad image" in printed
    assert f"{damaged.image(5, 'left')}: the image is truncated" in printed
    row = int(np.flatnonzero(data.recording.line == 7)[0])
    image = VIEW(decode_image(damaged.image(6).read_bytes()))
    np.testing.assert_array_equal(data.views.take(np.array([row]), 0)[0], image)


def test_bad_image_of_a_camera_that_is_not_used_is_no_matter(load, damaged):
    assert len(load(damaged.folder, cameras=["center"]).recording) == 60


@pytest.mark.parametrize("on_bad_image", ["fail", "skip"])
def test_all_images_bad(load, tmp_path, on_bad_image):
    written = write_recording(tmp_path / "damaged", rows=5)
    for image in written.folder.glob("IMG/center*"):
        image.write_bytes(b"")
    with pytest.raises(InputError, match=r"row 1: .*the file is empty"):
        load(written.folder, on_bad_image=on_bad_image)


def test_what_the_data_cannot_give_is_said_on_loading(load):
    assert "cannot be held" in refusal(load, straight_threshold=2.0)


def test_a_batch_is_at_most_all_samples(load):
    data = load(batch_size=4096)
    (batch,) = data.train_dataloader()
    assert len(batch["images"]) == data.batch_size == len(data.samples)


@pytest.mark.parametrize("weights", [[1], [1, 2, 3], [1, 0], [1, -2], [1, "two"], 4, [1, True]])
def test_weights_are_one_for_each_recording(weights, recorded, console):
    settings = DataSettings([str(recorded.folder)] * 2, colour="yuv", size=None, weights=weights)
    with pytest.raises(InputError, match=r"data.weights=.* is not .* list of 2 numbers above 0"):
        settings.load(console)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("rig", ["udacity", "donkey_sim"], "rig=udacity,donkey_sim: no such file, and no rig's"),
        ("format", 2.5, "format=2.5: no such format"),
        ("split", [0.5, 2], "0.5,2"),
        ("workers", 1e3, "data.workers=1000.0: must be a whole number in 0..256"),
    ],
)
def test_a_number_or_a_list_is_read_as_text(load, key, value, words):
    assert words in refusal(load, **{key: value})


def test_a_whole_number_may_have_an_exponent(load):
    assert repr(load(split_seed=2e3).options.split_seed) == "2000"
