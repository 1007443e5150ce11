"""Files of Keras 1, 2 and 3: what is read of them, and what bad ones report."""

import json
import pickle
import struct
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.hostile.mutations import check_reading
from tests.refusals import refusal
from tests.zoo.bomb import Bomb
from tests.zoo.extras.keras.keras_files import (
    Layer,
    functional,
    keras_3_weights,
    lambda_config,
    model_config,
    random_weights,
    write_h5,
    write_json,
    write_keras,
)
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.extras.keras.keras_arrays import text
from zoo.extras.keras.keras_file import read_keras, read_keras_apart

W = random_weights
LAYERS: list[Layer] = [
    ("Lambda", lambda_config(lambda x: x / 127.5 - 1.0), []),
    ("Conv2D", {"filters": 4, "kernel_size": [3, 3], "strides": [2, 2]}, W((3, 3, 3, 4), (4,))),
    ("Conv2D", {"filters": 5, "kernel_size": [3, 3]}, W((3, 3, 4, 5), (5,), seed=1)),
    ("BatchNormalization", {}, W(*[(5,)] * 4, seed=2)),
    ("Flatten", {}, []),
    ("Dense", {"units": 1}, W((420, 1), (1,), seed=3)),
]
WRITERS: dict[str, Callable[[Path], Path]] = {
    "keras 1": lambda folder: write_h5(folder / "m.h5", LAYERS, 1),
    "keras 2": lambda folder: write_h5(folder / "m.h5", LAYERS, 2),
    "keras 3 in h5": lambda folder: write_h5(folder / "m.h5", LAYERS, 3),
    "json": lambda folder: write_json(folder / "m.json", LAYERS),
    "keras": lambda folder: write_keras(folder / "m.keras", LAYERS),
}


def check_layers(path: Path) -> None:
    model = read_keras(path)
    layers = [layer for layer in model.layers if layer.kind != "InputLayer"]
    assert [layer.kind for layer in layers] == [kind for kind, *_ in LAYERS]
    for layer, (_, _, weights) in zip(layers, LAYERS, strict=True):
        assert len(layer.arrays) == len(weights)
        for ours, theirs in zip(layer.arrays, weights, strict=True):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("name", WRITERS)
def test_every_layout_gives_the_same_layers(name: str, tmp_path: Path) -> None:
    check_layers(WRITERS[name](tmp_path))


def test_the_version_and_the_backend_are_read(tmp_path: Path) -> None:
    model = read_keras(write_h5(tmp_path / "m.h5", LAYERS, 1, backend="theano"))
    assert (model.version, model.backend) == (1, "theano")
    assert read_keras(write_keras(tmp_path / "m.keras", LAYERS)).version == 3


@pytest.mark.parametrize("name", ["m.h5", "model.h5", "m_weights.h5", "anything.h5"])
def test_weights_are_found_in_the_folder_of_the_json(name: str, tmp_path: Path) -> None:
    path = write_json(tmp_path / "m.json", LAYERS)
    (tmp_path / "m.h5").rename(tmp_path / name)
    check_layers(path)


def test_weights_are_named_if_there_are_several(tmp_path: Path) -> None:
    path = write_json(tmp_path / "m.json", LAYERS)
    (tmp_path / "m.h5").rename(tmp_path / "a.h5")
    (tmp_path / "b.h5").write_bytes(b"")
    with pytest.raises(InputError, match=r"m\.json: .*there are 2.*set weights=FILE"):
        read_keras(path)
    assert read_keras(path, tmp_path / "a.h5").has_architecture


def test_weights_alone_find_their_json(tmp_path: Path) -> None:
    write_json(tmp_path / "model.json", LAYERS)
    check_layers(tmp_path / "model.h5")
    (tmp_path / "model.json").unlink()
    assert not read_keras(tmp_path / "model.h5").has_architecture


def test_json_within_json_is_read(tmp_path: Path) -> None:
    """`json.dump(model.to_json(), file)` writes a text of JSON."""
    path = write_json(tmp_path / "m.json", LAYERS)
    path.write_text(json.dumps(path.read_text()))
    check_layers(path)
    check_layers(tmp_path / "m.h5")
    path.write_text(json.dumps(path.read_text()))
    assert "m.json: is no model" in refusal(read_keras, path)


@pytest.mark.parametrize(
    ("read", "name"),
    [
        *((read_keras, name) for name in ("m.h5", "m.keras", "m.json")),
        (read_keras_apart, "m.h5"),
        (load_policy, "m.h5"),
    ],
)
def test_a_pointer_of_git_lfs_is_named(read: Callable, name: str, tmp_path: Path) -> None:
    write_json(tmp_path / "m.json", LAYERS)
    (tmp_path / name).write_text("version https://git-lfs.github.com/spec/v1\noid sha256:12\n")
    with pytest.raises(InputError, match=rf"{name}: .*Git LFS pointer.*git lfs pull") as caught:
        read(tmp_path / name)
    assert "HDF5" not in str(caught.value)


