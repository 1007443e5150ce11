"""Inputs that are tried: those with the network's shape that are not excluded."""

import pytest

from datamodules.view import View
from zoo.base.errors import InputError
from zoo.input_search.combinations import (
    CROPS,
    SCALES,
    Combination,
    KnownInput,
    combinations,
    likeliest_combination,
    with_each_resize,
)

PILOTNET = KnownInput(shape=(66, 200, 3), scale=SCALES[0])


def test_every_colour_of_three_channels_is_tried_with_every_crop() -> None:
    found = combinations(PILOTNET)
    assert len(found) == len(set(found)) == 5 * len(CROPS)
    assert {one.view.colour for one in found} == {"rgb", "bgr", "yuv", "yuv_old", "hsv"}
    assert {one.view.shape for one in found} == {(66, 200, 3)}


def test_a_whole_frame_is_not_cropped() -> None:
    found = combinations(KnownInput(shape=(160, 320, 3), scale=SCALES[0]))
    assert {(one.view.crop, one.view.size) for one in found} == {((0, 0), None)}


def test_a_crop_that_leaves_the_input_is_not_resized() -> None:
    found = combinations(KnownInput(shape=(80, 320, 1), scale=SCALES[0]))
    assert {one.view.colour for one in found} == {"gray", "hsv_s"}
    assert {one.view.crop for one in found if one.view.size is None} == {(60, 20), (55, 25)}
    assert likeliest_combination(KnownInput(shape=(65, 320, 3), scale=SCALES[0])).view == View(
        (70, 25), "rgb", None
    )


def test_what_is_known_is_not_tried() -> None:
    known = KnownInput(
        shape=(66, 200, 3), colour="bgr", crop=(61, 26), resize="linear", scale=(2.0, 0.0)
    )
    (only,) = combinations(known)
    assert only == Combination(View((61, 26), "bgr", (66, 200), "linear"), (2.0, 0.0))
    assert with_each_resize(only, known) == [only]


def test_an_unknown_scale_is_tried() -> None:
    found = combinations(KnownInput(shape=(66, 200, 3), colour="rgb", crop=(60, 25)))
    assert [one.scale for one in found] == list(SCALES)


def test_a_colour_of_other_channels_is_refused() -> None:
    with pytest.raises(InputError, match=r"colour=gray: .* 66 x 200 x 3.*3 channels"):
        combinations(KnownInput(shape=(66, 200, 3), colour="gray"))


def test_resizing_before_the_colour_is_tried_where_it_differs() -> None:
    yuv = Combination(View((60, 25), "yuv", (66, 200)), SCALES[0])
    rgb = Combination(View((60, 25), "rgb", (66, 200)), SCALES[0])
    whole = Combination(View((0, 0), "yuv", None), SCALES[0])
    ways = [
        [one.view.resize for one in with_each_resize(one, PILOTNET)] for one in (yuv, rgb, whole)
    ]
    assert ways == [["area", "linear", "area_first", "linear_first"], ["area", "linear"], ["area"]]
