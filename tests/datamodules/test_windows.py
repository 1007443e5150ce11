"""Windows of rows: what is in one, what it never crosses, and that it changes as one."""

from dataclasses import replace

import albumentations
import numpy as np
import pytest
import torch

from datamodules.augment import Brightness, Shadow, Shift
from datamodules.augmented_batch import Augment
from datamodules.balance import BatchKey
from datamodules.bend import Bend
from datamodules.data_settings import DataSettings
from datamodules.driving import DrivingData
from datamodules.recording import Recording
from datamodules.samples import make_samples
from datamodules.split import PARTS
from datamodules.windows import Windows
from tests.datamodules.test_augment import fitted
from tests.datamodules.test_device_augment import on_device
from tests.recordings import recording_in_memory, write_recording
from tests.refusals import refusal
from zoo.base.rig import MPS_PER_MPH, UDACITY

VIEW = {"crop": (60, 25), "colour": "yuv", "size": (33, 100)}
SMALLER = {"crop": (60, 25), "colour": "gray", "size": (8, 16), "cameras": ["center"]}
WINDOWS = {"sequence": 3, "stride": 2, "ahead": 1}
SETTINGS = {"batch_size": 16, "block_s": 3.0, "gap_s": 0.1, "straight_cap": None}


@pytest.fixture(scope="module")
def lake(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("windows") / "lake", rows=300)


@pytest.fixture
def load(lake, console):
    """Create and load a datamodule of a recording of 300 rows."""
    usual = SETTINGS | VIEW | {"root": str(lake.folder), "cache": str(lake.views)}
    return lambda **settings: DataSettings(**usual | settings).load(console)


