"""`drivezoo import`: from a Keras file to a checkpoint that every command takes."""

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from datamodules.image import read_image
from datamodules.recording_format import read_recordings
from datamodules.view import View
from tests.recordings import Written, write_recording, write_resized
from tests.slow_members import slow
from tests.zoo.command_runs import only_line, run_here, succeed
from tests.zoo.extras.keras.keras_files import Layer, lambda_config, write_h5
from tests.zoo.extras.keras.keras_networks import (
    SCALED,
    SHORT_STRETCH,
    dense_layer,
    write_steering_h5,
)
from tests.zoo.extras.keras.test_donkeycar import BINS, donkeycar_layers
from tests.zoo.extras.keras.test_donkeycar import write as write_donkeycar
from tests.zoo.written_checkpoints import write_constant
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.extras.keras import tied_drives
from zoo.extras.keras.sequential import Sequential
from zoo.runs.saved_config import find_refusals
from zoo.server.input_checks import check_checkpoint

VIEW = View((60, 25), "yuv_old", (12, 40))


def import_file(cwd: Path, *arguments: str) -> subprocess.CompletedProcess:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tied_drives, "STRETCH", SHORT_STRETCH)
        return run_here(cwd, *arguments, module="zoo.extras.keras.import")


@pytest.fixture(scope="module")
def lake(tmp_path_factory: pytest.TempPathFactory) -> Written:
    return write_recording(tmp_path_factory.mktemp("lake") / "my lake", rows=200, seed=3)


