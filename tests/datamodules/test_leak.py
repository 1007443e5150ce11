import numpy as np
import pytest

from datamodules.image import decode_image
from datamodules.leak import measure_leak, thumbnail
from datamodules.recording import read_recordings
from datamodules.split import split_rows
from tests.recordings import recording_in_memory, write_recording


@pytest.fixture(scope="module")
def lake(tmp_path_factory):
    """Return a recording of 20 s and its centre images."""
    written = write_recording(tmp_path_factory.mktemp("leak") / "lake", 300, cameras=("center",))
    recording = read_recordings(str(written.folder))
    images = [decode_image(written.image(row).read_bytes())[60:135] for row in range(300)]
    return recording, np.stack(images)


def test_random_leaks_more_than_blocks(lake):
    recording, images = lake
    leaks = {}
    for kind in ("random", "blocks"):
        split = split_rows(recording, kind, val_share=0.2, test_share=0.0, block_s=4)
        leaks[kind] = measure_leak(
            recording, split.train, split.val, lambda row: thumbnail(images[row])
        )
    assert leaks["random"].seconds < leaks["blocks"].seconds
    assert leaks["random"].likeness < leaks["blocks"].likeness


def test_seconds_to_the_nearest_training_row():
    recording = recording_in_memory(np.zeros(100))
    images = np.zeros((100, 8, 16, 1), np.uint8)
    leak = measure_leak(recording, np.arange(0, 41), np.array([70]), images.__getitem__)
    assert leak.seconds == pytest.approx(30 / 15)


def test_seconds_do_not_count_across_recordings():
    """Row 50 is the second recording's first: the first recording's last row is no neighbour."""
    recording = recording_in_memory(np.zeros(100), sizes=(50, 50))
    images = np.zeros((100, 8, 16, 1), np.uint8)
    train = np.concatenate([np.arange(50), np.arange(65, 100)])
    leak = measure_leak(recording, train, np.array([50]), images.__getitem__)
    assert leak.seconds == pytest.approx(1.0)


def test_seconds_are_unknown_without_times():
    recording = recording_in_memory(np.zeros(20))
    recording.time_s[:] = np.nan
    images = np.zeros((20, 8, 16, 1), np.uint8)
    assert np.isnan(
        measure_leak(recording, np.arange(10), np.arange(10, 20), images.__getitem__).seconds
    )


def test_a_copy_in_training_has_likeness_zero():
    noise = np.random.default_rng(0).integers(0, 256, (10, 64, 128, 3), np.uint8)
    images = np.concatenate([noise, noise])
    leak = measure_leak(
        recording_in_memory(np.zeros(20)),
        np.arange(10),
        np.arange(10, 20),
        lambda row: thumbnail(images[row]),
    )
    assert leak.likeness == 0


def test_strangers_have_likeness_near_one():
    flat = np.random.default_rng(0).integers(0, 256, (60, 8, 16, 1), np.uint8)
    leak = measure_leak(
        recording_in_memory(np.zeros(60)), np.arange(30), np.arange(30, 60), flat.__getitem__
    )
    assert 0.7 < leak.likeness < 1


def test_neighbours_are_found_in_a_long_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every image has one copy, in the next row; only a sample of rows is compared."""
    monkeypatch.setattr("datamodules.leak.COMPARED", 10)
    pairs = np.random.default_rng(0).integers(0, 256, (500, 8, 16, 1), np.uint8)
    leak = measure_leak(
        recording_in_memory(np.zeros(1000)),
        np.arange(0, 1000, 2),
        np.arange(1, 1000, 2),
        pairs.repeat(2, axis=0).__getitem__,
    )
    assert leak.likeness == 0
    assert leak.seconds == pytest.approx(1 / 15, abs=1e-3)
