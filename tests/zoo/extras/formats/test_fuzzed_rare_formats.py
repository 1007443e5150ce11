"""Damaged recordings in the extra's formats, by the thousand: read, or refused in one line."""

import io
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import strategies as st

from tests.hostile.mutations import mutated_bytes, mutated_json, read_damaged
from tests.hostile.test_fuzzed_formats import FEW_AND_MANY, STRATEGIES, check_damaged
from tests.hostile.test_fuzzed_recordings import converted
from tests.recordings import convert_to_recording
from tests.zoo.extras.formats.rare_examples import RARE
from tests.zoo.extras.formats.rare_recordings import described_images


@st.composite
def mutated_hdf5(draw: st.DrawFn, data: bytes) -> bytes:
    """Draw an HDF5 file in which a dataset has another type or shape, is lost, or leads outside."""
    h5py = pytest.importorskip("h5py")
    written = io.BytesIO(data)
    with h5py.File(written, "r+") as file:
        name = draw(st.sampled_from(sorted(file)))
        values = file[name][:]
        changed: dict[str, Any] = {
            "text": np.array([b"x"] * len(values)),
            "bool": np.ones(len(values), bool),
            "complex": np.ones(len(values), complex),
            "fields": np.zeros(len(values), [("a", float), ("b", int)]),
            "huge": np.full(len(values), 1e300),
            "nan": np.full(len(values), np.nan),
            "scalar": 0.5,
            "none": np.zeros(0),
            "fewer": values[:7],
            "matrix": np.zeros((len(values), 2)),
            "cube": np.zeros((2, 2, 2, 2), np.uint8),
            "link": h5py.SoftLink("/nowhere"),
            "outside": h5py.ExternalLink("/etc/passwd", "x"),
        }
        how = draw(st.sampled_from(("lose", "group", *changed)))
        del file[name]
        if how == "group":
            file.create_group(name)
        elif how != "lose":
            file[name] = changed[how]
    return written.getvalue()


@st.composite
def mutated_array(draw: st.DrawFn, data: bytes) -> bytes:
    """Draw a file of NumPy whose array has another type, shape or values."""
    odd = np.array(np.load(io.BytesIO(data)), float)
    odd[draw(st.integers(0, len(odd) - 1))] = draw(st.sampled_from((np.nan, np.inf, -1e300, 0.0)))
    arrays = [
        odd, odd[:-1], odd[:0], odd[0], odd[::-1], odd.reshape(2, -1), odd.astype(complex),
        odd.astype("U9"), odd.astype(bool), np.zeros(len(odd), "datetime64[s]"),
        np.zeros(len(odd), [("a", float)]), np.zeros((len(odd), 0)),
    ]  # fmt: skip
    written = io.BytesIO()
    np.save(written, arrays[draw(st.integers(0, len(arrays) - 1))])
    return written.getvalue()


FEW = {"lerobot": 2, "deeppicar": 4, "comma2k19": 4}  # to decode a video takes most of the time
MANY = {"lerobot": 133}


@pytest.mark.parametrize(
    ("name", "count"),
    [(name, FEW.get(name, 12)) for name in RARE]
    + [pytest.param(name, MANY.get(name, 400), marks=pytest.mark.slow) for name in RARE],
)
def test_damaged_recordings(
    name: str, count: int, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    write, _, _, options = RARE[name]
    strategies = STRATEGIES | {".h5": mutated_hdf5, "": mutated_array}
    check_damaged(write, options, strategies, count, tmp_path, capsys)


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """Return a LeRobot dataset with images in its Parquet file."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    path = described_images(tmp_path / "dataset")
    png = cv2.imencode(".png", np.full((16, 32, 3), 90, np.uint8))[1].tobytes()
    columns = {
        "episode_index": pa.array(np.zeros(3, int)),
        "timestamp": pa.array(np.arange(3) / 10),
        "action": pa.array([[0.1, 0.5]] * 3),
        "observation.images.front": pa.array([{"bytes": png, "path": "1.png"}] * 3),
    }
    pq.write_table(pa.table(columns), path)
    return path.parents[2]


@FEW_AND_MANY
def test_damaged_info_of_datasets(dataset: Path, count: int) -> None:
    path = dataset / "meta/info.json"
    damaged = mutated_json(json.loads(path.read_text()))
    read_damaged(damaged, converted(convert_to_recording, 1), path, count)


@FEW_AND_MANY
def test_damaged_parquet_files(dataset: Path, count: int) -> None:
    path = dataset / "data/chunk-000/file-000.parquet"
    damaged = mutated_bytes(path.read_bytes())
    read_damaged(damaged, converted(convert_to_recording, 2), path, count)