def some(data: DrivingData, rank: int = 0, world: int = 1) -> BatchKey:
    """Return the key of a batch of samples from all over the recording."""
    return BatchKey(0, 0, np.arange(len(data.samples))[:: len(data.samples) // 24], rank, world)


def singles(data: DrivingData, rows: list[int], camera: int) -> BatchKey:
    """Return the key of the samples of these rows, in order."""
    numbers = {pair: at for at, pair in enumerate(zip(data.samples.row, data.samples.camera))}  # noqa: B905
    return BatchKey(0, 0, np.array([numbers[row, camera] for row in rows]))


@pytest.mark.parametrize("recover_s", [None, 2.0])
def test_a_window_is_a_row_those_before_it_and_targets_ahead(load, recover_s):
    data = load(flip=0.0, recover_s=recover_s, **WINDOWS)
    plain = load(flip=0.0, recover_s=recover_s)
    key = some(data)
    batch = data.training_batches()[key]
    count = len(key.samples)
    assert batch["images"].shape == (count, 3, 3, 33, 100)
    assert batch["images"].flatten(0, 1).is_contiguous(memory_format=torch.channels_last)
    assert batch["targets"].shape == (count, 4, 2)
    for at, number in enumerate(key.samples):
        row, camera = data.samples.row[number], data.samples.camera[number]
        rows = [row - 4, row - 2, row, row + 2]
        frames = plain.training_batches()[singles(plain, rows, camera)]
        assert torch.equal(batch["images"][at], frames["images"][:3])
        steps = 3 if camera else 4  # a side camera returns to the line in the step ahead
        assert torch.equal(batch["targets"][at, :steps], frames["targets"][:steps])
        assert batch["speed"][at] == frames["speed"][2]


@pytest.mark.parametrize("settings", [{"offset": 0.2}, {"recover_s": 1.0}])
def test_a_side_camera_returns_to_the_line_in_the_steps_ahead(load, settings):
    """Driven by the labels of a left camera on a straight, the car ends on the line."""
    data = load(flip=0.0, ahead=40, **settings)
    assert (np.abs(data.samples.row_rate - 15) < 0.1).all()
    left = np.flatnonzero(data.samples.camera == 1)[:5]
    assert len(left) == 5
    steering = data.samples.labels(left)[0].astype(float)
    steering -= data.recording.steering[data.windows.targets(data.samples.row[left])]
    step_m = data.samples.speed_mph[left][:, None] * MPS_PER_MPH / data.samples.row_rate[0]
    bend = np.tan(np.radians(steering * UDACITY.steering_deg)) / UDACITY.wheelbase_m
    heading = np.cumsum((bend[:, 1:] + bend[:, :-1]) / 2 * step_m, axis=1)  # trapezoids
    right_m = UDACITY.cameras["left"].right_m + np.cumsum(heading * step_m, axis=1)
    assert (steering[:, 0] > 0.05).all()
    assert (np.diff(steering[:, :5]) < 0).all()
    assert (np.abs(right_m[:, -1]) < 0.1).all()
    assert (np.abs(right_m).max(1) < 0.82).all()


def test_a_joined_recording_keeps_its_own_steps_ahead():
    joined = recording_in_memory(np.zeros(40), sizes=(20, 20))
    joined.time_s[20:] = 9_000 + np.arange(20) / 60

    def left(recording: Recording, row: int) -> list[float]:
        samples = make_samples(recording, np.array([row]), ["left"], 0.2, windows=Windows(ahead=3))
        return samples.labels(np.array([0]))[0].tolist()

    assert left(joined, 25) == left(joined.keep(joined.recording == 1), 5) != left(joined, 5)


def test_windows_of_one_frame_are_single_frames(load):
    """Flips and augmentation, too, have the same random draws."""
    augment = {"brightness": Brightness(), "shift": Shift(), "blur": albumentations.GaussianBlur()}
    data, plain = load(ahead=1, augment=augment), load(augment=augment)
    key = some(data)
    pairs = zip(data.samples.row[key.samples], data.samples.camera[key.samples], strict=True)
    same = np.concatenate([singles(plain, [row], camera).samples for row, camera in pairs])
    window = data.training_batches()[key]
    single = plain.training_batches()[BatchKey(0, 0, same)]
    assert torch.equal(window["images"][:, 0], single["images"])
    assert torch.equal(window["targets"][:, 0], single["targets"])
    assert torch.equal(window["speed"], single["speed"])


@pytest.mark.parametrize("flip", [1.0, "both"])
@pytest.mark.parametrize("view", [VIEW, SMALLER], ids=["large", "small"])
def test_a_window_is_flipped_as_one(load, flip, view):
    settings = view | WINDOWS
    data, mirrored = load(flip=0.0, **settings), load(flip=flip, **settings)
    key = some(data)
    samples = key.samples + len(mirrored.samples) // 2 if flip == "both" else key.samples
    straight = data.training_batches()[key]
    flipped = mirrored.training_batches()[BatchKey(0, 0, samples)]
    assert torch.equal(flipped["images"], straight["images"].flip(-1))
    assert torch.equal(flipped["targets"], straight["targets"] * torch.tensor([-1.0, 1.0]))


def test_the_cap_and_the_histogram_are_of_the_newest_frame(load):
    data = load(straight_cap=0.25, flip=0.0, **WINDOWS)
    batches = data.training_batches()
    for key in data.sampler():
        targets = batches[key]["targets"][:, 2, 0].numpy()
        assert (np.abs(targets) < 0.1).sum() <= len(targets) // 4
        np.testing.assert_array_equal(batches.steering(key), targets)


TRANSFORMS = {
    "brightness": lambda: Brightness(p=0.6),
    "shadow": lambda: Shadow(num_shadows_limit=(1, 2), p=0.6),
    "shift": lambda: Shift(p=0.6),
    "bend": lambda: fitted(Bend(p=0.6)),
    "blur": lambda: albumentations.GaussianBlur(p=0.6),
    "noise": lambda: albumentations.GaussNoise(p=0.6),
}


def random_windows() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    images = rng.integers(0, 256, (7, 3, 24, 40, 3), dtype=np.uint8)
    return images, rng.uniform(-0.5, 0.5, (7, 5)).astype(np.float32)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        *((Augment.__call__, name) for name in TRANSFORMS),
        *((on_device, name) for name in ("brightness", "shadow", "shift", "bend")),
    ],
)
def test_a_window_is_augmented_as_one(change, name):
    """Each of its frames, and each target, is changed as if it were alone with the same draws."""
    augment = Augment([TRANSFORMS[name]()], "yuv")
    images, steering = random_windows()
    changed, turned = change(augment, images, steering, seed=3)
    assert changed.shape == images.shape
    assert (changed != images).any()
    for at in range(5):
        alone, angle = change(augment, images[:, min(at, 2)], steering[:, at], seed=3)
        if at < 3:
            np.testing.assert_array_equal(changed[:, at], alone)
        np.testing.assert_array_equal(turned[:, at], angle)


