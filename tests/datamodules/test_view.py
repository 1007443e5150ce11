import colorsys
import json

import cv2
import numpy as np
import pytest

from datamodules.image import decode_image
from datamodules.view import CONVERSIONS, RESIZES, View, view_to_rgb
from zoo.base.errors import InputError

SHAPE_CASES = [
    ((60, 25), "rgb", (66, 200), (66, 200, 3)),
    ((0, 0), "yuv", None, (160, 320, 3)),
    ((50, 0), "hsv_s", (11, 32), (11, 32, 1)),
    ((40, 20), "gray", None, (100, 320, 1)),
    ((0, 159), "gray", (1, 1), (1, 1, 1)),
    ((0, 0), "rgb", (224, 448), (224, 448, 3)),
    ((60, 25), "bgr", (66, 200), (66, 200, 3)),
    ((0, 0), "hsv", None, (160, 320, 3)),
]


@pytest.fixture(scope="module")
def frame() -> np.ndarray:
    """Return an image of random colours, uint8 [160, 320, 3]."""
    return np.random.default_rng(0).integers(0, 256, (160, 320, 3), np.uint8)


def by_hand(frame: np.ndarray, colour: str) -> np.ndarray:
    """Convert with the textbook's formulas; return float [160, 320, C].

    `yuv_old` is the formula of OpenCV before 3.2.
    """
    red, green, blue = np.moveaxis(frame.astype(float), 2, 0)
    luma = 0.299 * red + 0.587 * green + 0.114 * blue
    luma_old = 0.114 * red + 0.587 * green + 0.299 * blue
    largest, smallest = frame.max(axis=2).astype(float), frame.min(axis=2).astype(float)
    planes = {
        "rgb": [red, green, blue],
        "bgr": [blue, green, red],
        "yuv": [luma, 0.492 * (blue - luma) + 128, 0.877 * (red - luma) + 128],
        "yuv_old": [luma_old, 0.492 * (red - luma_old) + 128, 0.877 * (blue - luma_old) + 128],
        "gray": [luma],
        "hsv_s": [255 * (largest - smallest) / np.maximum(largest, 1)],
    }
    hue = [colorsys.rgb_to_hsv(*pixel)[0] * 180 for pixel in frame.reshape(-1, 3) / 255]
    planes["hsv"] = [np.reshape(hue, frame.shape[:2]), *planes["hsv_s"], largest]
    return np.clip(np.stack(planes[colour], axis=2), 0, 255)


@pytest.mark.parametrize("colour", CONVERSIONS)
def test_colour_is_the_textbooks(frame, colour):
    difference = np.abs(View(crop=(0, 0), colour=colour, size=None)(frame) - by_hand(frame, colour))
    if colour == "hsv":  # a hue of 180 is one of 0
        difference[..., 0] = np.minimum(difference[..., 0], 180 - difference[..., 0])
    assert difference.max() <= 1


@pytest.mark.parametrize("colour", CONVERSIONS)
@pytest.mark.parametrize("resize", RESIZES)
def test_resize_is_opencvs_before_or_after_the_colour(recorded, colour, resize):
    frame = decode_image(recorded.image(3).read_bytes())
    way = cv2.INTER_AREA if resize.startswith("area") else cv2.INTER_LINEAR
    cropped, convert = frame[60:135], CONVERSIONS[colour]
    first = convert(cv2.resize(cropped, (200, 66), interpolation=way))
    after = convert(cropped)
    if resize.startswith("blur"):
        after = cv2.GaussianBlur(after, (3, 3), 0)
    after = cv2.resize(after, (200, 66), interpolation=way)
    wanted = first if resize.endswith("_first") else after
    ours = View((60, 25), colour, (66, 200), resize)(frame)
    np.testing.assert_array_equal(ours, wanted.reshape(ours.shape))


def test_survives_a_checkpoint():
    for view in (
        View((60, 25), "yuv", (66, 200)),
        View((0, 0), "gray", None),
        View((60, 25), "yuv_old", (66, 200), "linear_first"),
    ):
        assert View.from_dict(json.loads(json.dumps(view.to_dict()))) == view


