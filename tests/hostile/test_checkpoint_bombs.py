"""Checkpoints, doubt files and guard files that ask for far more than they hold."""

import io
import tracemalloc
import zipfile
from pathlib import Path

import pytest
import torch

from tests.hostile.crafted_files import (
    calls_bytearray,
    contents_of,
    deep_pickle,
    many_lists,
    rezip,
    shared_lists,
    shared_tuples_as_key,
    with_pickle,
)
from tests.zoo.commands import only_line, run
from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint, load_plain
from zoo.checkpoints.policy import load_policy
from zoo.monitor.guard_file import KEY, read_guard


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_constant(tmp_path / "x.ckpt", 0.1)


def changed(path: Path, **config: object) -> Path:
    """Add keys to a checkpoint's config."""
    contents = contents_of(path)
    contents["drivezoo"]["config"] |= config
    torch.save(contents, path)
    return path


@pytest.mark.parametrize("module", ["zoo.export", "zoo.evaluate", "zoo.doctor"])
def test_lists_that_share_their_parts_are_not_expanded(module: str, path: Path) -> None:
    changed(path, data=shared_lists(40))
    result = run(path.parent, str(path), module=module, timeout=60)
    printed = " ".join((result.stdout + result.stderr).split())
    assert "Traceback" not in printed
    assert "x.ckpt: is damaged" in printed
    assert "1,000,000 values" in printed
    assert result.returncode == 1


def test_a_guard_files_lists_are_not_expanded(tmp_path: Path) -> None:
    guard = {"format": 1, "method": "autoencoder", "state": {"shape": shared_lists(40)}}
    torch.save({KEY: guard}, tmp_path / "x.guard")
    with pytest.raises(InputError, match=r"x\.guard: .*values"):
        read_guard(tmp_path / "x.guard")


def test_a_guard_files_mean_of_400_digits_is_named(tmp_path: Path) -> None:
    numbers = {"threshold": 1.0, "window": 1, "limit_mph": 5.0, "samples": 2}
    guard = {"format": 1, "method": "attention_mean", "state": {"mean": 10**400}, **numbers}
    torch.save({KEY: guard}, tmp_path / "x.guard")
    with pytest.raises(InputError, match=r"x\.guard: state: "):
        read_guard(tmp_path / "x.guard")


@pytest.mark.parametrize(
    ("pickle", "words"),
    [
        (deep_pickle(5000), "64 levels"),
        (many_lists(1_900_000), "steps"),
        (shared_tuples_as_key(45), "values"),
        (calls_bytearray(8_000_000_000), "code"),
    ],
    ids=["deep", "many", "hash", "bytearray"],
)
def test_a_crafted_pickle_is_refused(pickle: bytes, words: str, path: Path) -> None:
    with pytest.raises(InputError, match=rf"x\.ckpt: .*{words}"):
        load_plain(with_pickle(path, pickle))


@pytest.mark.parametrize("pickle", [shared_tuples_as_key(45), calls_bytearray(8_000_000_000)])
def test_a_crafted_pickle_of_an_old_torch_file_is_refused(pickle: bytes, tmp_path: Path) -> None:
    torch.save({}, tmp_path / "old.pth", _use_new_zipfile_serialization=False)
    whole = (tmp_path / "old.pth").read_bytes()
    (tmp_path / "old.pth").write_bytes(whole[: whole.index(b"}q\x00.")] + pickle)
    with pytest.raises(InputError, match=r"old\.pth: "):
        load_plain(tmp_path / "old.pth")


def test_an_old_torch_file_is_read(tmp_path: Path) -> None:
    state = {"a": torch.arange(3.0), "b": torch.nn.Parameter(torch.ones(2))}
    torch.save(state, tmp_path / "old.pth", _use_new_zipfile_serialization=False)
    assert load_plain(tmp_path / "old.pth")["a"].tolist() == [0, 1, 2]