def test_groups_of_batches_on_a_device_are_the_same_batches(load):
    data, device = load(batch_size=64, **WINDOWS), torch.device("cpu")
    feed = data.with_feed(device, 3)
    drawn = list(feed.train_dataloader())
    groups = [feed.transfer_batch_to_device(group, device, 0) for group in drawn]
    assert [len(group) for group in groups[:-1]] == [3] * (len(groups) - 1)
    fed = [batch for group in groups for batch in group]
    for batch, other in zip(data.train_dataloader(), fed, strict=True):
        assert all(torch.equal(tensor, other[name]) for name, tensor in batch.items())


SINGLE_OR_WINDOWS = pytest.mark.parametrize("windows", [{}, WINDOWS], ids=["single", "windows"])


@pytest.mark.parametrize("world", [2, 3, 4])
@pytest.mark.parametrize("flip", [0.5, "both"])
@SINGLE_OR_WINDOWS
def test_shards_together_are_the_batch_of_one_process(load, windows, flip, world):
    """So are flips, augmentations of ours and of albumentations, and shards without a sample."""
    augment = {name: TRANSFORMS[name]() for name in ("brightness", "shadow", "shift", "blur")}
    batches = load(flip=flip, augment=augment, **windows).training_batches()
    for samples in (np.arange(40, 60), np.arange(6, 8), np.arange(7, 8)):
        key = BatchKey(0, 3, samples)
        shards = [replace(key, rank=rank, world=world) for rank in range(world)]
        for name, tensor in batches[key].items():
            assert torch.equal(torch.cat([batches[shard][name] for shard in shards]), tensor), name
        steering = np.concatenate([batches.steering(shard) for shard in shards])
        np.testing.assert_array_equal(steering, batches.steering(key))


def test_evaluation_has_the_rows_whose_past_is_in_their_part(load):
    data, plain = load(**WINDOWS), load()
    for part in PARTS:
        batches, alone = data.evaluation_batches(part), plain.evaluation_batches(part)
        held = set(alone.rows.tolist())
        assert 0 < len(batches.rows) < len(held)
        wanted = [row for row in alone.rows if {row - 4, row - 3, row - 2, row - 1} <= held]
        assert batches.rows.tolist() == wanted
        images = torch.cat([batch["images"] for batch in batches])
        frames = dict(zip(alone.rows, torch.cat([batch["images"] for batch in alone]), strict=True))
        for row, window in zip(batches.rows, images, strict=True):
            assert torch.equal(window, torch.stack([frames[row - 4], frames[row - 2], frames[row]]))
        targets = torch.cat([batch["targets"] for batch in batches])
        assert torch.equal(targets[:, 0], torch.tensor(data.recording.steering[wanted]).float())


@pytest.mark.parametrize("world", [1, 2, 3, 13])
@SINGLE_OR_WINDOWS
def test_shards_of_the_evaluation_together_are_all_rows_in_order(load, windows, world):
    """With 11 rows and 13 ranks, two ranks have one empty batch."""
    batches = load(**windows).evaluation_batches("val")
    batches = replace(batches, rows=batches.rows[:11])
    shards = [batches.share(rank, world) for rank in range(world)]
    sizes = [len(shard.rows) for shard in shards]
    assert max(sizes) - min(sizes) <= 1
    parts = [batch for shard in shards for batch in shard]
    assert len(parts) == world
    for name, tensor in batches[0].items():
        assert {part[name].shape[1:] for part in parts} == {tensor.shape[1:]}, name
        assert torch.equal(torch.cat([part[name] for part in parts]), tensor), name


