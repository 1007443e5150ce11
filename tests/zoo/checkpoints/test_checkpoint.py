"""Checkpoints and policies: self-contained, safe, and seeing what training saw."""

import os
import pickle
import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import DictConfig, OmegaConf

from datamodules.balance import BatchKey
from datamodules.view import CONVERSIONS
from tests.recordings import Written, write_resized
from tests.refusals import refusal
from tests.slow_members import slow
from tests.without_rights import without_rights
from tests.zoo.bomb import Bomb
from tests.zoo.command_runs import run, succeed
from tests.zoo.server.old_client import telemetry
from tests.zoo.written_checkpoints import write_network
from zoo.base.compose import compose_config
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint, read_checkpoint_file
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.server.telemetry_message import read_telemetry
from zoo.training.build import build_network, load_data


@pytest.fixture
def best(run_folder: Path) -> Path:
    return run_folder / "checkpoints" / "best.ckpt"


@pytest.fixture
def contents(best: Path) -> dict:
    """Return what a checkpoint holds, which a test may change."""
    return torch.load(best, weights_only=True)


def test_a_checkpoint_holds_plain_containers_its_view_and_its_data(contents: dict) -> None:
    card = contents["drivezoo"]
    view = {"crop": [40, 20], "colour": "rgb", "size": [66, 200], "resize": "area"}
    assert card["view"] == view | {"frame": [160, 320]}
    assert card["config"]["model"]["name"] == "nvidia"
    assert card["data"]["rows"] == 120
    assert len(card["data"]["fingerprint"]) == 16


def test_a_checkpoint_needs_nothing_but_its_path(best: Path, tmp_path: Path) -> None:
    """The process and the folder are new, without the recording and the run's config."""
    copy = shutil.copy(best, tmp_path / "a=b [c].ckpt")
    (tmp_path / "load.py").write_text(
        "import sys, numpy as np\n"
        "from zoo.checkpoints.checkpoint_policy import load_policy\n"
        "print(load_policy(sys.argv[1])(np.zeros((160, 320, 3), np.uint8), 9.0).steering)\n"
    )
    printed = succeed(run(tmp_path, str(copy), module=str(tmp_path / "load.py")))
    assert -1 <= float(printed) <= 1


@pytest.mark.parametrize(
    ("colour", "resize", "width", "height"),
    [
        ("rgb", "area", 320, 160),
        ("hsv_s", "linear_first", 320, 160),
        ("yuv", "linear_first", 160, 120),
        *slow(
            *((colour, "area", 320, 160) for colour in CONVERSIONS if colour != "rgb"),
            ("rgb", "linear", 320, 160),
            ("yuv", "area_first", 320, 160),
            ("yuv_old", "linear_first", 320, 160),
            ("rgb", "area", 640, 480),
        ),
    ],
)
def test_training_validation_driving_and_export_see_the_same_bits(
    colour: str, resize: str, width: int, height: int, recorded: Written, tmp_path: Path, console
) -> None:
    """One JPEG through the cache, both kinds of batches, the driver, a checkpoint and ONNX."""
    if (width, height) != (320, 160):
        recorded = write_resized(recorded, tmp_path / "resized", width, height)
    config = view_config(recorded, tmp_path, colour, resize)
    data = load_data(config, console)
    training = data.training_batches()[BatchKey(0, 0, np.arange(5))]["images"]
    rows = [*data.samples.row[:5], *data.split.val[:5]]
    cameras = [*data.samples.camera[:5], *[0] * 5]
    fed = torch.cat([training, data.evaluation_batches("val")[0]["images"][:5]])
    network = build_network(config, data.view, console)
    plain = OmegaConf.to_container(config, resolve=True)
    checkpoint = write_network(tmp_path / "x.ckpt", network, data.view, plain)
    policy = load_policy(checkpoint)
    (tmp_path / "x.onnx").write_bytes(onnx_bytes(load_checkpoint(checkpoint)))
    exported = load_policy(tmp_path / "x.onnx")
    assert exported.view == policy.view == data.view
    assert data.view.frame == (height, width)
    for image, row, camera in zip(fed, rows, cameras, strict=True):
        jpeg = Path(data.recording.images[row, camera]).read_bytes()
        driven = read_telemetry(telemetry(jpeg=jpeg)).frame
        assert driven.shape == (height, width, 3)
        for view in (policy.view, exported.view):
            assert np.array_equal(view(driven), image.permute(1, 2, 0).numpy())
        with torch.inference_mode():
            trained = float(policy.network(image[None])[0, 0].clamp(-1, 1))
        assert policy(driven, 9.0)[0] == trained
        assert exported(driven, 9.0)[0] == pytest.approx(trained, abs=1e-5)


