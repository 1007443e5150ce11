"""Shards in a folder and at an S3 address: written, read, walked over in windows, and damaged."""

import http.server
import itertools
import shutil
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf
from rich.console import Console

from datamodules.balance import epoch_batches, shard_windows, share_of
from datamodules.driving import DrivingData
from datamodules.recording_format import read_recordings
from datamodules.samples import make_samples
from datamodules.stretches import missing_rows
from tests.contracts.test_recordings import ROWS as CONTRACT_ROWS
from tests.contracts.test_recordings import check_copied_car, check_written, ours
from tests.datamodules.test_path_contents import tub
from tests.foreign_recordings import challenge2_test
from tests.hostile.test_fuzzed_formats import FEW_AND_MANY, STRATEGIES, check_damaged
from tests.recordings import Written, write_as, write_recording
from zoo.base.compose import compose_config
from zoo.base.errors import InputError
from zoo.extras.scale import shard_store
from zoo.extras.scale.shards import LABELS
from zoo.training.build import load_data

for needed in ("litdata", "boto3", "pyarrow"):
    pytest.importorskip(needed, reason=f'{needed}: pip install "drivezoo[shards]"')

ROWS = 60
SHARD_MB = 0.03
CACHE_GB = 0.00025  # of about 1.9 MB of shards


class Server(http.server.ThreadingHTTPServer):
    """A store of one bucket: the files of a folder, as S3 sends them."""

    def __init__(self, folder: Path) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.folder, self.refuses, self.asked = folder, 0, list[str]()