@pytest.fixture(scope="module")
def keras_file(lake: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    recording = read_recordings(str(lake.folder))
    return write_steering_h5(tmp_path_factory.mktemp("keras") / "old.h5", recording, VIEW, SCALED)


@pytest.fixture(scope="module")
def imported(keras_file: Path, lake: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Import a file with the command and a recording; return the checkpoint."""
    cwd = tmp_path_factory.mktemp("imported")
    printed = succeed(import_file(cwd, str(keras_file), f"recording={lake.folder}"))
    (cwd / "stdout.txt").write_text(printed)
    return cwd / "old.ckpt"


def test_the_input_is_found_printed_and_in_the_checkpoint(imported: Path, lake: Written) -> None:
    checkpoint = load_checkpoint(imported)
    recording = read_recordings(str(lake.folder))
    assert checkpoint.view == VIEW
    assert checkpoint.config["model"]["scale"] == [127.5, 1.0]
    assert checkpoint.config["data"]["crop"] == [60, 25]
    assert checkpoint.config["data"]["root"] == str(lake.folder)
    assert checkpoint.data == {"fingerprint": recording.fingerprint(), "rows": 200}
    printed = (imported.parent / "stdout.txt").read_text()
    for text in ("Flatten", "Dense", "12 x 40 x 3", "1,441", "yuv_old", "agreement", "the file"):
        assert text in printed
    assert "trying on the recording" in printed
    assert "what it saw: colour=yuv_old 'crop=[60,25]'" in printed
    assert "how it drives: " in printed
    assert "wrote: old.ckpt\nnext: drivezoo evaluate old.ckpt" in printed


def test_the_checkpoint_steers_as_recorded(imported: Path, lake: Written) -> None:
    policy = load_policy(imported)
    rows = range(0, 200, 10)
    steering = [policy(read_image(lake.image(row)), 20.0)[0] for row in rows]
    np.testing.assert_allclose(steering, lake.steering[rows], atol=0.05)


@pytest.mark.parametrize(
    ("module", "arguments"),
    [
        ("zoo.commands.evaluate", ["laps=0.01", "workers=1"]),
        ("zoo.commands.replay", ["RECORDING"]),
        ("zoo.commands.saliency", ["RECORDING"]),
        *slow(("zoo.commands.drive", ["sim=lake", "laps=0.005", "port=0"])),
        *slow(("zoo.commands.doctor", ["RECORDING", "port=4599"])),
    ],
)
def test_every_command_takes_the_checkpoint(
    module: str, arguments: list[str], imported: Path, lake: Written, tmp_path: Path
) -> None:
    arguments = [str(lake.folder) if word == "RECORDING" else word for word in arguments]
    succeed(run_here(tmp_path, str(imported), *arguments, module=module))


def test_a_network_of_0_1_drives_the_same(imported: Path, lake: Written, tmp_path: Path) -> None:
    contents, earlier = torch.load(imported, weights_only=True), tmp_path / "earlier.ckpt"
    card = contents["drivezoo"]
    assert "parts" not in card  # as in version 0.1: the extra's code is drivezoo's
    card["config"]["model"]["_target_"] = "zoo.models.sequential.Sequential"
    torch.save(contents, earlier)
    checkpoint = load_checkpoint(earlier)
    assert type(checkpoint.network) is Sequential
    assert list(find_refusals(checkpoint.config)) == []
    frame = read_image(lake.image(7))
    assert load_policy(earlier)(frame, 9.0) == load_policy(imported)(frame, 9.0)


def test_without_a_recording_guesses_are_named(keras_file: Path, tmp_path: Path) -> None:
    printed = succeed(import_file(tmp_path, str(keras_file), "out=guessed.ckpt"))
    assert "colour=rgb and crop=[60,25] are guesses" in printed
    assert "recording=FOLDER out=guessed.ckpt overwrite=true" in printed, "no other file's name"
    checkpoint = load_checkpoint(tmp_path / "guessed.ckpt")
    assert checkpoint.data == {"fingerprint": None, "rows": 0}
    assert checkpoint.config["data"]["root"] is None
    texts = [finding.found for finding in check_checkpoint(str(tmp_path / "guessed.ckpt"))]
    assert any("not known" in text for text in texts), texts


def test_a_file_without_a_backend_may_be_theanos(tmp_path: Path) -> None:
    kernel = np.random.default_rng(0).normal(size=(1, 3, 5, 5)).astype(np.float32)
    form = {"nb_row": 5, "nb_col": 5, "nb_filter": 1, "dim_ordering": "th"}
    layers: list[Layer] = [
        ("Convolution2D", form, [kernel, np.zeros(1, np.float32)]),
        ("Flatten", {}, []),
        dense_layer(np.ones((36 * 8, 1), np.float32), np.zeros(1, np.float32)),
    ]
    shape = (3, 12, 40)
    path = write_h5(tmp_path / "old.h5", layers, version=1, shape=shape, backend="")
    keys = (path.name, "scale=[127.5,1]", "overwrite=true")
    assert "read as TensorFlow's, not Theano's" in succeed(import_file(tmp_path, *keys))
    with h5py.File(path, "a") as file:
        del file["model_weights"].attrs["backend"]
        file.attrs["backend"] = "theano"
    assert "Theano" not in succeed(import_file(tmp_path, *keys))
    weights = load_checkpoint(tmp_path / "old.ckpt").network.layers[0].weight.detach().numpy()
    np.testing.assert_array_equal(weights, kernel[:, :, ::-1, ::-1])


def test_keys_are_taken_as_given(keras_file: Path, tmp_path: Path) -> None:
    keys = ["colour=bgr", "crop=[50,20]", "resize=linear", "scale=[255,0.5]"]
    assert "guess" not in succeed(import_file(tmp_path, str(keras_file), *keys))
    checkpoint = load_checkpoint(tmp_path / "old.ckpt")
    assert checkpoint.view == View((50, 20), "bgr", (12, 40), "linear")
    assert checkpoint.config["model"]["scale"] == [255.0, 0.5]


def test_a_network_of_donkeycar_needs_no_key_and_drives_with_its_throttle(tmp_path: Path) -> None:
    write_donkeycar(tmp_path, donkeycar_layers(BINS, (15, 20), "softmax"))
    printed = succeed(import_file(tmp_path, "pilot.h5", "throttle_range=0.5"))
    assert "guess" not in printed
    assert "next: drivezoo replay pilot.ckpt FOLDER" in printed, "no track shows its car"
    policy = load_policy(tmp_path / "pilot.ckpt")
    assert policy.view == View((0, 0), "rgb", None, frame=(12, 16))
    frames = np.random.default_rng(0).integers(0, 256, (40, 1, 1, 3), np.uint8)
    commands = [policy(np.tile(frame, (160, 320, 1)), 9.0) for frame in frames]
    assert {round(command.throttle / (0.5 / 20), 4) % 1 for command in commands} == {0}
    assert len({command.steering for command in commands}) > 1


def test_a_network_that_never_learned_is_not_certain(lake: Written, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    weights = rng.normal(size=(12 * 40 * 3, 1)).astype(np.float32) / 1000
    dense = dense_layer(weights, np.zeros(1, np.float32))
    write_h5(tmp_path / "random.h5", [SCALED, ("Flatten", {}, []), dense], shape=(12, 40, 3))
    small = write_resized(lake, tmp_path / "small", 160, 120)
    keys = (f"recording={small.folder}", "drive=false", "frames=60")
    printed = succeed(import_file(tmp_path, "random.h5", *keys))
    assert "not certain: " in printed
    assert "how it drives: not tried" in printed
    view = load_checkpoint(tmp_path / "random.ckpt").view
    assert (view.frame, view.size) == ((120, 160), (12, 40)), "the size of the recording"


@pytest.mark.parametrize("outputs", [1, 2])
def test_a_line_is_applied_and_exported(outputs: int, lake: Written, tmp_path: Path) -> None:
    """Its output is 0..1, 0.5 straight on, by a sigmoid, which no weights before it can undo."""
    rng = np.random.default_rng(0)
    weights = rng.normal(size=(12 * 40 * 3, outputs)).astype(np.float32) / 20
    dense = dense_layer(weights, np.zeros(outputs, np.float32), activation="sigmoid")
    write_h5(tmp_path / "old.h5", [SCALED, ("Flatten", {}, []), dense], shape=(12, 40, 3))
    keys = ["outputs=[throttle,steering]"] * (outputs - 1)
    for name, line in (("plain", []), ("lined", ["steering=[2.4,-1.2]"])):
        succeed(import_file(tmp_path, "old.h5", f"out={name}.ckpt", *keys, *line))
    words = ("lined.ckpt", "out=lined.onnx", f"frames={lake.folder}")
    printed = succeed(run_here(tmp_path, *words, module="zoo.commands.export"))
    assert "largest difference from the checkpoint" in printed
    frames = rng.integers(0, 256, (4, 20, 40, 3), np.uint8).repeat(8, 1).repeat(8, 2)
    names = ("plain.ckpt", "lined.ckpt", "lined.onnx")
    plain, *lined = (load_policy(tmp_path / name) for name in names)
    for frame in frames:
        steering, throttle = plain(frame, 9.0)
        for policy in lined:
            assert policy(frame, 9.0).steering == pytest.approx(2.4 * steering - 1.2, abs=1e-5)
            assert policy(frame, 9.0).throttle == pytest.approx(throttle, abs=1e-5)


def test_the_line_offered_makes_steering(keras_file: Path, lake: Written, tmp_path: Path) -> None:
    """Also after a wrong line; the command keeps the other keys."""
    shutil.copy(keras_file, tmp_path)
    with h5py.File(tmp_path / "old.h5", "r+") as file:
        group = file["model_weights/dense_1/dense_1"]
        for name, term in (("kernel:0", 0.0), ("bias:0", 0.5)):
            group[name][...] = group[name][...] / 2.4 + term
    keys = [f"recording={lake.folder}", "colour=yuv_old", "crop=[60,25]", "drive=false"]
    keys += ["resize=area", "frames=60"]
    for more in ([], ["steering=[-3,1]"]):
        printed = succeed(import_file(tmp_path, "old.h5", *keys, *more, "overwrite=true"))
        command = re.search(r"drivezoo import (.*)", printed)[1]
        assert "not like steering" in printed
        assert "not certain" not in succeed(import_file(tmp_path, *shlex.split(command)))
        factor, offset = map(float, re.search(r"steering=\[(.*?),(.*?)\]", command).groups())
        assert (factor, offset) == pytest.approx((2.4, -1.2), rel=0.1)
        assert set(keys) < set(shlex.split(command))


def test_an_import_replaces_a_file_only_with_overwrite(keras_file: Path, tmp_path: Path) -> None:
    assert import_file(tmp_path, str(keras_file)).returncode == 0
    assert "out=old.ckpt: exists" in only_line(import_file(tmp_path, str(keras_file)))
    assert import_file(tmp_path, str(keras_file), "overwrite=true").returncode == 0
    trained = write_constant(tmp_path / "trained.ckpt", 0.1)
    before = trained.read_bytes()
    result = import_file(tmp_path, str(keras_file), "out=trained.ckpt")
    assert "out=trained.ckpt: exists" in only_line(result)
    assert trained.read_bytes() == before


@pytest.mark.parametrize(
    ("keys", "fault", "remedy"),
    [
        (["crop=60"], "crop=60", "[60,25]"),
        (["crop=[100,80]"], "data.crop=[100, 80]", "crop less"),
        (["size=[66,200]"], "size=[66,200]", "12 x 40"),
        (["scale=[0,1]"], "scale=[0,1]", "[127.5,1]"),
        (["steering=[0,1]"], "steering=[0,1]", "[2.4,-1.2]"),
        (["steering=[nan,1]"], "steering=[nan,1]", "finite number"),
        (["steering=2.4"], "steering=2.4", "[2.4,-1.2]"),
        (["colour=gray"], "colour=gray", "12 x 40 x 3; set a colour of 3 channels"),
        (["recording=nowhere"], "nowhere", "no such folder"),
        (["out=old.h5"], "out=old.h5", ".ckpt"),
        (["out=nowhere/old.ckpt"], "out=nowhere/old.ckpt", "no folder"),
        (["lambdas=[atan]"], "lambdas=atan", "leave out"),
        (["weights=w.h5"], "weights=w.h5", ".json"),
    ],
)
def test_a_wrong_key_is_refused(
    keys: list[str], fault: str, remedy: str, keras_file: Path, tmp_path: Path
) -> None:
    line = only_line(import_file(tmp_path, str(keras_file), *keys))
    assert fault in line
    assert remedy in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "before",
    [
        pytest.param([], marks=pytest.mark.slow),
        [("Lambda", lambda_config(lambda x: (x - x.mean()) / 127.5), [])],
    ],
    ids=["no scale", "unclear scale"],
)
def test_an_unclear_scale_is_asked_for(before: list[Layer], lake: Written, tmp_path: Path) -> None:
    write_steering_h5(tmp_path / "old.h5", read_recordings(str(lake.folder)), VIEW, *before)
    assert 'set "scale=[' in only_line(import_file(tmp_path, "old.h5"))
    assert import_file(tmp_path, "old.h5", "scale=[127.5,1]").returncode == 0
    keys = [f"recording={lake.folder}", "colour=yuv_old", "crop=[60,25]", "drive=false"]
    succeed(import_file(tmp_path, "old.h5", *keys, "frames=60", "overwrite=true"))
    assert load_checkpoint(tmp_path / "old.ckpt").config["model"]["scale"][1] == 1.0
