"""LeRobot datasets: a recording there and back, foreign datasets, and damaged ones."""

import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from datamodules.format_options import ReadOptions
from datamodules.image import read_image
from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from datamodules.stretches import find_breaks
from tests import foreign_recordings as foreign
from tests.contracts import test_recordings as contract
from tests.datamodules.exchange.test_parquet_types import RAGGED
from tests.datamodules.test_recording_sizes import notes
from tests.recordings import Written, convert_to_recording, write_as, write_recording, write_resized
from tests.refusals import refusal
from tests.zoo.command_runs import run_here
from tests.zoo.commands.test_convert import check_a_missing_row, check_rows_and_size
from tests.zoo.extras.formats.rare_recordings import described_images
from zoo.base.errors import InputError, UsageError
from zoo.base.rig import UDACITY
from zoo.commands.convert import convert
from zoo.extras.formats.lerobot import read
from zoo.extras.formats.lerobot_features import Meaning, find_meaning
from zoo.extras.formats.video_frames import read_frames, video_writer

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

LABELS = ("steering", "throttle", "brake", "speed_mph", "time_s")
ROWS = np.r_[0:20, 60:80]
CENTER = "videos/observation.images.center/chunk-000/file-000.mp4"
DATA = "data/chunk-000/file-000.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
FILE_INDEX = "videos/observation.images.center/file_index"


@pytest.fixture(scope="module")
def source(recorded: Written) -> Recording:
    """Return 40 rows with a pause after the first 20."""
    whole = read_recordings(str(recorded.folder))
    return whole.keep(np.isin(np.arange(len(whole)), ROWS))