def test_a_view_of_an_earlier_checkpoint_is_by_area_and_of_the_simulators_frame():
    earlier = View.from_dict({"crop": [60, 25], "colour": "rgb", "size": None})
    assert earlier == View((60, 25), "rgb", None, "area", frame=(160, 320))


@pytest.mark.parametrize("colour", ["rgb", "bgr", "yuv", "yuv_old", "hsv"])
def test_colours_are_turned_back_for_people(recorded, colour):
    frame = decode_image(recorded.image(3).read_bytes())
    back = view_to_rgb(View((0, 0), colour, None)(frame), colour)
    assert np.abs(back.astype(int) - frame).max() <= (5 if colour == "hsv" else 3)


def test_gray_is_shown_as_three_equal_channels(frame):
    gray = View((0, 0), "gray", None)(frame)
    shown = view_to_rgb(gray, "gray")
    assert shown.shape == (160, 320, 3)
    assert (shown == gray).all()


GOOD = {"crop": (0, 0), "colour": "rgb", "size": (66, 200), "resize": "area"}
BAD = {
    "crop": [(-1, 0), (80, 80), (0, 160), (1.5, 0), (1,), 40, None, "ab"],
    "size": [(0, 10), (66,), (66.0, 200), "66x200", (-1, 3)],
    "colour": ["", None, "RGB"],
    "resize": ["cubic", "", None, "first"],
}
NAMED = {
    "crop": r"data\.crop=",
    "size": r"model\.size=",
    "colour": r"model\.colour=.*rgb, .*yuv_old, .*hsv_s",
    "resize": r"model\.resize=.*area, linear, area_first, linear_first",
}


@pytest.mark.parametrize(("key", "value"), [(key, value) for key in BAD for value in BAD[key]])
def test_a_bad_value_is_named_with_those_there_are(key, value):
    with pytest.raises(InputError, match=NAMED[key]):
        View(**GOOD | {key: value})


@pytest.mark.parametrize("resize", RESIZES)
@pytest.mark.parametrize(("crop", "colour", "size", "shape"), SHAPE_CASES)
def test_a_view_has_its_shape_and_out_takes_the_same_and_nothing_beside_it(
    crop: tuple, colour: str, size: tuple | None, shape: tuple, resize: str, frame: np.ndarray
) -> None:
    """The cache writes each view into an array: its neighbours do not change."""
    view, several = View(crop, colour, size, resize), np.full((3, *shape), 7, np.uint8)
    before, image = frame.copy(), view(frame)
    assert (image.shape, image.dtype, view.shape) == (shape, np.uint8, shape)
    assert view(frame, out=several[1]).base is several
    assert np.array_equal(several[1], image)
    assert np.array_equal(frame, before)
    assert (several[[0, 2]] == 7).all()


@pytest.mark.parametrize("size", [(160, 320), (480, 640), (120, 160), (256, 455), (66, 200)])
@pytest.mark.parametrize(("crop", "rows"), [((60, 25), (0.375, 0.15625)), ((0, 0), (0, 0))])
def test_a_frame_of_any_size_is_cropped_in_shares_and_resized_once(size, crop, rows):
    frame = np.random.default_rng(1).integers(0, 256, (*size, 3), np.uint8)
    top, bottom = (int(share * size[0]) for share in rows)
    cropped = frame[top : size[0] - bottom]
    wanted = cv2.resize(cropped, (200, 66), interpolation=cv2.INTER_AREA)
    np.testing.assert_array_equal(View(crop, "rgb", (66, 200))(frame), wanted)
    np.testing.assert_array_equal(View(crop, "rgb", None, frame=size)(frame), cropped)


@pytest.mark.parametrize("height", range(1, 20))
def test_a_crop_leaves_a_row_of_any_frame(height):
    view = View((100, 59), "rgb", (4, 8))
    assert view(np.full((height, 5, 3), 7, np.uint8)).tolist() == np.full((4, 8, 3), 7).tolist()


def test_without_a_size_another_frame_is_resized_to_that_of_the_training():
    view = View((40, 20), "gray", None, frame=(120, 160))
    assert view.shape == (75, 160, 1)
    for size in ((120, 160), (160, 320), (480, 640)):
        assert view(np.full((*size, 3), 9, np.uint8)).shape == (75, 160, 1)
