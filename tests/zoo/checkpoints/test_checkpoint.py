"""Checkpoints and policies: self-contained, safe, and seeing what training saw."""

import os
import pickle
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from datamodules.errors import InputError
from datamodules.image import decode_image
from tests.recordings import Written
from tests.zoo.bomb import Bomb
from tests.zoo.commands import ROOT
from tests.zoo.drive.old_client import telemetry
from zoo.checkpoints.checkpoint import load_checkpoint, read_checkpoint_file
from zoo.checkpoints.policy import load_policy
from zoo.drive.telemetry_message import read_telemetry


@pytest.fixture
def best(run_folder: Path) -> Path:
    return run_folder / "checkpoints" / "best.ckpt"


def test_a_checkpoint_holds_plain_containers_its_view_and_its_data(best: Path) -> None:
    contents = torch.load(best, weights_only=True)
    card = contents["drivezoo"]
    assert card["view"] == {"crop": [40, 20], "colour": "rgb", "size": [66, 200]}
    assert card["config"]["model"]["name"] == "nvidia"
    assert card["data"]["rows"] == 120
    assert len(card["data"]["fingerprint"]) == 16


def test_a_checkpoint_needs_nothing_but_its_path(best: Path, tmp_path: Path) -> None:
    """The process and the folder are new, without the recording and the run's config."""
    copy = shutil.copy(best, tmp_path / "a=b [c].ckpt")
    code = (
        "import sys, numpy as np; from zoo.checkpoints.policy import load_policy;"
        "print(load_policy(sys.argv[1])(np.zeros((160, 320, 3), np.uint8), 9.0))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code, copy],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    steering = float(result.stdout.strip("()\n").split(",")[0])
    assert -1 <= steering <= 1


def test_training_and_driving_see_the_same_bits(
    run_folder: Path, best: Path, recorded: Written
) -> None:
    """One JPEG through the view cache and the batch, through the driver, and the policy."""
    from omegaconf import OmegaConf
    from rich.console import Console

    from zoo.training.build import build_data

    config = OmegaConf.create(read_checkpoint_file(best)["drivezoo"]["config"])
    config.data.cache = str(run_folder.parent / "outputs" / "cache")
    data = build_data(config)
    data.load(Console(quiet=True))
    batch = data.evaluation_batches("test")[0]
    policy = load_policy(best)
    for position, row in enumerate(data.split.test[:5]):
        jpeg = Path(data.recording.images[row, 0]).read_bytes()
        seen = policy.view(decode_image(jpeg))
        fed = batch["images"][position].permute(1, 2, 0).numpy()
        assert np.array_equal(seen, fed)
        driven = read_telemetry(telemetry(jpeg=jpeg)).frame
        assert np.array_equal(policy.view(driven), fed)

        with torch.inference_mode():
            trained = policy.network(batch["images"][position : position + 1])
        steering, throttle = policy(decode_image(jpeg), 9.0)
        assert steering == pytest.approx(float(trained[0, 0].clamp(-1, 1)), abs=0)
        assert throttle is None


def test_pickled_code_is_refused_and_never_run(tmp_path: Path) -> None:
    evil = tmp_path / "evil.ckpt"
    torch.save({"drivezoo": {"format": 1}, "state_dict": {}, "x": Bomb(tmp_path / "ran")}, evil)
    with pytest.raises(InputError, match=r"evil.ckpt: .*code.*not run"):
        load_checkpoint(evil)
    evil.write_bytes(pickle.dumps(Bomb(tmp_path / "ran")))
    with pytest.raises(InputError, match=r"evil.ckpt"):
        load_checkpoint(evil)
    assert not (tmp_path / "ran").exists()


def test_a_config_that_names_another_callable_is_not_called(best: Path, tmp_path: Path) -> None:
    contents = torch.load(best, weights_only=True)
    contents["drivezoo"]["config"]["model"]["_target_"] = "os.getcwd"
    torch.save(contents, tmp_path / "x.ckpt")
    with pytest.raises(InputError, match=r"os\.getcwd: is no network of zoo"):
        load_checkpoint(tmp_path / "x.ckpt")


def test_what_is_no_checkpoint_is_named(best: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such checkpoint"):
        load_checkpoint(tmp_path / "none.ckpt")
    (tmp_path / "text.ckpt").write_text("steering")
    (tmp_path / "half.ckpt").write_bytes(best.read_bytes()[:20_000])
    torch.save({"weights": torch.zeros(2)}, tmp_path / "foreign.ckpt")
    for name in ("text", "half", "foreign"):
        with pytest.raises(InputError, match=rf"{name}\.ckpt"):
            load_checkpoint(tmp_path / f"{name}.ckpt")


def changed(best: Path, path: Path, change: Callable[[dict], object]) -> Path:
    """Write a copy of a checkpoint with other contents."""
    contents = torch.load(best, weights_only=True)
    change(contents)
    torch.save(contents, path)
    return path


def test_weights_that_do_not_fit_their_config_name_the_tensor_and_its_shapes(
    best: Path, tmp_path: Path
) -> None:
    def widen(contents: dict) -> None:
        contents["drivezoo"]["config"]["model"]["width"] = 2.0

    wide = changed(best, tmp_path / "wide.ckpt", widen)
    words = r"wide\.ckpt: \S+\.weight is \[24, 3, 5, 5\] in the file, \[48, 3, 5, 5\] in PilotNet"
    with pytest.raises(InputError, match=words):
        load_checkpoint(wide)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_weights_that_are_not_finite_are_refused_with_their_tensor(
    value: float, best: Path, tmp_path: Path
) -> None:
    def spoil(contents: dict) -> None:
        contents["state_dict"]["network.head.0.weight"][0, 0] = value

    path = changed(best, tmp_path / "diverged.ckpt", spoil)
    with pytest.raises(InputError, match=r"diverged\.ckpt: head\.0\.weight .*optim\.lr"):
        load_policy(path)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path, _: path.mkdir(), "cannot be read.*directory"),
        (lambda path, _: None, "cannot be read.*[Nn]o such file"),
        (lambda path, _: path.touch(), "is empty"),
        (lambda path, whole: path.write_bytes(whole[:20_000]), "is truncated"),
        (lambda path, _: path.write_text("steering"), "is not a torch file"),
        (lambda path, whole: path.write_bytes(whole[:99] + whole[150:]), "is damaged"),
    ],
)
def test_a_file_that_cannot_be_used_says_why(
    make: Callable[[Path, bytes], object], words: str, best: Path, tmp_path: Path
) -> None:
    path = tmp_path / "x.ckpt"
    make(path, best.read_bytes())
    with pytest.raises(InputError, match=rf"x\.ckpt: {words}"):
        read_checkpoint_file(path)


@pytest.mark.skipif(not hasattr(os, "seteuid"), reason="needs files that a user may not read")
def test_a_file_that_may_not_be_read_says_so(best: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(shutil.copy(best, Path(folder) / "mine.ckpt"))
        path.chmod(0)
        Path(folder).chmod(0o755)
        was_root = os.geteuid() == 0
        if was_root:
            os.seteuid(65_534)  # nobody: root may read everything
        try:
            with pytest.raises(InputError, match=r"mine\.ckpt: cannot be read.*ermission"):
                load_checkpoint(path)
        finally:
            if was_root:
                os.seteuid(0)
