"""The cache of views, with real files and real processes."""

import errno
import hashlib
import itertools
import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from datamodules.image import decode_image
from datamodules.view import CONVERSIONS, RESIZES, View
from datamodules.view_store import cache_key, load_views
from tests.recordings import Written, write_recording
from tests.unchanged import unchanged
from zoo.base.errors import InputError

VIEW = View((60, 25), "rgb", (33, 100))
REPOSITORY = Path(__file__).parents[2]

# Prints "ready", waits for a line, builds in chunks of 16, and prints the result.
PROCESS = """
import hashlib, json, resource, sys, time
from pathlib import Path
from datamodules import view_store
from datamodules.view import View
from zoo.base.errors import InputError

paths, folder, pause_s, limit = json.loads(sys.argv[1])
if limit:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
view_store.CHUNK = 16
told = {"built": 0}

def progress(done, total):
    print(f"progress {done} of {total}", flush=True)
    told["built"] = done
    time.sleep(pause_s)

print("ready", flush=True)
sys.stdin.readline()
try:
    loaded = view_store.load_views(
        paths, View((60, 25), "rgb", (33, 100)), Path(folder), progress
    )
    told["views"] = hashlib.sha256(loaded.views.tobytes()).hexdigest()
except InputError as error:
    told["error"] = str(error)
print(json.dumps(told), flush=True)
"""


def start_build(paths: list[str], folder: Path, pause_s: float = 0.0, limit: int = 0):
    words = [sys.executable, "-c", PROCESS, json.dumps([paths, str(folder), pause_s, limit])]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    process = subprocess.Popen(words, text=True, cwd=REPOSITORY, **pipes)
    assert process.stdout.readline() == "ready\n"
    return process


def go(process: subprocess.Popen) -> None:
    process.stdin.write("\n")
    process.stdin.flush()


def outcome(process: subprocess.Popen) -> dict:
    output, errors = process.communicate(timeout=60)
    return json.loads(output.splitlines()[-1]) | {"waited": "another process writes" in errors}


def centre_paths(written: Written) -> list[str]:
    return [str(written.image(row)) for row in range(len(written.stems))]


def expected(paths: list[str]) -> np.ndarray:
    return np.stack([VIEW(decode_image(Path(path).read_bytes())) for path in paths])


def digest(views: np.ndarray) -> str:
    return hashlib.sha256(views.tobytes()).hexdigest()


def overwrite_unseen(path: str) -> None:
    """Change a file's bytes but not its size and time: only reading it again shows the change."""
    status = Path(path).stat()
    Path(path).write_bytes(bytes(status.st_size))
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


class Count:
    """A progress function that counts decoded images."""

    decoded = 0

    def __call__(self, done: int, total: int) -> None:
        self.decoded = done


@pytest.fixture
def written(tmp_path: Path) -> Written:
    return write_recording(tmp_path / "lake", rows=40, cameras=("center",))


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    return tmp_path / "cache"


@pytest.mark.parametrize("cached", [True, False], ids=["cache", "memory"])
def test_views_are_those_of_the_images_in_order(recorded, cache, cached):
    paths = centre_paths(recorded)
    loaded = load_views(paths, VIEW, cache if cached else None)
    np.testing.assert_array_equal(loaded.views, expected(paths))
    assert loaded.faults == {}


def test_second_time_decodes_nothing_and_maps_views_that_are_not_writable(written, cache):
    paths = centre_paths(written)
    first = np.array(load_views(paths, VIEW, cache).views)
    for path in paths:
        overwrite_unseen(path)
    again = Count()
    views = load_views(paths, VIEW, cache, again).views
    np.testing.assert_array_equal(views, first)
    assert again.decoded == 0
    assert isinstance(views, np.memmap)
    with pytest.raises(ValueError, match="read-only"):
        views[0] = 0


def test_moved_folder_finds_its_views_and_names_its_own_bad_image(written, cache, tmp_path):
    before = centre_paths(written)
    Path(before[2]).write_bytes(b"")
    load_views(before, VIEW, cache)
    moved, again = written.folder.rename(tmp_path / "moved"), Count()
    paths = [str(moved / "IMG" / Path(path).name) for path in before]
    faults = load_views(paths, VIEW, cache, again).faults
    assert (again.decoded, faults) == (0, {2: f"{paths[2]}: the file is empty"})


def test_changed_image_is_decoded_again(written, cache):
    paths = centre_paths(written)
    load_views(paths, VIEW, cache)
    Path(paths[3]).write_bytes(Path(paths[30]).read_bytes())
    views = load_views(paths, VIEW, cache).views
    np.testing.assert_array_equal(views[3], views[30])


def test_every_view_has_a_key_of_its_own(written):
    paths, crops = centre_paths(written)[:2], ((60, 25), (61, 24))
    several = itertools.product(crops, CONVERSIONS, [(33, 100)], RESIZES)
    keys = [cache_key(paths, View(*arguments)) for arguments in several]
    assert len(set(keys)) == len(keys) == 2 * len(CONVERSIONS) * len(RESIZES)