@pytest.mark.parametrize("name", ["m.h5", "m.keras", "m.pth"])
def test_a_missing_file_is_named(name: str, tmp_path: Path) -> None:
    assert f"{name}: no such file" in refusal(read_keras, tmp_path / name)


def test_keras_3s_weights_stand_beside_a_json(tmp_path: Path) -> None:
    (tmp_path / "m.json").write_text(json.dumps(model_config(LAYERS, version=3)))
    (tmp_path / "m.weights.h5").write_bytes(keras_3_weights(LAYERS))
    check_layers(tmp_path / "m.json")
    check_layers(tmp_path / "m.weights.h5")
    (tmp_path / "m.json").unlink()
    with pytest.raises(InputError, match=r"without the architecture.*model\.save"):
        read_keras(tmp_path / "m.weights.h5")


def test_weights_match_their_layers_by_name(tmp_path: Path) -> None:
    """The file's order of groups is another than the architecture's."""
    path = write_h5(tmp_path / "m.h5", LAYERS)
    with h5py.File(path, "a") as file:
        group = file["model_weights"]
        group.attrs["layer_names"] = group.attrs["layer_names"][::-1].copy()
    check_layers(path)


def test_layers_of_other_names_match_in_order(tmp_path: Path) -> None:
    """A json of one session, and weights of another, whose names count on."""
    path = write_json(tmp_path / "m.json", LAYERS)
    text = path.read_text()
    for old, new in (("conv2d_2", "conv2d_9"), ("conv2d_1", "conv2d_8"), ("dense_1", "dense_4")):
        text = text.replace(f'"{old}"', f'"{new}"')
    path.write_text(text)
    check_layers(path)


def nested(folder: Path, in_one_group: bool) -> Path:
    """Write a model whose convolutions are a model of their own."""
    names = [f"{kind.lower()}_1" for kind, *_ in LAYERS]
    names[2] = "conv2d_2"
    config = model_config(LAYERS)
    entries = config["config"]["layers"]
    inner = {"class_name": "Sequential", "config": {"name": "inner", "layers": entries[1:4]}}
    config["config"]["layers"] = [entries[0], inner, *entries[4:]]
    path = write_h5(folder / "m.h5", LAYERS, config=config)
    if in_one_group:
        with h5py.File(path, "a") as file:
            group = file["model_weights"]
            subgroup = group.create_group("inner")
            pairs = [
                (text(key), group[name][text(key)][()])
                for name in names[1:4]
                for key in group[name].attrs["weight_names"]
            ]
            pairs.sort(key=lambda pair: "moving" in pair[0])  # trained ones first, as in Keras
            subgroup.attrs["weight_names"] = [key.encode() for key, _ in pairs]
            for key, array in pairs:
                subgroup.create_dataset(key, data=array)
            for name in names[1:4]:
                del group[name]
            group.attrs["layer_names"] = [names[0].encode(), b"inner", *map(str.encode, names[4:])]
    return path


@pytest.mark.parametrize("in_one_group", [True, False], ids=["Keras 2", "Keras 1"])
def test_a_nested_model_is_flattened(in_one_group: bool, tmp_path: Path) -> None:
    check_layers(nested(tmp_path, in_one_group))


@pytest.mark.parametrize("version", [2, 3])
def test_a_functional_chain_is_followed(version: int, tmp_path: Path) -> None:
    check_layers(write_h5(tmp_path / "m.h5", LAYERS, version, config=functional(LAYERS, version)))


