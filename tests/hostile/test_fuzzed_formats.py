"""Damaged recordings of every format, by the thousand: read, or refused in one line.

    python -m pytest tests/hostile/test_fuzzed_formats.py -m slow

reads 7,000 of them, 1,000 of each way to store a recording.
"""

import json
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st

from datamodules.format_options import ReadOptions
from datamodules.known_formats import OWN
from datamodules.recording_format import read_recordings
from tests import foreign_recordings as foreign
from tests.contracts.test_recordings import COLUMNS, FORMATS
from tests.datamodules.test_other_kinds import KINDS
from tests.hostile import mutations
from tests.hostile.test_fuzzed_recordings import converted
from tests.recordings import convert_to_recording
from zoo.base.errors import InputError
from zoo.commands.check import check

FEW_AND_MANY = pytest.mark.parametrize("count", [12, pytest.param(1000, marks=pytest.mark.slow)])
DENIED = {"steering": {"unit": "share", "full": 1, "right": "positive"}}  # by the user
# Contents of other kinds of files; None: the file is lost.
OTHERS = st.sampled_from((None, b"", *(data for data, _ in KINDS.values())))


def old_tub(folder: Path) -> Path:
    """Write a tub as Donkeycar 3 does."""
    foreign.write_frames(folder, [f"{row}_cam.jpg" for row in range(foreign.ROWS)])
    for row, value in enumerate(foreign.STEERING.tolist()):
        record = {"cam/image_array": f"{row}_cam.jpg", "user/angle": value, "milliseconds": row}
        (folder / f"record_{row}.json").write_text(json.dumps(record))
    return folder


def parquet_table(folder: Path) -> Path:
    """Write a Parquet table that holds its images."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    source = foreign.table(folder.with_name("source"))
    images = [(source / f"pics/{row}.png").read_bytes() for row in range(foreign.ROWS)]
    folder.mkdir()
    columns = {"path": pa.array(images, pa.large_binary()), "turn": foreign.STEERING}
    pq.write_table(pa.table(columns), folder / "rows.parquet")
    return folder


WRITERS: dict[str, tuple[Callable[[Path], Path], dict]] = {
    name: (write, options) for name, (write, _, _, options) in FORMATS.items()
}
WRITERS |= {
    "challenge2_test": (foreign.challenge2_test, {}),
    "donkeycar3": (old_tub, {}),
    "parquet": (parquet_table, COLUMNS),
}
Strategies = dict[str, Callable[[bytes], st.SearchStrategy[bytes]]]  # by the suffix of a file
STRATEGIES: Strategies = {".parquet": mutations.mutated_parquet}


def test_the_writers_are_of_every_format() -> None:
    assert set(OWN) <= set(WRITERS)


def mutated(path: Path, strategies: Strategies) -> st.SearchStrategy[bytes]:
    """Return a strategy of damaged contents of a file."""
    data, kind = path.read_bytes(), path.suffix
    if kind in (".csv", ".txt"):
        return mutations.mutated_csv(data) | mutations.mutated_bytes(data)
    if kind == ".json" and data.lstrip().startswith((b"{", b"[")) and data.count(b"\n}") < 2:
        with suppress(ValueError):
            return mutations.mutated_json(json.loads(data))
    if kind in (".catalog", ".json"):
        first, _, rest = data.rstrip(b"\n").rpartition(b"\n")
        rows = mutations.mutated_json(json.loads(rest)).map(lambda row: first + b"\n" + row)
        return rows | mutations.mutated_bytes(data)
    if kind in strategies:
        return strategies[kind](data) | mutations.mutated_bytes(data)
    return mutations.mutated_bytes(data)


@FEW_AND_MANY
@pytest.mark.parametrize("name", WRITERS)
def test_every_format(name: str, count: int, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    check_damaged(*WRITERS[name], STRATEGIES, count, tmp_path, capsys)


def check_damaged(
    write: Callable[[Path], Path],
    options: dict,
    by_suffix: Strategies,
    count: int,
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
) -> None:
    folder = write(tmp_path / "recording")
    images = sorted(folder.rglob("*.jpg"))
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path not in images]
    files = [path for path in files if path.suffix != ".png" and not path.name.startswith(".")]
    strategies = {path: mutated(path, by_suffix) for path in [*files[:9], *images[:1]]}
    whole = {path: path.read_bytes() for path in strategies}
    damaged = st.sampled_from(sorted(strategies)).flatmap(
        lambda path: st.tuples(st.just(path), strategies[path] | OTHERS, st.booleans())
    )

    def read(example: tuple[Path, bytes | None, bool]) -> None:
        path, data, is_denied = example
        path.unlink()
        if data is not None:
            path.write_bytes(data)
        try:
            read_whole(folder, options | (DENIED if is_denied else {}))
        except InputError as error:
            line = str(error)
            assert str(folder) in line
            assert "\n" not in line
            assert len(line) < 1200 + 3 * len(str(path))
        finally:
            path.write_bytes(whole[path])
            capsys.readouterr()

    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)  # NumPy's of a number that no integer has
        mutations.for_each(damaged, read, count)


def read_whole(folder: Path, options: dict) -> None:
    """Check a recording, decode an image of each camera, and convert it if no row is bad."""
    check(str(folder), **options)
    recording = read_recordings(str(folder), **options, on_bad_row="skip", on_bad_image="skip")
    for camera in np.flatnonzero(recording.images[0].astype(bool)).tolist():
        with suppress(OSError, ValueError):
            recording.image(0, camera)
    converted(partial(convert_to_recording, options=ReadOptions(**options)), 0)(folder / "any")