def test_a_file_that_cannot_be_read_now_is_decoded_when_it_can(written, monkeypatch):
    paths = centre_paths(written)[:2]
    before = cache_key(paths, VIEW)
    monkeypatch.setattr(os, "access", lambda path, mode: path != paths[1])
    assert cache_key(paths, VIEW) != before


@pytest.mark.parametrize("cached", [True, False], ids=["cache", "memory"])
def test_bad_images_are_zeros_and_named(written, cache, cached):
    paths = centre_paths(written)
    whole = Path(paths[2]).read_bytes()
    Path(paths[2]).write_bytes(whole[: len(whole) // 2])
    Path(paths[5]).write_bytes(b"")
    Path(paths[9]).write_bytes(b"no image")
    cv2.imencode(".bmp", np.zeros((160, 320, 3), np.uint8))[1].tofile(paths[10])
    Path(paths[36]).unlink()  # in the second chunk
    faults = {2: "the image is truncated", 5: "the file is empty", 36: "No such file or directory"}
    faults |= {9: "the file is no JPEG or PNG"}
    for _ in range(2):  # the cache keeps them
        loaded = load_views(paths, VIEW, cache if cached else None)
        of_bitmap = loaded.faults.pop(10)
        assert of_bitmap.startswith(f"{paths[10]}: the file is no JPEG or PNG: it is an")
        assert loaded.faults == {row: f"{paths[row]}: {fault}" for row, fault in faults.items()}
        assert not loaded.views[[2, 5, 9, 10, 36]].any()
        np.testing.assert_array_equal(loaded.views[[3, 39]], expected([paths[3], paths[39]]))


def test_two_processes_at_once_build_once_and_agree(written, cache):
    paths = centre_paths(written)
    processes = [start_build(paths, cache, pause_s=0.3) for _ in range(2)]
    for process in processes:
        go(process)
    outcomes = [outcome(process) for process in processes]
    assert sorted(told["built"] for told in outcomes) == [0, 40]
    assert sorted(told["waited"] for told in outcomes) == [False, True]
    assert {told["views"] for told in outcomes} == {digest(expected(paths))}


@pytest.mark.parametrize("waits", [False, True])
def test_killed_half_way_is_built_anew_also_by_a_process_that_waits(written, cache, waits):
    paths = centre_paths(written)
    killed = start_build(paths, cache, pause_s=60)
    go(killed)
    assert killed.stdout.readline() == "progress 16 of 40\n"
    assert list(cache.glob("*.part"))
    if waits:
        go(waiting := start_build(paths, cache))
    killed.kill()
    killed.communicate()
    if waits:
        assert outcome(waiting)["built"] == 40
    else:
        assert not list(cache.glob("*.npy"))
    again = Count()
    np.testing.assert_array_equal(load_views(paths, VIEW, cache, again).views, expected(paths))
    assert again.decoded == (0 if waits else 40)
    assert not list(cache.glob("*.part"))


def test_failed_write_is_one_line_and_leaves_earlier_files(written, cache):
    paths = centre_paths(written)
    load_views(paths[:5], VIEW, cache)
    process = start_build(paths, cache, limit=40 * 33 * 100 * 3 // 2)
    go(process)
    check_refusal(outcome(process)["error"], paths, cache)
    np.testing.assert_array_equal(load_views(paths, VIEW, cache).views, expected(paths))


def check_refusal(message: str, paths: list[str], cache: Path) -> None:
    assert message.startswith(f"{cache}: cannot write the view cache, 0 MB a camera (")
    assert "data.cache=" in message
    assert "\n" not in message
    assert len(list(cache.glob("*.npy"))) == 1
    assert not list(cache.glob("*.part"))
    again = Count()
    views = load_views(paths[:5], VIEW, cache, again).views
    np.testing.assert_array_equal(views, expected(paths[:5]))
    assert again.decoded == 0


def test_failed_sync_is_one_line_and_leaves_no_file(written, cache, monkeypatch):
    def fsync(descriptor: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(InputError, match=r"cannot write the view cache, .*Input/output error"):
        load_views(centre_paths(written), VIEW, cache)
    assert not [*cache.glob("*.npy"), *cache.glob("*.part")]


@pytest.mark.parametrize("small_disk", ["256k"], indirect=True)
def test_full_disk_is_one_line_and_leaves_earlier_files(written, small_disk):
    paths = centre_paths(written)
    load_views(paths[:5], VIEW, small_disk)
    with pytest.raises(InputError, match=r"\(No space left") as caught:
        load_views(paths, VIEW, small_disk)
    check_refusal(str(caught.value), paths, small_disk)


def test_cache_that_cannot_be_a_folder(written, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"cannot write the view cache, .*data\.cache="):
        load_views(centre_paths(written), VIEW, tmp_path / "file" / "cache")


def test_nothing_is_written_into_a_recording(written, cache):
    with unchanged(written.folder):
        load_views(centre_paths(written), VIEW, cache)
