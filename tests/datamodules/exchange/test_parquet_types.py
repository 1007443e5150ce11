"""Parquet columns of every type: read, or refused with the column and its type."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from datamodules.format_options import ReadOptions
from datamodules.recording_format import read_recordings
from tests import foreign_recordings as foreign
from tests.recordings import convert_to_recording
from zoo.base.errors import InputError

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

ROWS = foreign.ROWS
SAID = {
    "columns": {"image": "img", "steering": "turn"},
    "steering": {"unit": "share", "full": 1, "right": "positive"},
}


@pytest.fixture
def images(tmp_path: Path) -> list[bytes]:
    folder = foreign.table(tmp_path / "source")
    return [(folder / f"pics/{row}.png").read_bytes() for row in range(ROWS)]


def write(folder: Path, img: object, turn: object = foreign.STEERING) -> Path:
    folder.mkdir(exist_ok=True)
    pq.write_table(pa.table({"img": img, "turn": turn}), folder / "rows.parquet")
    return folder / "rows.parquet"


BYTES: dict[str, Callable[[list[bytes]], object]] = {
    "binary": pa.array,
    "large_binary": lambda data: pa.array(data, pa.large_binary()),  # as polars writes them
    "binary_view": lambda data: pa.array(data, pa.binary_view()),
    "dictionary": lambda data: pa.array(data).dictionary_encode(),
    "struct": lambda data: pa.array([{"bytes": image, "path": "/etc/passwd"} for image in data]),
    "large struct": lambda data: pa.array(
        [{"bytes": image} for image in data], pa.struct([("bytes", pa.large_binary())])
    ),
}


@pytest.mark.parametrize("kind", BYTES)
def test_images_in_every_type_of_bytes_are_read(kind: str, images: list, tmp_path: Path) -> None:
    recording = read_recordings(str(write(tmp_path / "table", BYTES[kind](images))), **SAID)
    assert recording.image(ROWS - 1).shape == (80, 160, 3)
    assert recording.stored(7, 0) == images[7]


TEXTS = {
    "string": pa.string(),
    "large_string": pa.large_string(),
    "string_view": pa.string_view(),
    "dictionary": pa.dictionary(pa.int32(), pa.string()),
}


@pytest.mark.parametrize("kind", TEXTS)
def test_paths_in_every_type_of_text_are_read(kind: str, tmp_path: Path) -> None:
    folder = foreign.table(tmp_path / "source")
    names = pa.array([f"pics/{row}.png" for row in range(ROWS)], TEXTS[kind])
    recording = read_recordings(str(write(folder, names)), **SAID)
    assert recording.images[3, 0] == str(folder / "pics/3.png")


@pytest.mark.parametrize("kind", [pa.binary, pa.large_binary, pa.binary_view, "fixed"])
def test_bytes_are_an_image_and_never_a_path(kind: object, images: list, tmp_path: Path) -> None:
    secret = tmp_path / "secret.png"
    secret.write_bytes(images[0])
    name = str(secret).encode()
    column = pa.array([name] * ROWS, pa.binary(len(name)) if kind == "fixed" else kind())
    with pytest.raises(InputError, match=r"rows\.parquet, row 1: .*no JPEG or PNG"):
        convert_to_recording(write(tmp_path / "in", column), tmp_path / "out", ReadOptions(**SAID))
    assert not (tmp_path / "out").exists()


COLUMNS: dict[str, object] = {
    "double": np.zeros(ROWS),
    "int64": np.zeros(ROWS, int),
    "bool": np.ones(ROWS, bool),
    "timestamp": pa.array(range(ROWS), pa.timestamp("us")),
    "null": pa.nulls(ROWS),
    "list": pa.array([[0.5]] * ROWS),
    "struct": pa.array([{"path": "/etc/passwd"}] * ROWS),
    "string": pa.array([{"bytes": "/etc/passwd"}] * ROWS),
}


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *(("img", kind) for kind in COLUMNS),
        *(("turn", kind) for kind in ("bool", "timestamp", "null", "list", "struct")),
    ],
)
def test_a_column_of_another_type_is_named(name: str, kind: str, tmp_path: Path) -> None:
    table = write(tmp_path / "table", **{"img": ["0.png"] * ROWS} | {name: COLUMNS[kind]})
    words = rf"rows\.parquet: {name} is .*{kind}.*, expected texts or"
    with pytest.raises(InputError, match=words):
        read_recordings(str(table), **SAID)


@pytest.mark.parametrize(
    "kind", [pa.float32(), pa.float16(), pa.decimal128(20, 9), pa.large_string()], ids=str
)
def test_steering_of_every_type_is_read(kind: object, images: list, tmp_path: Path) -> None:
    numbers = np.round(foreign.STEERING, 3)
    half = kind == pa.float16()  # which pyarrow does not cast to
    turn = pa.array(numbers.astype(np.float16)) if half else pa.array(numbers).cast(kind)
    recording = read_recordings(str(write(tmp_path / "table", pa.array(images), turn)), **SAID)
    np.testing.assert_allclose(recording.steering, numbers, atol=1e-3)


RAGGED = [[0.5] * (1 + row % 3) for row in range(ROWS)]  # as many numbers as three a row
