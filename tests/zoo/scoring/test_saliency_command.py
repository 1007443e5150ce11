"""Saliency maps of every model of the zoo, in the pixels of the frame."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from datamodules.image import decode_image
from tests.recordings import Written
from tests.slow_members import slow_but
from tests.zoo.command_runs import run_here
from tests.zoo.written_checkpoints import checkpoint_of
from zoo.base.compose import choices
from zoo.base.errors import InputError, UsageError
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy, load_policy
from zoo.commands.saliency import CAPTION
from zoo.commands.saliency import saliency as saliency_command
from zoo.scoring.visual_backprop import Saliency, enlarge, overlay


def policy_of(name: str) -> CheckpointPolicy:
    return CheckpointPolicy(checkpoint_of(name, seed=0))


@pytest.fixture
def frame(recorded: Written) -> np.ndarray:
    return decode_image(recorded.image(10).read_bytes())


@pytest.mark.parametrize("name", slow_but({*choices("model")} - {"vgg"}, choices("model")))
def test_every_model_has_a_map_of_the_frame(name: str, frame: np.ndarray) -> None:
    policy = policy_of(name)
    steering = policy(frame, 9.0)
    for published in (False, True):
        policy.reset()
        where = Saliency(policy, published)(frame, 9.0)
        assert where.shape == (160, 320)
        assert where.dtype == np.float32
        assert where.min() == 0
        assert where.max() == pytest.approx(1)
        top, bottom = policy.view.crop
        assert not where[:top].any()
        assert not where[160 - bottom :].any()
        policy.reset()
        assert policy(frame, 9.0) == steering, "looking must not change the driving"
        assert np.array_equal(Saliency(policy, published)(frame, 9.0), where)


@pytest.mark.parametrize("name", ["nvidia", "commaai"])
def test_what_alone_stands_out_lights_up(name: str) -> None:
    frame = np.full((160, 320, 3), 120, np.uint8)
    frame[80:96, 220:250] = (255, 40, 40)

    where = Saliency(policy_of(name))(frame, 9.0)
    row, column = np.unravel_index(where.argmax(), where.shape)
    assert 70 <= row < 106
    assert 205 <= column < 265


@pytest.mark.parametrize("size", [(480, 640), (120, 160)])
def test_a_map_has_the_size_of_its_frame(size: tuple[int, int]) -> None:
    policy = policy_of("lenet")
    frame = np.random.default_rng(0).integers(0, 256, (*size, 3), np.uint8)
    where = Saliency(policy)(frame, 9.0)
    assert where.shape == size
    top, bottom = policy.view.rows_cropped(size[0])
    assert not where[:top].any()
    assert where[top : size[0] - bottom].any()
    assert not where[size[0] - bottom :].any()


def test_a_map_is_spread_by_the_layers_kernel_and_stride() -> None:
    layer = torch.nn.Conv2d(1, 1, 5, 2)
    where = torch.zeros(1, 1, 3, 4)
    where[0, 0, 1, 2] = 1

    spread = enlarge(where, layer, (10, 12))  # the stride leaves the last row and column unseen

    assert spread.shape == (1, 1, 10, 12)
    rows, columns = np.nonzero(spread[0, 0].numpy())
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (2, 6, 4, 8)


def test_a_frame_of_one_colour_gives_a_map_without_nan() -> None:
    where = Saliency(policy_of("tiny"))(np.zeros((160, 320, 3), np.uint8), 0.0)
    assert np.isfinite(where).all()


def test_the_overlay_is_green_where_it_matters(frame: np.ndarray) -> None:
    where = np.zeros((160, 320), np.float32)
    where[100, 100] = 1

    picture = overlay(frame, where)

    assert picture.dtype == np.uint8
    assert picture.shape == frame.shape
    assert picture[100, 100, 1] > 200
    where[100, 100] = 0
    assert np.array_equal(overlay(frame, where), frame)


def test_images_get_one_size(checkpoint: str, recorded: Written, tmp_path: Path) -> None:
    folder = shutil.copytree(recorded.folder, tmp_path / "mixed")
    large = next(folder.rglob(recorded.image(-1).name))
    cv2.imwrite(str(large), cv2.resize(cv2.imread(str(large)), (400, 300)))

    result = run_here(tmp_path, checkpoint, str(folder), module="zoo.commands.saliency")

    assert result.stdout.splitlines()[0] == "wrote: saliency.png"
    assert cv2.imread(str(tmp_path / "saliency.png")).shape == (6 * (160 + CAPTION), 4 * 320, 3)


def test_an_image_is_beside_its_map(run_folder: Path, recorded: Written, tmp_path: Path) -> None:
    checkpoint, picture = run_folder / "checkpoints" / "best.ckpt", recorded.image(3)

    saliency_command.main([str(checkpoint), str(picture), f"out={tmp_path}/new/one.png"])

    drawn = cv2.imread(str(tmp_path / "new" / "one.png"))[:, :, ::-1]
    frame = decode_image(picture.read_bytes())
    assert len(drawn) == len(frame) + CAPTION
    drawn = drawn[: len(frame)]
    assert np.array_equal(drawn[:, :320], frame)
    where = Saliency(load_policy(checkpoint))(frame, 0.0)
    assert np.array_equal(drawn[:, 320:], overlay(frame, where))


def test_a_users_image_is_not_replaced(checkpoint: str, recorded: Written, tmp_path: Path) -> None:
    (tmp_path / "mine.png").write_bytes(recorded.image(3).read_bytes())
    given = [checkpoint, f"{tmp_path}/mine.png", f"out={tmp_path}/mine.png"]
    with pytest.raises(InputError, match="is an input of this command"):
        saliency_command.main([*given, "overwrite=true"])
    with pytest.raises(InputError, match=r"out=.*mine\.png: exists"):
        saliency_command.main([checkpoint, str(recorded.image(3)), given[2]])


def test_no_network_without_gradients_is_offered(capsys: pytest.CaptureFixture[str]) -> None:
    saliency_command.main(["--help"])
    assert ".onnx" not in capsys.readouterr().out


def test_a_mistake_is_said_with_what_to_do(checkpoint: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="usage"):
        saliency_command.main([checkpoint])
    (tmp_path / "no.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"no\.png: the file is no JPEG or PNG"):
        saliency_command.main([checkpoint, str(tmp_path / "no.png")])


def test_a_map_is_written_as_png_alone(recorded: Written) -> None:
    with pytest.raises(UsageError, match=r"out=look\.jpg: must end in \.png"):
        saliency_command("lenet", recorded.image(3), out="look.jpg")