@pytest.fixture(scope="module")
def dataset(source: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("datasets") / "lake"
    write_as("lerobot", source, out)
    return out


@pytest.fixture
def copy(dataset: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(dataset, tmp_path / "copy"))


def table(dataset: Path, name: str = DATA) -> dict:
    return pq.read_table(dataset / name).to_pydict()


def write_table(path: Path, columns: dict[str, object]) -> None:
    pq.write_table(pa.table(columns), path)


def come_back(dataset: Path, folder: Path) -> Recording:
    """Return the recording that a dataset is converted to."""
    convert_to_recording(dataset, folder)
    return read_recordings(str(folder))


def test_a_recording_comes_back(source: Recording, dataset: Path, tmp_path: Path) -> None:
    result = convert_to_recording(dataset, tmp_path / "again")
    again = read_recordings(str(tmp_path / "again"))
    for name in LABELS:
        np.testing.assert_array_equal(getattr(again, name), getattr(source, name))
    for new, old in zip(again.images.flat, source.images.flat, strict=True):
        difference = read_image(new).astype(float) - read_image(old)
        assert np.abs(difference).mean() < 3, "the tolerance in docs/exchange.md"
        assert abs(difference.mean()) < 0.5, "frames are not darker"
    assert np.flatnonzero(find_breaks(again)).tolist() == [19]
    assert (result.rows, result.drives, result.notes) == (40, 2, ())


@pytest.mark.parametrize("word", ["fps=10", "crf=30", "task=park"])
def test_a_key_of_lerobot_is_refused_for_another_format(
    word: str, recorded: Written, tmp_path: Path
) -> None:
    words = (str(recorded.folder), "to=donkeycar", word, f"out={tmp_path / 'new'}")
    with pytest.raises(UsageError, match=f"{word}: to=donkeycar does not use it; leave"):
        convert.main(words)


def test_images_of_one_camera_keep_their_size_but_for_an_odd_column(tmp_path: Path) -> None:
    written = write_recording(tmp_path / "one", 8, cameras=("center",))
    odd = write_resized(written, tmp_path / "odd", 455, 256)
    write_as("lerobot", read_recordings(str(odd.folder)), tmp_path / "dataset", crf=30)
    info = json.loads((tmp_path / "dataset/meta/info.json").read_text())
    assert info["features"]["observation.images.center"]["shape"] == [256, 454, 3]
    assert "observation.images.left" not in info["features"]
    again = come_back(tmp_path / "dataset", tmp_path / "again")
    assert again.frame_size() == (256, 454)
    assert again.images[0, 1] is None


def test_images_of_another_shape_are_stretched_and_counted(tmp_path: Path) -> None:
    written = write_recording(tmp_path / "one", 8, cameras=("center",))
    square = write_resized(written, tmp_path / "square", 160, 160)
    both = read_recordings([str(written.folder), str(square.folder)])
    (note,) = write_as("lerobot", both, tmp_path / "dataset", crf=30).notes
    assert note.startswith("8 images of another shape are stretched to 320 x 160 (the first: ")
    assert "square/driving_log.csv, row 1" in note


def test_the_tables_are_lerobots(source: Recording, dataset: Path) -> None:
    info = json.loads((dataset / "meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["total_episodes"]) == ("v3.0", 15, 2)
    assert info["features"]["action"]["names"] == ["steering", "throttle", "brake"]
    rows = table(dataset)
    assert rows["frame_index"] == [*range(20), *range(20)]
    assert rows["episode_index"] == [0] * 20 + [1] * 20
    assert rows["steering"] == source.steering.tolist()
    assert np.array(rows["action"])[:, 0].tolist() == source.steering.astype(np.float32).tolist()
    assert rows["timestamp"][21] == np.float32(1 / 15)
    episodes = table(dataset, EPISODES)
    assert episodes["dataset_to_index"] == [20, 40]
    key = "videos/observation.images.left"
    assert episodes[f"{key}/file_index"] == [0, 1]
    assert episodes[f"{key}/from_timestamp"] == [0.0, 0.0]
    # pandas reads the tasks' words as its index by this note.
    about = json.loads(pq.read_schema(dataset / "meta/tasks.parquet").metadata[b"pandas"])
    assert about["index_columns"] == ["task"]
    stats = json.loads((dataset / "meta/stats.json").read_text())
    assert stats["action"]["mean"][0] == pytest.approx(source.steering.mean(), abs=1e-6)
    assert np.shape(stats["observation.images.right"]["q50"]) == (3, 1, 1)
    mean = np.mean([read_image(path) for path in source.images[::10, 0]], (0, 1, 2)) / 255
    assert np.ravel(stats["observation.images.center"]["mean"]) == pytest.approx(mean, abs=0.02)


def test_long_drives_are_cut_and_come_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zoo.extras.formats.lerobot_export.MOST_S", 1)
    whole = read_recordings(str(write_recording(tmp_path / "one", 80, cameras=("center",)).folder))
    source = whole.keep(np.isin(np.arange(len(whole)), ROWS))
    assert write_as("lerobot", source, tmp_path / "lr").drives == 4
    videos = [path.parts[-3] for path in (tmp_path / "lr/videos").rglob("*.mp4")]
    assert videos == ["observation.images.center"] * 4
    again = come_back(tmp_path / "lr", tmp_path / "again")
    np.testing.assert_array_equal(again.time_s, source.time_s)
    assert np.flatnonzero(find_breaks(again)).tolist() == [19]
    before, after = (log.image(33).astype(float) for log in (source, again))
    assert np.abs(after - before).mean() < 3


def test_no_episode_reaches_over_rows_that_a_recording_without_times_lacks(
    source: Recording, tmp_path: Path
) -> None:
    timeless = replace(source, time_s=np.full(len(source), np.nan))
    assert write_as("lerobot", timeless, tmp_path / "copy").drives == 2
    assert np.flatnonzero(find_breaks(read_recordings(str(tmp_path / "copy")))).tolist() == [19]


def test_only_drivezoos_own_datasets_are_of_udacitys_car(copy: Path) -> None:
    assert read_recordings(str(copy)).rig == UDACITY
    _info(copy, robot_type="my_robot")
    assert read_recordings(str(copy)).rig is None


def write_foreign(folder: Path, steering: str = "steering wheel", png: bool = False) -> Path:
    """Write a dataset as other programs do: no columns of drivezoo, images of 96 x 64."""
    names = {"axes": ["gas pedal", steering]}
    camera = {"dtype": "image" if png else "video", "shape": [64, 96, 3], "names": None}
    features = {
        "action": {"dtype": "float32", "shape": [2], "names": names},
        "observation.state": {"dtype": "float32", "shape": [1], "names": ["speed_kmh"]},
        "observation.images.front_left": camera,
        "observation.images.top": camera,
    }
    (folder / "meta").mkdir(parents=True)
    info = {"codebase_version": "v3.0", "fps": 10, "features": features}
    (folder / "meta/info.json").write_text(json.dumps(info))
    frames = [np.full((64, 96, 3), 20 * number, np.uint8) for number in range(10)]
    columns = {
        "action": pa.array([[0.5, number / 10] for number in range(10)], pa.list_(pa.float32(), 2)),
        "observation.state": pa.array([36.0] * 10, pa.float32()),
        "episode_index": [0] * 6 + [1] * 4,
        "timestamp": [number / 10 for number in [*range(6), *range(4)]],
    }
    episodes: dict[str, list] = {"episode_index": [0, 1]}
    for key in list(features)[2:]:
        if png:
            data = [cv2.imencode(".png", frame)[1].tobytes() for frame in frames]
            columns[key] = [{"bytes": image, "path": "../../etc/passwd"} for image in data]
            continue
        path = folder / f"videos/{key}/chunk-000/file-000.mp4"
        path.parent.mkdir(parents=True)
        with video_writer(path, (96, 64), 10, 18) as video:
            for frame in frames:
                video.add(frame)
        episodes |= {f"videos/{key}/chunk_index": [0, 0], f"videos/{key}/file_index": [0, 0]}
        episodes[f"videos/{key}/from_timestamp"] = [0.0, 0.6]
    for name, contents in ((DATA, columns), (EPISODES, episodes)):
        (folder / name).parent.mkdir(parents=True)
        pq.write_table(pa.table(contents), folder / name)
    return folder


@pytest.mark.parametrize("png", [False, True])
def test_a_foreign_dataset_is_understood_by_its_names(png: bool, tmp_path: Path) -> None:
    result = convert_to_recording(write_foreign(tmp_path / "foreign", png=png), tmp_path / "new")
    new = read_recordings(str(tmp_path / "new"))
    assert new.steering.tolist() == [float(np.float32(number / 10)) for number in range(10)]
    assert new.throttle.tolist() == [0.5] * 10
    assert new.speed_mph == pytest.approx(22.369, abs=0.001)
    assert np.flatnonzero(find_breaks(new)).tolist() == [5]
    seen = [read_image(path).mean() for path in new.images[:, 0]]
    assert seen == pytest.approx([20 * number for number in range(10)], abs=3)
    notes = "\n".join(result.notes)
    assert "steering is action:1 (steering wheel)" in notes
    assert "throttle is action:0 (gas pedal)" in notes
    assert "speed is observation.state:0 (speed_kmh)" in notes
    assert read_image(new.images[0, 0]).shape == (64, 96, 3), "its own size"
    assert ("observation.images.front_left" in notes) is False


def as_version_2(folder: Path) -> Path:
    """Rewrite a dataset of `write_foreign` as versions 2.0 and 2.1 do: files by episode."""
    whole = pq.read_table(folder / DATA)
    for episode, (first, count) in enumerate([(0, 6), (6, 4)]):
        name = f"data/chunk-000/episode_{episode:06d}.parquet"
        pq.write_table(whole.slice(first, count), folder / name)
        for key in [path.name for path in (folder / "videos").glob("obs*")]:
            frames = list(read_frames(folder / "videos" / key / "chunk-000" / "file-000.mp4"))
            video = folder / "videos" / "chunk-000" / key / f"episode_{episode:06d}.mp4"
            video.parent.mkdir(parents=True, exist_ok=True)
            with video_writer(video, (96, 64), 10, 18) as writer:
                for frame in frames[first : first + count]:
                    writer.add(frame)
    (folder / DATA).unlink()
    shutil.rmtree(folder / EPISODES.partition("/chunk")[0])
    paths = {
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": "videos/chunk-{episode_chunk:03d}/{video_key}/"
        "episode_{episode_index:06d}.mp4",
    }
    _info(folder, codebase_version="v2.1", **paths)
    return folder


def test_version_2_has_a_file_for_each_episode(tmp_path: Path) -> None:
    recording = read(as_version_2(write_foreign(tmp_path / "old")), ReadOptions())
    assert recording.steering.tolist() == [float(np.float32(number / 10)) for number in range(10)]
    assert np.flatnonzero(find_breaks(recording)).tolist() == [5]
    seen = [recording.image(row).mean() for row in range(10)]
    assert seen == pytest.approx([20 * number for number in range(10)], abs=4)


def test_what_no_name_tells_is_asked_for(tmp_path: Path) -> None:
    foreign = write_foreign(tmp_path / "foreign", steering="joint_2")
    with pytest.raises(InputError, match=r"steering=.*action:1"):
        convert_to_recording(foreign, tmp_path / "new")
    with pytest.raises(UsageError, match="action:0, action:1"):
        convert_to_recording(foreign, tmp_path / "new", ReadOptions(steering="action:9"))
    rear = ReadOptions(steering="action:1", camera="rear")
    with pytest.raises(UsageError, match="front_left"):
        convert_to_recording(foreign, tmp_path / "new", rear)
    front = ReadOptions(steering="action:1", camera="front_left")
    convert_to_recording(foreign, tmp_path / "new", front)
    assert read_recordings(str(tmp_path / "new")).steering[3] == np.float32(0.3)


def meaning_of(*names: str) -> Meaning:
    """Return what the numbers of an action with these names mean."""
    action = {"dtype": "float32", "shape": [len(names)], "names": list(names)}
    features = {"action": action, "observation.images.front": {"dtype": "video"}}
    return find_meaning(features, "info.json", None, None, "mps")


@pytest.mark.parametrize(
    ("name", "mps"),
    [
        ("speed_mph", 0.44704),
        ("speed_kmph", 1 / 3.6),
        ("velocity.km/h", 1 / 3.6),
        ("kph_speed", 1 / 3.6),
        ("speed_mps", 1.0),
    ],
)
def test_a_speeds_name_has_its_unit_and_a_turns_velocity_is_none(name: str, mps: float) -> None:
    meaning = meaning_of("steering", "angular_velocity", "yaw_velocity", name)
    assert meaning.mph == pytest.approx(mps / 0.44704)
    assert not meaning.assumed_unit


def test_one_number_for_both_pedals_is_the_throttle_alone() -> None:
    roles = meaning_of("steering", "throttle_brake").roles
    places = {role: str(part) for role, part in roles.items()}
    assert places == {"steering": "action:0", "throttle": "action:1"}


def _info(dataset: Path, **changed: object) -> None:
    path = dataset / "meta/info.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changed))


def _rewrite(dataset: Path, column: str, values: list, name: str = DATA) -> None:
    write_table(dataset / name, table(dataset, name) | {column: values})


def _put(dataset: Path, column: str, value: float | None) -> None:
    """Put a value in the seventh row."""
    values = table(dataset)[column]
    _rewrite(dataset, column, [*values[:6], value, *values[7:]])


def _spoil(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[-20_000:-2_000] = bytes(range(256)) * (18_000 // 256)
    path.write_bytes(data)


def _halve(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _camera(dataset: Path, key: str) -> None:
    features = {"steering": {"dtype": "float64", "shape": [1]}, key: {"dtype": "video"}}
    _info(dataset, features=features)


# ffmpeg would follow it to another file.
PLAYLIST = b"#EXTM3U\n#EXTINF:1,\n/etc/passwd\n#EXT-X-ENDLIST\n"


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda log: _info(log, codebase_version="v1.6"), "info.json: codebase_version is 'v1.6'"),
        (lambda log: _info(log, data_path="../{chunk_index}"), "info.json: data_path"),
        (lambda log: _info(log, video_path="{video_key.__class__}"), "info.json: video_path"),
        (lambda log: _info(log, fps="many"), "info.json: fps"),
        (lambda log: _info(log, features=[1]), "info.json: features"),
        (lambda log: _camera(log, "../../../other"), "camera '../../../other'"),
        (lambda log: _camera(log, ".."), "camera '..'"),
        (lambda log: (log / "meta/info.json").write_text("{"), "info.json: no JSON"),
        (lambda log: _halve(log / DATA), f"{DATA}: the Parquet file is damaged"),
        (lambda log: (log / DATA).unlink(), "holds no chunk-000/file-000.parquet"),
        (lambda log: (log / EPISODES).write_bytes(b"PAR1"), f"{EPISODES}: the Parquet file"),
        (lambda log: _put(log, "steering", 7.0), f"{DATA}, row 7: steering is 7, beyond -1..1"),
        (lambda log: _put(log, "steering", None), f"{DATA}, row 7: steering is empty"),
        (lambda log: _rewrite(log, "steering", ["x"] * 40), f"{DATA}: steering is string"),
        (lambda log: _put(log, "timestamp", 1e9), f"{DATA}, row 7: timestamp"),
        (lambda log: _rewrite(log, "episode_index", [5] * 40), "episode 0 has 0 rows of 20"),
        (lambda log: _rewrite(log, FILE_INDEX, [-1, 0], EPISODES), f"{EPISODES}, row 1: no place"),
        (lambda log: (log / CENTER).unlink(), f"{CENTER}: No such file"),
        (lambda log: (log / CENTER).write_bytes(b""), f"{CENTER}: no MP4"),
        (lambda log: (log / CENTER).write_bytes(PLAYLIST), f"{CENTER}: no MP4"),
    ],
)
def test_damage_is_named_in_one_line_and_nothing_is_left(
    damage: Callable[[Path], None], words: str, copy: Path, tmp_path: Path
) -> None:
    damage(copy)
    assert words in refusal(convert_to_recording, copy, tmp_path / "new")
    assert [path.name for path in tmp_path.iterdir()] == ["copy"]


@pytest.mark.parametrize("damage", [_halve, _spoil])
def test_rows_behind_the_damage_of_a_video_are_left_out_and_counted(
    damage: Callable[[Path], None], copy: Path, tmp_path: Path
) -> None:
    damage(copy / CENTER)
    result = convert_to_recording(copy, tmp_path / "new")
    assert 0 < result.rows < 40
    assert result.notes[0].startswith(f"{40 - result.rows} rows left out")
    assert CENTER in result.notes[0]
    assert len(read_recordings(str(tmp_path / "new"))) == result.rows


def test_a_row_with_a_damaged_image_is_left_out_of_the_export(tmp_path: Path) -> None:
    written = write_recording(tmp_path / "lap", 8, cameras=("center",))
    written.image(3).write_bytes(b"\xff\xd8\xff")
    result = write_as("lerobot", read_recordings(str(written.folder)), tmp_path / "lr")
    assert result.rows == 7
    assert "row 4" in result.notes[0]


@pytest.fixture
def foreign_data(tmp_path: Path) -> Path:
    """Return the path of the table of a dataset of another program, which is not written."""
    return described_images(tmp_path / "set")


NAMES = ("episode_index", "timestamp", "action")


def check_refused(table: Path, words: str) -> None:
    with pytest.raises(InputError, match=rf"file-000\.parquet: {words}"):
        convert_to_recording(table.parents[2], table.parents[3] / "out")


def test_a_small_file_that_claims_ten_million_rows_is_refused_unread(foreign_data: Path) -> None:
    write_table(foreign_data, dict.fromkeys(NAMES, pa.array(np.zeros(10_000_000))))
    assert foreign_data.stat().st_size < 1_000_000
    check_refused(foreign_data, "has 10,000,000 rows.*divide")


def test_a_small_file_with_long_vectors_is_refused_unread(foreign_data: Path) -> None:
    vectors = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(20_000_000)), 100_000)
    zeros = pa.array(np.zeros(200))
    write_table(foreign_data, {"episode_index": zeros, "timestamp": zeros, "action": vectors})
    assert foreign_data.stat().st_size < 100_000
    check_refused(foreign_data, ".*action have 20,000,400 numbers")


def test_a_column_that_is_there_twice_is_refused(foreign_data: Path) -> None:
    zeros = [pa.array(np.zeros(3))] * 4
    pq.write_table(pa.Table.from_arrays(zeros, [*NAMES, "action"]), foreign_data)
    check_refused(foreign_data, "has the column 'action' more than")


def test_a_columns_name_that_is_not_utf_8_is_refused(foreign_data: Path) -> None:
    columns = dict.fromkeys([*NAMES, "xyxyxyxy"], pa.array(np.zeros(3)))
    pq.write_table(pa.table(columns), foreign_data, store_schema=False)
    data = foreign_data.read_bytes()
    foreign_data.write_bytes(data.replace(b"xyxyxyxy", b"xyxyxy\xff\xfe"))
    check_refused(foreign_data, "a column's name is not UTF-8")


@pytest.fixture(params=["v3.0", "v2.1"])
def counted(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Return a dataset of two episodes, of 6 and 4 rows, with a Parquet file for each."""
    folder = write_foreign(tmp_path / "set", png=True)
    _info(folder, total_frames=10)
    if request.param == "v2.1":
        as_version_2(folder)
        lines = [{"episode_index": n, "length": length} for n, length in enumerate((6, 4))]
        (folder / "meta/episodes.jsonl").write_text("".join(f"{json.dumps(x)}\n" for x in lines))
        return folder
    whole = pq.read_table(folder / DATA)
    for number, (first, count) in enumerate([(0, 6), (6, 4)]):
        part = folder / f"data/chunk-000/file-00{number}.parquet"
        pq.write_table(whole.slice(first, count), part)
    _rewrite(folder, "length", [6, 4], EPISODES)
    return folder


def test_a_dataset_that_has_other_rows_than_it_says_is_refused(counted: Path) -> None:
    assert len(read_recordings(str(counted))) == 10
    assert "rows" not in notes(counted)
    _info(counted, total_frames=7)
    assert "total_frames is 7, and its files hold 10 rows" in refusal(read_recordings, str(counted))
    done = run_here(counted.parent, "set", module="zoo.commands.check")
    assert done.returncode == 1
    assert "total_frames is 7, and its files hold 10 rows" in done.stdout

    _info(counted, total_frames=10)
    sorted(counted.glob("data/chunk-000/*.parquet"))[1].unlink()
    lost = r"info\.json: total_frames is 10, .* 6 rows .*episode 1 has 0 rows of 4.*on_bad_row=skip"
    with pytest.raises(InputError, match=lost):
        read_recordings(str(counted))
    recording = read_recordings(str(counted), on_bad_row="skip")
    assert len(recording) == 6
    assert "total_frames is 10" in recording.bad_rows[0]


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (pa.array([[0.1, 0.5]] * foreign.ROWS), ""),
        (pa.array([[0.1, 0.5]] * foreign.ROWS, pa.large_list(pa.float32())), ""),
        (pa.array([[0.1, 0.5]] * foreign.ROWS, pa.list_(pa.float64(), 2)), ""),
        (pa.array(RAGGED), "action has no numbers of one length"),
        (pa.array([[0.1, None]] * foreign.ROWS), "action has no numbers of one length"),
        (pa.array([[0.1]] * foreign.ROWS), "action has 1 numbers a row, and number 2"),
        (pa.array([[]] * foreign.ROWS, pa.list_(pa.float64())), "action has 0 numbers a row"),
        (np.full(foreign.ROWS, 0.1), "action has 1 numbers a row, and number 2"),
        (pa.array([[True, True]] * foreign.ROWS), "action is bool, expected numbers"),
        (pa.array([["0.1", "0.5"]] * foreign.ROWS), "action is string, expected numbers"),
        (pa.array([[[0.1], [0.5]]] * foreign.ROWS), "action is list"),
        (pa.array([0.1] * (foreign.ROWS - 1) + [None]), f"row {foreign.ROWS}: action is empty"),
    ],
)
def test_a_lerobot_column_has_the_shape_that_its_use_needs(
    action: object, words: str, foreign_data: Path, tmp_path: Path
) -> None:
    pngs = foreign.table(tmp_path / "source") / "pics"
    images = [(pngs / f"{row}.png").read_bytes() for row in range(foreign.ROWS)]
    columns = {"episode_index": np.zeros(foreign.ROWS), "timestamp": np.arange(foreign.ROWS) / 10}
    shown = {"observation.images.front": pa.array(images, pa.large_binary())}
    write_table(foreign_data, columns | shown | {"action": action})
    folder = foreign_data.parents[2]
    if words:
        with pytest.raises(InputError, match=rf"file-000\.parquet.*{words}"):
            read_recordings(str(folder))
    else:
        recording = read_recordings(str(folder))
        assert recording.throttle.tolist() == [0.5] * foreign.ROWS
        assert recording.stored(3, 0) == images[3]


def test_a_missing_pyarrow_is_one_line(
    recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(InputError, match=r'pip install "drivezoo\[parquet\]"'):
        convert.main([str(recorded.folder), "to=lerobot", f"out={tmp_path / 'lr'}"])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("check", [contract.check_written, contract.check_writer])
def test_it_is_written_as_every_format(check: Callable, tmp_path: Path) -> None:
    log = write_recording(tmp_path / "source", contract.ROWS).folder
    check("lerobot", read_recordings(str(log)), tmp_path)


def test_a_copy_of_another_cars_recording_is_of_that_car(tmp_path: Path) -> None:
    contract.check_copied_car("lerobot", tmp_path)


def test_rows_and_size_are_chosen(recorded: Written, tmp_path: Path) -> None:
    check_rows_and_size("lerobot", recorded, tmp_path)


def test_no_window_of_a_dataset_reaches_over_a_missing_row(
    recorded: Written, tmp_path: Path
) -> None:
    check_a_missing_row("lerobot", recorded, tmp_path)
