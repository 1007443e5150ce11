"""Augmentations on a GPU, or on a CPU in its place: what the others do, in batches."""

from dataclasses import replace

import albumentations
import numpy as np
import pytest
import torch
from rich.console import Console
from torch.utils._python_dispatch import TorchDispatchMode

from datamodules.augment import Brightness, Change, Shadow, Shift
from datamodules.augmented_batch import Augment
from datamodules.balance import BatchKey
from datamodules.bend import Bend
from datamodules.data_settings import DataSettings
from datamodules.device_batches import DeviceBatches
from datamodules.driving import DrivingData
from datamodules.image import decode_image
from datamodules.view import View, view_to_rgb
from tests.datamodules.test_augment import fitted
from tests.recordings import write_recording
from zoo.base.errors import InputError

DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")
VIEWS = dict.fromkeys(("rgb", "bgr", "yuv", "yuv_old", "hsv"), (66, 200))
VIEWS |= {"gray": (32, 64), "hsv_s": (11, 32)}
TRANSFORMS = {
    Brightness: {"p": 0.8},
    Shadow: {"p": 0.8, "num_shadows_limit": (1, 2)},
    Shift: {"rows": 4.0, "p": 0.8},
    Bend: {"p": 0.8},
}


def make(kind: type) -> Change:
    return fitted(kind(**TRANSFORMS[kind]), (40, 20))


@pytest.fixture(scope="module")
def frames(recorded) -> list[np.ndarray]:
    return [decode_image(recorded.image(row).read_bytes()) for row in range(0, 120, 2)]


def views(frames: list[np.ndarray], colour: str, times: int = 1) -> np.ndarray:
    view = View((40, 20), colour, VIEWS[colour])
    return np.tile(np.stack([view(frame) for frame in frames]), (times, 1, 1, 1))


def as_rgb(hsv: np.ndarray) -> np.ndarray:
    return np.stack([view_to_rgb(image, "hsv") for image in hsv])


def on_device(augment: Augment, images: np.ndarray, steering: np.ndarray, seed: int):
    drawn, steering = augment.draw(images.shape[-3:], steering, seed)
    placed = torch.from_numpy(images).to(DEVICE), torch.from_numpy(drawn).to(DEVICE)
    changed = augment.on_device(*placed)
    assert changed.dtype == torch.uint8
    assert changed.is_contiguous()
    return changed.cpu().numpy(), steering


CASES = {
    f"{kind.__name__}-{colour}": ((kind,), colour)
    for kind in TRANSFORMS
    for colour in VIEWS
    if colour != "hsv_s" or not getattr(kind, "lighting", False)  # it does not show light
}
CASES |= {f"all-{colour}": (tuple(TRANSFORMS), colour) for colour in ("rgb", "gray")}


@pytest.mark.parametrize(("kinds", "colour"), CASES.values(), ids=CASES)
def test_with_the_same_seed_it_is_the_same_image_but_for_rounding(kinds, colour, frames) -> None:
    images = views(frames, colour)
    steering = np.linspace(-1, 1, len(images), dtype=np.float32)
    augment = Augment([make(kind) for kind in kinds], colour)
    here, steered = augment(images, steering, seed=3)
    there, steered_there = on_device(augment, images, steering, seed=3)
    shown = [changed if colour != "hsv" else as_rgb(changed) for changed in (here, there)]
    difference = np.abs(shown[0].astype(int) - shown[1])  # a hue means little where it is grey
    assert difference.mean() < 0.4
    assert (difference > 6).mean() < 0.002, "but for an edge of a shadow here and there"
    np.testing.assert_allclose(steered_there, steered, atol=1e-6)
    unchanged = (here == images).all((1, 2, 3))
    if colour not in ("yuv", "yuv_old", "hsv"):  # OpenCV's conversion and back is not exact
        np.testing.assert_array_equal((there == images).all((1, 2, 3))[unchanged], True)


class Operations(TorchDispatchMode):
    """Lists the operations, and the shapes of what they take."""

    def __init__(self) -> None:
        super().__init__()
        self.taken: list[tuple] = []

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        shapes = [tuple(arg.shape) for arg in args if isinstance(arg, torch.Tensor)]
        self.taken.append((function.name(), shapes))
        return function(*args, **(kwargs or {}))


@pytest.mark.parametrize("colour", VIEWS)
def test_every_batch_of_a_size_takes_the_same_operations(colour, frames) -> None:
    """Whatever is drawn: nothing waits for a value, as a device would for the CPU."""
    augment = Augment([make(kind) for kind in TRANSFORMS], colour)
    images = torch.from_numpy(views(frames[:8], colour)).to(DEVICE)
    runs = []
    for seed in range(4):
        drawn, _ = augment.draw(images.shape[1:], np.zeros(8, np.float32), seed)
        with Operations() as operations:
            augment.on_device(images, torch.from_numpy(drawn).to(DEVICE))
        runs.append(operations.taken)
    assert runs[0] == runs[1] == runs[2] == runs[3]
    assert not {"aten::_local_scalar_dense", "aten::nonzero"} & {name for name, _ in runs[0]}