def test_deflated_members_are_not_unpacked(path: Path) -> None:
    zeros = bytes(100_000_000)
    rezip(path, {"data/0": zeros}, zipfile.ZIP_DEFLATED)
    assert path.stat().st_size < 200_000
    tracemalloc.start()
    with pytest.raises(InputError, match=r"x\.ckpt: claims 100,0\d\d,\d+ bytes"):
        load_plain(path)
    assert tracemalloc.get_traced_memory()[1] < 20_000_000
    tracemalloc.stop()


def test_a_checkpoint_that_was_packed_again_is_read(path: Path) -> None:
    rezip(path, {}, zipfile.ZIP_DEFLATED)
    load_checkpoint(path)


def test_an_archives_long_list_of_members_is_not_read(tmp_path: Path) -> None:
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        archive.writestr("x/data.pkl", b"")
    data = bytearray(written.getvalue())
    at = data.rindex(b"PK\5\6") + 12
    data[at : at + 4] = (4_000_001).to_bytes(4, "little")
    (tmp_path / "x.ckpt").write_bytes(data)
    with pytest.raises(InputError, match=r"x\.ckpt: has 4,000,001 bytes of an index"):
        load_plain(tmp_path / "x.ckpt")


def test_tensors_that_repeat_one_number_count_whole(path: Path) -> None:
    contents = contents_of(path)
    contents["state_dict"]["network.x"] = torch.zeros(1).expand(100_000_000)
    torch.save(contents, path)
    with pytest.raises(InputError, match=r"x\.ckpt: claims 400,000,\d+ bytes"):
        load_plain(path)


def test_a_network_larger_than_its_weights_is_not_built(path: Path) -> None:
    layers = [{"layer": "Flatten"}, {"layer": "Dense", "units": 9_000_000}]
    model = {"_target_": "zoo.models.sequential.Sequential", "layers": layers}
    changed(path, model=contents_of(path)["drivezoo"]["config"]["model"] | model)
    with pytest.raises(InputError, match=r"x\.ckpt: .*126,000,000 parameters"):
        load_checkpoint(path)


def test_members_that_share_their_weights_are_refused(path: Path) -> None:
    member = contents_of(path)
    doubt = {"drivezoo": {"format": 1, "doubt": {"samples": 2, "seed": 0}}, "members": [member] * 9}
    torch.save(doubt, path)
    with pytest.raises(InputError, match=r"x\.ckpt: member 2: has the weights of a member"):
        load_policy(path)


def test_weights_of_eight_bits_are_named(path: Path) -> None:
    contents = contents_of(path)
    state = contents["state_dict"]
    contents["state_dict"] = {name: one.to(torch.float8_e4m3fn) for name, one in state.items()}
    torch.save(contents, path)
    line = only_line(run(path.parent, str(path), module="zoo.export", timeout=60))
    assert "x.ckpt: head.weight does not hold plain floats" in line


@pytest.mark.parametrize("value", [[0] * 1000, torch.zeros(3, 4), 10**400])
def test_an_odd_format_is_one_short_line(value: object, path: Path) -> None:
    contents = contents_of(path)
    contents["drivezoo"]["format"] = value
    torch.save(contents, path)
    with pytest.raises(
        InputError, match=r"x\.ckpt: has format version .{1,40}, this drivezoo reads 1"
    ) as error:
        load_checkpoint(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("key", ["format", "method", "threshold", "window"])
@pytest.mark.parametrize("value", [[0] * 1000, {}, torch.zeros(3, 4)])
def test_an_odd_value_of_a_guard_file_is_one_short_line(
    key: str, value: object, tmp_path: Path
) -> None:
    numbers = {"threshold": 1.0, "window": 1, "limit_mph": 5.0, "samples": 2}
    guard = {"format": 1, "method": "attention_mean", "state": {"mean": 0.5}, **numbers}
    torch.save({KEY: guard | {key: value}}, tmp_path / "x.guard")
    with pytest.raises(InputError, match=rf"x\.guard: .*{key}") as error:
        read_guard(tmp_path / "x.guard")
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 300
