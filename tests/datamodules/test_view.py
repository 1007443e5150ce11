import json

import numpy as np
import pytest

from datamodules.errors import InputError
from datamodules.image import decode_image
from datamodules.view import CONVERSIONS, View, view_to_rgb

SHAPE_CASES = [
    ((60, 25), "rgb", (66, 200), (66, 200, 3)),
    ((0, 0), "yuv", None, (160, 320, 3)),
    ((50, 0), "hsv_s", (11, 32), (11, 32, 1)),
    ((40, 20), "gray", None, (100, 320, 1)),
    ((0, 159), "gray", (1, 1), (1, 1, 1)),
    ((0, 0), "rgb", (224, 448), (224, 448, 3)),
]


@pytest.fixture(scope="module")
def frame() -> np.ndarray:
    """Return an image of random colours, uint8 [160, 320, 3]."""
    return np.random.default_rng(0).integers(0, 256, (160, 320, 3), np.uint8)


def by_hand(frame: np.ndarray, colour: str) -> np.ndarray:
    """Convert with the textbook's formulas; return float [160, 320, C]."""
    red, green, blue = np.moveaxis(frame.astype(float), 2, 0)
    luma = 0.299 * red + 0.587 * green + 0.114 * blue
    largest, smallest = frame.max(axis=2).astype(float), frame.min(axis=2).astype(float)
    planes = {
        "rgb": [red, green, blue],
        "yuv": [luma, 0.492 * (blue - luma) + 128, 0.877 * (red - luma) + 128],
        "gray": [luma],
        "hsv_s": [255 * (largest - smallest) / np.maximum(largest, 1)],
    }
    return np.clip(np.stack(planes[colour], axis=2), 0, 255)


@pytest.mark.parametrize("colour", CONVERSIONS)
def test_colour_is_the_textbooks(frame, colour):
    ours = View(crop=(0, 0), colour=colour, size=None)(frame)
    assert np.abs(ours - by_hand(frame, colour)).max() <= 1


@pytest.mark.parametrize(("crop", "colour", "size", "shape"), SHAPE_CASES)
def test_shape(frame, crop, colour, size, shape):
    view = View(crop, colour, size)
    image = view(frame)
    assert image.shape == view.shape == shape
    assert image.dtype == np.uint8


def test_crop_takes_rows_off_the_top_and_the_bottom(frame):
    np.testing.assert_array_equal(View((60, 25), "rgb", None)(frame), frame[60:135])


def test_size_is_the_mean_over_area(frame):
    small = View((0, 0), "rgb", (40, 80))(frame)
    means = frame.reshape(40, 4, 80, 4, 3).mean(axis=(1, 3))
    assert np.abs(small - means).max() <= 0.5


def test_colour_comes_before_size():
    """Saturation of the mean of red and cyan would be 0; the mean of both saturations is full."""
    frame = np.zeros((160, 320, 3), np.uint8)
    frame[:, ::2] = (255, 0, 0)
    frame[:, 1::2] = (0, 255, 255)
    assert View((0, 0), "hsv_s", (80, 160))(frame).min() == 255


def test_frame_is_left_as_it_was(frame):
    before = frame.copy()
    View((60, 25), "yuv", (66, 200))(frame)
    np.testing.assert_array_equal(frame, before)


def test_survives_a_checkpoint():
    for view in (View((60, 25), "yuv", (66, 200)), View((0, 0), "gray", None)):
        assert View.from_dict(json.loads(json.dumps(view.to_dict()))) == view


def test_lists_are_as_good_as_tuples():
    assert View([60, 25], "rgb", [66, 200]) == View((60, 25), "rgb", (66, 200))


def test_yuv_is_turned_back_for_people(recorded):
    frame = decode_image(recorded.image(3).read_bytes())
    back = view_to_rgb(View((0, 0), "yuv", None)(frame), "yuv")
    assert np.abs(back.astype(int) - frame).max() <= 3


def test_gray_is_shown_as_three_equal_channels(frame):
    gray = View((0, 0), "gray", None)(frame)
    shown = view_to_rgb(gray, "gray")
    assert shown.shape == (160, 320, 3)
    assert (shown == gray).all()


@pytest.mark.parametrize("crop", [(-1, 0), (80, 80), (0, 160), (1.5, 0), (1,), 40, None, "ab"])
def test_bad_crop(crop):
    with pytest.raises(InputError, match=r"data\.crop="):
        View(crop, "rgb", None)


@pytest.mark.parametrize("size", [(0, 10), (66,), (66.0, 200), "66x200", (-1, 3)])
def test_bad_size(size):
    with pytest.raises(InputError, match=r"model\.size="):
        View((0, 0), "rgb", size)


@pytest.mark.parametrize("colour", ["bgr", "", None, "RGB"])
def test_unknown_colour_names_those_there_are(colour):
    with pytest.raises(InputError, match=r"model\.colour=.*rgb, yuv, gray, hsv_s"):
        View((0, 0), colour, None)


@pytest.mark.parametrize(("crop", "colour", "size", "shape"), SHAPE_CASES)
def test_out_takes_the_same_and_nothing_beside_it(
    crop: tuple, colour: str, size: tuple | None, shape: tuple, frame: np.ndarray
) -> None:
    """The cache writes each view into an array: its neighbours do not change."""
    view, several = View(crop, colour, size), np.full((3, *shape), 7, np.uint8)
    assert view(frame, out=several[1]).base is several
    assert np.array_equal(several[1], view(frame))
    assert (several[[0, 2]] == 7).all()