class Inverted(Change):
    """A user's change, which changes an image also by values of 0."""

    p = 0.5

    def draw(self, shape, rng):
        return rng.uniform(0, 1, (shape[0], 1))

    def change_one(self, image, drawn):
        image[:] = 255 - image

    def change_all(self, images, drawn):
        return 255 - images


def test_a_users_change_changes_the_chosen_samples_alone(frames) -> None:
    images = views(frames, "rgb")
    steering = np.zeros(len(images), np.float32)
    wanted, _ = Augment([Inverted()], "rgb")(images, steering, seed=3)
    changed, _ = on_device(Augment([Inverted()], "rgb"), images, steering, seed=3)
    np.testing.assert_array_equal(changed, wanted)
    assert 0 < (changed != images).any((1, 2, 3)).sum() < len(images)


@pytest.mark.parametrize("world", [2, 3])
def test_shares_are_changed_as_within_the_whole(world, frames) -> None:
    images = torch.from_numpy(views(frames, "rgb")).to(DEVICE)
    steering = np.zeros(60, np.float32)
    augment = Augment([make(kind) for kind in TRANSFORMS], "rgb")
    drawn, steered = augment.draw(images.shape[1:], steering, 5)
    whole = augment.on_device(images, torch.from_numpy(drawn).to(DEVICE))
    for rank in range(world):
        share = BatchKey(0, 0, np.arange(60), rank, world).share
        rows = share.start, 60
        drawn, corrected = augment.draw(images.shape[1:], steering[share], 5, rows)
        changed = augment.on_device(images[share], torch.from_numpy(drawn).to(DEVICE))
        assert (changed.int() - whole[share].int()).abs().max() <= 1
        assert corrected.tolist() == steered[share].tolist()


@pytest.fixture(scope="module")
def data(recorded, tmp_path_factory) -> DrivingData:
    """Load two recordings, so that views are in several files."""
    folder = tmp_path_factory.mktemp("device")
    other = write_recording(folder / "other", rows=40, seed=2, cameras=("center", "left"))
    roots = [str(recorded.folder), str(other.folder)]
    settings = {"batch_size": 16, "block_s": 0.5, "gap_s": 0.1, "cache": str(folder / "c")}
    return DataSettings(roots, colour="rgb", size=(66, 200), **settings).load(Console(quiet=True))


@pytest.mark.parametrize("room", [None, 0], ids=["resident", "copied"])
def test_without_augmentation_its_batches_are_the_cpus(data, room) -> None:
    ours = data.training_batches()
    theirs = DeviceBatches(ours, DEVICE, room)
    assert (theirs.resident is None) == (room == 0)
    for rank, key in enumerate(data.sampler()):
        key = BatchKey(key.epoch, key.number, key.samples, rank % 3, 3)
        batch, (placed,) = ours[key], theirs.finish([theirs[key]])
        assert batch.keys() == placed.keys()
        for name, tensor in batch.items():
            assert torch.equal(tensor, placed[name].cpu()), name
            assert tensor.dtype == placed[name].dtype
    assert placed["images"].is_contiguous(memory_format=torch.channels_last)


def test_views_that_do_not_fit_stay_where_they_are(data) -> None:
    size = sum(file.nbytes for file in data.views.files)
    assert DeviceBatches(data.training_batches(), DEVICE, size).resident is not None
    assert DeviceBatches(data.training_batches(), DEVICE, size - 1).resident is None


@pytest.mark.parametrize(
    ("setting", "device", "augment", "made"),
    [
        ("auto", "cpu", [Brightness()], None),
        ("auto", "meta", [Brightness()], "meta"),
        ("auto", "meta", [Brightness(), albumentations.GaussNoise()], None),
        ("device", "cpu", [Brightness()], "cpu"),
        ("cpu", "meta", [Brightness()], None),
    ],
)
def test_where_batches_are_made(data, monkeypatch, console, setting, device, augment, made) -> None:
    monkeypatch.setattr(data, "options", replace(data.options, augment_on=setting))
    monkeypatch.setattr(data, "augment", Augment(augment, "rgb"))
    chosen = data.choose_batch_device(torch.device(device), console)
    assert chosen == (torch.device(made) if made else None)
    printed = console.file.getvalue()
    if len(augment) > 1:
        assert "augmented on the CPU" in printed
        assert "GaussNoise" in printed
    else:
        assert printed == ""


def test_what_only_the_cpu_can_do_is_refused_on_a_device(data, monkeypatch) -> None:
    monkeypatch.setattr(data, "options", replace(data.options, augment_on="device"))
    monkeypatch.setattr(data, "augment", Augment([Shift(), albumentations.GaussNoise()], "rgb"))
    with pytest.raises(InputError, match=r"GaussNoise has no equivalent .*; leave it out"):
        data.choose_batch_device(DEVICE, Console(quiet=True))