class Handler(http.server.BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        path = self.server.folder / self.path.partition("?")[0].removeprefix("/bucket/")
        self.server.asked.append(path.name)
        if self.server.refuses:
            self.server.refuses -= 1
            return self.send_head(503, 0)
        if not path.is_file():
            return self.send_head(404, 0)
        data, whole = path.read_bytes(), path.stat().st_size
        first, _, last = self.headers.get("Range", "bytes=0-").removeprefix("bytes=").partition("-")
        part = data[int(first) : int(last or whole - 1) + 1]
        self.send_head(206 if "Range" in self.headers else 200, len(part), (int(first), whole))
        if self.command == "GET":
            self.wfile.write(part)
        return None

    do_HEAD = do_GET  # noqa: N815

    def send_head(self, status: int, length: int, span: tuple[int, int] = (0, 0)) -> None:
        self.send_response(status)
        self.send_header("Content-Length", str(length))
        if status == 206:
            self.send_header("Content-Range", f"bytes {span[0]}-{span[0] + length - 1}/{span[1]}")
        self.send_header("ETag", '"1"')
        self.end_headers()

    def log_message(self, *arguments: object) -> None:
        pass


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Written:
    return write_recording(tmp_path_factory.mktemp("source") / "drive", ROWS)


@pytest.fixture
def shards(source: Written, tmp_path: Path) -> Path:
    write_as("shards", read_recordings(str(source.folder)), tmp_path / "shards", shard_mb=SHARD_MB)
    return tmp_path / "shards"


@pytest.fixture
def server(shards: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    store = Server(shards.parent)
    threading.Thread(target=store.serve_forever, daemon=True).start()
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{store.server_port}")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "key")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.setattr(shard_store, "WAITS_S", (0.01, 0.01, 0.01))
    shard_store._client.cache_clear()
    yield store
    store.shutdown()
    store.server_close()


def loaded(root: object, cache: Path, *more: str) -> DrivingData:
    keys = [f"data.root={root}", f"data.cache={cache}", f"data.cache_gb={CACHE_GB}"]
    keys += ["model=lenet", "data.window_shards=3", "data.batch_size=8", "augment=[]", *more]
    return load_data(OmegaConf.create(compose_config(keys)), Console(quiet=True))


def batches(data: DrivingData, epoch: int = 0) -> list[np.ndarray]:
    keys, training = data.sampler(), data.training_batches()
    keys.set_epoch(epoch)
    return [training[key]["images"].numpy() for key in keys]


def cached(cache: Path) -> int:
    return sum(path.stat().st_size for path in cache.rglob("*.bin"))


def test_images_come_back_as_they_were_stored(source: Written, shards: Path) -> None:
    before, after = read_recordings(str(source.folder)), read_recordings(str(shards))
    for row, camera in itertools.product((ROWS - 1, 0), range(3)):
        assert after.stored(row, camera) == before.stored(row, camera)
    assert after.rig == before.rig
    assert len(list(shards.glob("*.bin"))) > 20


def test_a_missing_row_is_missing_in_the_shards(source: Written, tmp_path: Path) -> None:
    whole = read_recordings(str(source.folder))
    written = write_as("shards", whole.keep(np.arange(ROWS) != 20), tmp_path / "shards")
    assert written.drives == 2
    copy = read_recordings(str(tmp_path / "shards"))
    assert np.flatnonzero(missing_rows(copy)).tolist() == [19]


def test_what_is_written_is_detected_and_read_back_equal(tmp_path: Path) -> None:
    written = write_recording(tmp_path / "source", CONTRACT_ROWS)
    check_written("shards", read_recordings(str(written.folder)), tmp_path)


def test_a_copy_of_another_cars_recording_is_of_that_car(tmp_path: Path) -> None:
    check_copied_car("shards", tmp_path)


@FEW_AND_MANY
def test_damaged_shards(count: int, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    check_damaged(ours("shards"), {}, STRATEGIES, count, tmp_path, capsys)


def test_recordings_of_different_cars_stay_apart(source: Written, tmp_path: Path) -> None:
    folders = challenge2_test(tmp_path / "road"), tub(tmp_path / "tub")
    roads = [str(folder) for folder in (source.folder, *folders)]
    before = read_recordings(roads)
    write_as("shards", before, tmp_path / "shards")
    after = read_recordings(str(tmp_path / "shards"))
    assert after.rigs == before.rigs
    assert len({rig and rig.name for rig in after.rigs}) == 3
    np.testing.assert_array_equal(after.recording, before.recording)
    both = read_recordings([str(tmp_path / "shards"), roads[1]])
    assert both.each_rig == (*before.rigs, before.rigs[1])
    assert both.recording[-1] == 3


@pytest.mark.parametrize("rigs", ["[]", "{}", '["mine"]', '[null, {"name": 3}]', "[null]"])
def test_damaged_rigs_are_one_line(rigs: str, source: Written, tmp_path: Path) -> None:
    write_as("shards", read_recordings([str(source.folder)] * 2), tmp_path / "shards")
    (tmp_path / "shards/rigs.json").write_text(rigs)
    with pytest.raises(InputError, match=r"rigs\.json"):
        read_recordings(str(tmp_path / "shards"))


def test_litdata_itself_reads_the_shards(shards: Path) -> None:
    from litdata import StreamingDataset

    recording, dataset = read_recordings(str(shards)), StreamingDataset(str(shards))
    assert len(dataset) == ROWS * 3
    assert bytes(dataset[3]) == recording.stored(1, 0)


def test_rows_without_an_image_and_damaged_ones(source: Written, tmp_path: Path) -> None:
    recording = read_recordings(str(source.folder))
    recording.images[4, 1] = None
    (tmp_path / "cut.jpg").write_bytes(Path(recording.images[7, 0]).read_bytes()[:900])
    recording.images[7, 0] = str(tmp_path / "cut.jpg")
    written = write_as("shards", recording, tmp_path / "shards", shard_mb=SHARD_MB)
    after = read_recordings(str(tmp_path / "shards"))
    assert (written.rows, len(after)) == (ROWS - 1, ROWS - 1)
    assert "row 8" in written.notes[0]
    assert after.images[4, 1] is None


def test_an_address_trains_as_its_folder(shards: Path, server: Server, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    local, remote = loaded(shards, cache), loaded("s3://bucket/shards", cache)
    sizes = []
    for fetched, read in zip(batches(remote), batches(local), strict=True):
        np.testing.assert_array_equal(fetched, read)
        sizes.append(cached(cache))
    assert 0 < max(sizes) <= CACHE_GB * 1e9
    assert cached(shards) > 5 * CACHE_GB * 1e9


def test_a_smaller_cache_than_before_deletes_shards(server: Server, tmp_path: Path) -> None:
    address, cache = "s3://bucket/shards", tmp_path / "cache"
    recording = read_recordings(address, cache=str(cache))
    for row in range(ROWS):
        recording.image(row)
    whole = cached(cache)
    read_recordings(address, cache=str(cache), cache_gb=whole / 2e9)
    assert 0 < cached(cache) <= whole / 2


def test_corrected_labels_are_fetched(shards: Path, server: Server, tmp_path: Path) -> None:
    address, cache = "s3://bucket/shards", str(tmp_path / "cache")
    before = read_recordings(address, cache=cache)
    corrected = replace(read_recordings(str(shards)), steering=before.steering / 2)
    write_as("shards", corrected, tmp_path / "new", shard_mb=SHARD_MB)
    shutil.copy(tmp_path / "new" / LABELS, shards)
    after = read_recordings(address, cache=cache)
    np.testing.assert_array_equal(after.steering, before.steering / 2)


def test_files_that_another_process_reads_on_windows_are_kept(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(part: Path, path: Path) -> None:
        raise PermissionError(13, "The process cannot access the file", str(path))

    address, cache = "s3://bucket/shards", str(tmp_path / "cache")
    before = read_recordings(address, cache=cache)
    monkeypatch.setattr(Path, "replace", refuse)
    after = read_recordings(address, cache=cache)
    np.testing.assert_array_equal(after.steering, before.steering)


def test_an_epoch_fetches_a_shard_once(shards: Path, server: Server, tmp_path: Path) -> None:
    data = loaded("s3://bucket/shards", tmp_path / "cache")
    server.asked.clear()
    batches(data)
    used = {data.views.shards[number].file for number in np.unique(data.sampler().balance["shard"])}
    fetched = [name for name in server.asked if name.endswith(".bin")]
    assert {Path(file).name for file in used} <= set(fetched)
    # A window's cap may draw from another; HEAD and GET are two requests.
    assert len(fetched) < 2 * 1.3 * len(used)


def test_a_validation_is_of_whole_shards(shards: Path, tmp_path: Path) -> None:
    data = loaded(shards, tmp_path, "data.gap_s=0")
    first = data.views.file[:, 0]
    assert not set(first[data.split.train]) & set(first[data.split.val])


@pytest.mark.parametrize("world", [1, 2, 3])
def test_processes_walk_over_windows_of_their_own(shards: Path, world: int) -> None:
    recording = read_recordings(str(shards))
    samples = make_samples(recording, np.arange(ROWS), ["center", "left", "right"])
    shard = np.repeat(np.arange(ROWS // 2), 6)
    keys = {"shard": shard, "window_shards": 2, "world": world, "straight_cap": None}
    whole = epoch_batches(samples, 10, 0, 1, **keys)
    assert sorted(np.concatenate(whole).tolist()) == list(range(3 * ROWS))
    window = shard_windows(shard, 2, 1, 0)
    for rank in range(world):
        shares = [batch[share_of(len(batch), rank, world)] for batch in whole]
        walked = window[np.concatenate(shares)]
        assert (np.diff(walked) >= 0).all(), "never back to an earlier window"
        assert len(np.unique(walked)) <= len(np.unique(window)) // world + 2


def test_the_cap_draws_from_the_same_window(shards: Path) -> None:
    recording = read_recordings(str(shards))
    samples = make_samples(recording, np.arange(ROWS), ["center", "left", "right"], offset=0.3)
    shard = np.repeat(np.arange(ROWS // 2), 6)
    window = shard_windows(shard, 5, 1, 0)
    keys = {"shard": shard, "window_shards": 5, "straight_cap": 0.1, "straight_threshold": 0.25}
    capped = epoch_batches(samples, 30, 0, 1, **keys)
    for number, batch in enumerate(capped):
        assert (np.abs(samples.steering[batch]) < 0.25).sum() <= 3
        assert set(window[batch]) == {number}


def test_a_server_comes_back(server: Server, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    server.refuses = 2
    assert len(read_recordings("s3://bucket/shards", cache=str(tmp_path / "cache"))) == ROWS
    assert "index.json: HTTP 503; trying again" in capsys.readouterr().err


def test_a_server_that_stays_away_is_one_line(server: Server, tmp_path: Path) -> None:
    server.refuses = 99
    with pytest.raises(InputError, match=r"s3://bucket/shards/index\.json.*AWS_ENDPOINT_URL"):
        read_recordings("s3://bucket/shards", cache=str(tmp_path / "cache"))


def test_a_missing_folder_is_named_at_once(server: Server, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"s3://bucket/none/index\.json: HTTP 404.*address"):
        read_recordings("s3://bucket/none", cache=str(tmp_path / "cache"))


def test_a_shard_that_is_cut_short(shards: Path, server: Server, tmp_path: Path) -> None:
    data = loaded("s3://bucket/shards", tmp_path / "cache")
    whole = set(tmp_path.glob("cache/shards/*/*.bin"))
    for path in shards.glob("*.bin"):
        path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"s3://bucket/shards/chunk.*bytes.*to=shards"):
        batches(data)
    assert set(tmp_path.glob("cache/shards/*/*.bin")) == whole, "nothing damaged is kept"
    with pytest.raises(InputError, match=r"chunk-0-0\.bin: has .* bytes"):
        read_recordings(str(shards))


def test_a_cache_below_a_window(server: Server, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"data\.cache_gb=.*data\.window_shards"):
        loaded("s3://bucket/shards", tmp_path / "cache", "data.window_shards=30")


@pytest.mark.parametrize(
    ("old", "new"), [('"bytes"', '"pickle"'), ("chunk-0-1.bin", "../1.bin"), ('"chunks"', '"x"')]
)
def test_an_index_of_somebody_else(shards: Path, old: str, new: str) -> None:
    index = shards / "index.json"
    index.write_text(index.read_text().replace(old, new))
    with pytest.raises(InputError, match=r"index\.json.*to=shards"):
        read_recordings(str(shards))


def test_labels_that_name_no_image(shards: Path, tmp_path: Path) -> None:
    import pyarrow.compute
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(shards / LABELS)
    moved = pyarrow.compute.add(table["center"], 1000)
    at = table.column_names.index("center")
    pyarrow.parquet.write_table(table.set_column(at, "center", moved), shards / LABELS)
    with pytest.raises(InputError, match=rf"{LABELS}.*to=shards"):
        read_recordings(str(shards))


def test_shards_are_not_mixed_with_a_log(source: Written, shards: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"data\.root.*to=shards"):
        loaded(f"[{shards},{source.folder}]", tmp_path / "cache")


def test_several_folders_of_shards_are_read(source: Written, shards: Path, tmp_path: Path) -> None:
    both = read_recordings([str(source.folder), str(source.folder)])
    write_as("shards", both, tmp_path / "both", shard_mb=SHARD_MB)
    recording = read_recordings([str(shards), str(tmp_path / "both")])
    assert (len(recording), len(recording.names)) == (3 * ROWS, 3)
    assert len({Path(image.file).parent for image in recording.images[:, 0]}) == 2