FLATTEN, FIRST, CONV = ([name, 0, 0, {}] for name in ("flatten_1", "input_1", "conv2d_1"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"nodes": [[FLATTEN, FIRST]]}, "Dense dense_1 takes the output of flatten_1, input_1"),
        ({"output_layers": ["dense_1", "flatten_1"]}, "2 outputs .dense_1, flatten_1"),
        ({"input_layers": ["input_1", "speed"]}, "2 inputs .input_1, speed"),
        ({"nodes": [[CONV]]}, "takes the output of conv2d_1, as does"),
        ({"nodes": [[FLATTEN], [FLATTEN]]}, "dense_1 takes the output of flatten_1, flatten_1"),
    ],
)
def test_a_model_that_is_no_chain_is_refused(change: dict, words: str, tmp_path: Path) -> None:
    config = functional(LAYERS)
    for key, value in change.items():
        if key == "nodes":
            config["config"]["layers"][0]["inbound_nodes"] = value
        else:
            config["config"][key] = [[name, 0, 0] for name in value]
    with pytest.raises(InputError, match=rf"m\.h5: .*{words}"):
        read_keras(write_h5(tmp_path / "m.h5", LAYERS, config=config))


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.99])
def test_a_truncated_file_is_one_line(name: str, share: float, tmp_path: Path) -> None:
    path = WRITERS[name](tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(InputError, match=r"m\.(h5|keras|json): ") as caught:
        read_keras(path)
    assert len(str(caught.value).splitlines()) == 1


def test_links_and_other_files_are_not_read(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(b"\0" * 4000)
    for kind in ("external", "link", "soft"):
        path = write_h5(tmp_path / f"{kind}.h5", LAYERS)
        with h5py.File(path, "a") as file:
            group = file["model_weights/dense_1/dense_1"]
            del group["bias:0"]
            if kind == "external":
                group.create_dataset("bias:0", (1,), "f4", external=[(str(secret), 0, 4)])
            elif kind == "link":
                group["bias:0"] = h5py.ExternalLink(str(path), "/model_weights/dense_1")
            else:
                group["bias:0"] = h5py.SoftLink("/model_weights/conv2d_1/conv2d_1/bias:0")
        with pytest.raises(InputError, match=r"another file|is a link"):
            read_keras(path)


@pytest.mark.parametrize(
    ("member", "contents", "words"),
    [
        ("config.json", None, r"lacks config\.json"),
        ("model.weights.h5", None, r"lacks model\.weights\.h5"),
        ("config.json", b" " * 20_000_000, r"config\.json claims"),
        # The Lambda layer's code names this file's path, which is as long as its folders are.
        ("model.weights.h5", b"\0" * 80_000_000, r"m\.keras: claims 80,00\d,\d{3} bytes"),
    ],
)
def test_an_archive_that_lacks_a_member_or_claims_a_large_one_is_refused(
    member: str, contents: bytes | None, words: str, tmp_path: Path
) -> None:
    whole, path = write_keras(tmp_path / "whole.keras", LAYERS), tmp_path / "m.keras"
    with zipfile.ZipFile(whole) as source:
        members = {name: source.read(name) for name in source.namelist()} | {member: contents}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            if data is not None:
                archive.writestr(name, data)
    with pytest.raises(InputError, match=words):
        read_keras(path)


def test_an_archive_leaves_nothing_on_the_disk(here: Path) -> None:
    path = write_keras(here / "m.keras", LAYERS)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("../outside.txt", "x")
    check_layers(path)
    assert [entry.name for entry in here.iterdir()] == ["m.keras"]


def test_pickled_code_in_a_file_is_never_run(tmp_path: Path) -> None:
    """Keras 1 and 2 pickle nothing but Lambdas; a hostile file may hold a pickle anywhere."""
    bomb = pickle.dumps(Bomb(tmp_path / "ran"))
    layers = [*LAYERS]
    layers[0] = ("Lambda", {"function": [bomb.decode("latin-1"), None, None]}, [])
    path = write_h5(tmp_path / "m.h5", layers)
    with h5py.File(path, "a") as file:
        file.attrs["training_config"] = np.void(bomb)
        file.create_dataset("optimizer_weights", data=np.void(bomb))
    check_layers(path)
    assert not (tmp_path / "ran").exists()


def test_a_missing_h5py_names_its_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_keras(tmp_path / "m.keras", LAYERS)
    monkeypatch.setitem(sys.modules, "h5py", None)
    assert "pip install h5py" in refusal(read_keras, path)


def write_endless(path: Path) -> Path:
    """Write a file whose list of free space leads back to itself, which HDF5 follows for ever."""
    with h5py.File(path, "w") as file:
        file["layer"] = np.zeros(4, np.float32)
    contents = bytearray(path.read_bytes())
    heap = contents.index(b"HEAP")
    _, first, address = struct.unpack_from("<QQQ", contents, heap + 8)
    struct.pack_into("<Q", contents, address + first, first)
    path.write_bytes(contents)
    return path


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="the limit of the memory is POSIX")
def test_a_file_that_the_library_reads_without_end_is_named(tmp_path: Path) -> None:
    path = write_endless(tmp_path / "endless.h5")
    with pytest.raises(InputError, match=r"endless\.h5.*copy it again"):
        read_keras_apart(path)


def test_endless_reading_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_endless(tmp_path / "endless.h5")
    monkeypatch.setattr("zoo.base.process_pool.READ_S", 0.0)
    with pytest.raises(InputError, match=r"endless\.h5: is damaged.*copy it again"):
        read_keras_apart(path)


@pytest.mark.slow
def test_a_damaged_hdf5_file_never_raises_another_error(tmp_path: Path) -> None:
    path = write_h5(tmp_path / "m.h5", LAYERS)
    data, rng = path.read_bytes(), np.random.default_rng(0)
    for _ in range(20):
        damaged = bytearray(data)
        for offset in rng.integers(0, len(data), 5):
            damaged[offset] = rng.integers(0, 256)
        path.write_bytes(bytes(damaged))
        check_reading(read_keras, path)