def test_sides_need_the_side_images_of_all_frames(load):
    data = load(**WINDOWS)
    batches = data.evaluation_batches("val")
    row = batches.rows[4]
    data.views.file[row - 2, 1] = -1
    left, right = batches.sides()
    missing = {row - 2, row, row + 2}
    assert left.rows.tolist() == [other for other in batches.rows if other not in missing]
    assert right[0]["images"].shape[1:] == (3, 3, 33, 100)


def test_a_window_crosses_no_pause_recording_skipped_row_or_part():
    recording = recording_in_memory(np.zeros(40), sizes=(15, 25))
    recording.time_s[25:] += 5.0
    recording.line[33:] += 1  # a row with a bad image is left out
    part = np.setdiff1d(np.arange(40), [5])
    windows = Windows(sequence=2, stride=2, ahead=1)
    # Runs: 0-4, 6-14, 15-24, 25-32, 33-39; a window is row - 2, row, row + 2.
    runs = ((0, 4), (6, 14), (15, 24), (25, 32), (33, 39))
    wanted = [row for first, last in runs for row in range(first + 2, last - 1)]
    assert windows.whole(recording, part).tolist() == wanted
    rows = windows.past.whole(recording, part)
    assert rows.tolist() == [row for first, last in runs for row in range(first + 2, last + 1)]


@pytest.mark.parametrize("usual_s", [1 / 15, 0.2])
def test_a_longer_time_to_the_next_row_is_a_pause(usual_s):
    """It is judged by each recording's own rate; recordings without times have no pause."""
    recording = recording_in_memory(np.zeros(30), sizes=(10, 10, 10))
    for start, step in ((0, usual_s), (10, 0.05)):
        recording.time_s[start : start + 10] = start + step * np.arange(10)
        recording.time_s[start + 4 : start + 10] += 1.5 * step  # slow, but no pause
        recording.time_s[start + 7 : start + 10] += 2.5 * step
    recording.time_s[20:] = np.nan
    rows = Windows(sequence=2).whole(recording, np.arange(30))
    assert np.setdiff1d(np.arange(30), rows).tolist() == [0, 7, 10, 17, 20]


def test_every_frame_has_an_image_of_the_samples_camera():
    recording = recording_in_memory(np.zeros(12))
    recording.images[6, 1] = None
    windows = Windows(sequence=3)
    rows = windows.whole(recording, np.arange(12))
    samples = make_samples(recording, rows, ["center", "left"], windows=windows)
    assert samples.row[samples.camera == 0].tolist() == list(range(2, 12))
    assert samples.row[samples.camera == 1].tolist() == [2, 3, 4, 5, 9, 10, 11]


def test_weights_are_those_of_the_newest_rows_recording(lake, load, tmp_path):
    other = write_recording(tmp_path / "other", rows=100, seed=1, cameras=("center",))
    data = load(root=[str(lake.folder), str(other.folder)], weights=[1, 5], **WINDOWS)
    drawn = np.concatenate([key.samples for key in data.sampler()])
    number = data.recording.recording[data.samples.row]
    assert (number[drawn] == 1).sum() == pytest.approx(5 * (number == 1).sum(), abs=1)


def test_loading_prints_how_many_rows_have_a_window(load, console):
    data = load(**WINDOWS)
    line = next(text for text in console.file.getvalue().splitlines() if "windows of 3" in text)
    assert f"{len(data.evaluation_batches('val').rows)} of {len(data.split.val)} val" in line


@pytest.mark.parametrize(
    ("settings", "fault"),
    [
        ({"sequence": 100}, "no val row"),
        ({"sequence": 100, "stride": 5}, "no train row"),
        ({"sequence": 9, "split": "random"}, "data.block_s"),
    ],
)
def test_wrong_windows_are_refused_in_one_line(load, settings, fault):
    assert fault in refusal(load, **settings)