def view_config(recorded: Written, folder: Path, colour: str, resize: str) -> DictConfig:
    model = ["model=lenet", f"model.colour={colour}", f"model.resize={resize}"]
    data = [f"data.root={recorded.folder}", f"data.cache={folder / 'cache'}", "data.batch_size=5"]
    more = ["model.scale=[255,0.5]", "augment=[]", "data.flip=0"]
    return OmegaConf.create(compose_config([*model, *data, *more]))


WRONG_SCALES = ([0, 1], [1e-300, 0], [float("nan"), 1], "x", [1, 2, 3], {})


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        *(("scale", scale, r'.*model\.scale=.*set "model\.scale=\[') for scale in WRONG_SCALES),
        ("width", 2.0, r"\S+\.weight is \[24, 3, 5, 5\] in the file, \[48, 3, 5, 5\] in PilotNet"),
        ("_target_", "zoo.extras.absent.net.Net", r".*extra zoo\.extras\.absent\.net .*is missing"),
    ],
)
def test_a_setting_that_does_not_fit_is_named(
    key: str, value: object, words: str, contents: dict, tmp_path: Path
) -> None:
    contents["drivezoo"]["config"]["model"][key] = value
    torch.save(contents, tmp_path / "x.ckpt")
    assert re.search(rf"x\.ckpt: {words}", refusal(load_checkpoint, tmp_path / "x.ckpt"))


def test_pickled_code_is_refused_and_never_run(tmp_path: Path) -> None:
    evil = tmp_path / "evil.ckpt"
    torch.save({"drivezoo": {"format": 1}, "state_dict": {}, "x": Bomb(tmp_path / "ran")}, evil)
    assert re.search(r"evil\.ckpt: .*code.*not run", refusal(load_checkpoint, evil))
    evil.write_bytes(pickle.dumps(Bomb(tmp_path / "ran")))
    assert "evil.ckpt" in refusal(load_checkpoint, evil)
    assert not (tmp_path / "ran").exists()


def test_what_is_no_checkpoint_is_named(tmp_path: Path) -> None:
    assert "no such checkpoint" in refusal(load_checkpoint, tmp_path / "none.ckpt")
    torch.save({"weights": torch.zeros(2)}, tmp_path / "foreign.ckpt")
    assert "foreign.ckpt" in refusal(load_checkpoint, tmp_path / "foreign.ckpt")


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_weights_that_are_not_finite_are_refused_with_their_tensor(
    value: float, contents: dict, tmp_path: Path
) -> None:
    contents["state_dict"]["network.head.0.weight"][0, 0] = value
    torch.save(contents, tmp_path / "diverged.ckpt")
    message = refusal(load_policy, tmp_path / "diverged.ckpt")
    assert re.search(r"diverged\.ckpt: head\.0\.weight .*optim\.lr", message)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path, _: path.mkdir(), "cannot be read.*directory"),
        (lambda path, _: None, "cannot be read.*[Nn]o such file"),
        (lambda path, _: path.touch(), "is empty"),
        (lambda path, whole: path.write_bytes(whole[:20_000]), "is truncated"),
        (lambda path, whole: path.write_bytes(whole[:-26] + b"\3" + whole[-25:]), "is damaged"),
        (lambda path, _: path.write_text("steering"), "is not a torch file"),
        (lambda path, whole: path.write_bytes(whole[:99] + whole[150:]), "is damaged"),
    ],
)
def test_a_file_that_cannot_be_used_says_why(
    make: Callable[[Path, bytes], object], words: str, best: Path, tmp_path: Path
) -> None:
    path = tmp_path / "x.ckpt"
    make(path, best.read_bytes())
    assert re.search(rf"x\.ckpt: {words}", refusal(read_checkpoint_file, path))


@pytest.mark.skipif(not hasattr(os, "seteuid"), reason="needs files that a user may not read")
def test_a_file_that_may_not_be_read_says_so(best: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(shutil.copy(best, Path(folder) / "mine.ckpt"))
        path.chmod(0)
        Path(folder).chmod(0o755)
        words = r"mine\.ckpt: cannot be read.*ermission"
        with without_rights(), pytest.raises(InputError, match=words):
            load_checkpoint(path)
