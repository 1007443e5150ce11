"""Augmentations of images and of the steering."""

import colorsys
from dataclasses import replace
from pathlib import Path

import albumentations
import cv2
import numpy as np
import pytest
from hydra.utils import instantiate
from omegaconf import OmegaConf
from scipy import stats

from datamodules.augment import Brightness, Change, Shadow, Shift
from datamodules.augmented_batch import Augment
from datamodules.bend import Bend, added_steering, depth_of
from datamodules.image import decode_image
from datamodules.view import CONVERSIONS, View
from zoo.base.errors import InputError
from zoo.base.rig import UDACITY
from zoo.simulator import udacity_car as rig

CONF = sorted((Path(__file__).parents[2] / "conf" / "augment").glob("*.yaml"))


@pytest.fixture(scope="module")
def images(recorded) -> np.ndarray:
    """Return RGB images, uint8 [6, 66, 200, 3]."""
    return views(recorded, "rgb")


def views(recorded, colour: str) -> np.ndarray:
    view = View((60, 25), colour, (66, 200))
    return np.stack([view(decode_image(recorded.image(row).read_bytes())) for row in range(6)])


def zeros(images: np.ndarray) -> np.ndarray:
    return np.zeros(len(images), np.float32)


def always(scale: float, colour: str = "rgb") -> Augment:
    return Augment([Brightness(scale=(scale, scale), p=1.0)], colour)


@pytest.mark.parametrize("scale", [0.25, 0.6, 1.0, 1.2, 1.25, 3.0])
def test_brightness_scales_v_of_hsv(scale):
    """Errors reach 6 of 255: OpenCV rounds, and its hue has steps of 2 degrees (4 levels)."""
    colours = np.random.default_rng(0).integers(0, 256, (1, 12, 12, 3), np.uint8)
    changed, _ = always(scale)(colours, np.zeros(1, np.float32), seed=1)
    for before, after in zip(colours.reshape(-1, 3), changed.reshape(-1, 3), strict=True):
        hue, saturation, value = colorsys.rgb_to_hsv(*(before / 255))
        wanted = colorsys.hsv_to_rgb(hue, saturation, min(value * scale, 1))
        assert np.abs(after - 255 * np.array(wanted)).max() <= 6


def test_brightness_draws_from_the_whole_range():
    white = np.full((400, 2, 2, 3), 200, np.uint8)
    changed, _ = Augment([Brightness(scale=(1.25, 0.25))], "rgb")(white, zeros(white), seed=1)
    factors = changed[:, 0, 0, 0] / 200
    assert 0.25 <= factors.min() < 0.3
    assert 1.2 < factors.max() <= 1.25
    assert factors.mean() == pytest.approx(0.75, abs=0.05)


def column_of_post(image: np.ndarray) -> float:
    weights = image[..., 0].astype(float).sum(axis=0)
    return float((weights * np.arange(len(weights))).sum() / weights.sum())


@pytest.mark.parametrize("width", [320, 160])
def test_scenery_moved_right_steers_right_by_the_pixel(width):
    """The shift counts pixels of the recording's 320, in a view of any width."""
    posts = np.zeros((60, 40, width, 3), np.uint8)
    posts[:, :, width // 2 - 2 : width // 2 + 2] = 255
    augment = Augment([Shift(pixels=40, steering_per_pixel=0.01, p=1.0)], "rgb")
    moved, steering = augment(posts, zeros(posts), seed=3)
    pixels = [column_of_post(image) - column_of_post(posts[0]) for image in moved]
    right = np.array(pixels) * 320 / width
    np.testing.assert_allclose(steering, 0.01 * right, atol=0.006)
    assert right.min() < -30
    assert right.max() > 30


def test_shift_adds_to_the_steering_and_clips_it():
    image = np.zeros((200, 8, 320, 3), np.uint8)
    augment = Augment([Shift(pixels=40, steering_per_pixel=0.004, p=1.0)], "rgb")
    _, around = augment(image, np.full(200, 0.5, np.float32), seed=3)
    assert np.abs(around - 0.5).max() == pytest.approx(0.16, abs=0.01)
    _, clipped = augment(image, np.full(200, 0.95, np.float32), seed=3)
    assert clipped.max() == 1.0


def test_shift_of_rows_moves_up_and_down_without_steering():
    horizon = np.zeros((40, 40, 320, 3), np.uint8)
    horizon[:, 20:] = 255
    moved, steering = Augment([Shift(pixels=0, rows=6, p=1.0)], "rgb")(horizon, zeros(horizon), 3)
    edges = 40 - moved[:, :, 0, 0].sum(axis=1) / 255
    assert not steering.any()
    assert 14 <= edges.min() < 16
    assert 24 < edges.max() <= 26


def test_a_shift_is_an_affine_map_that_repeats_the_edge(images):
    image, (right, down) = images[0], (23.3, -2.6)
    matrix = np.float32([[1, 0, right * 200 / 320], [0, 1, down]])
    wanted = cv2.warpAffine(image, matrix, (200, 66), borderMode=cv2.BORDER_REPLICATE)
    moved = image.copy()
    Shift().change_one(moved, np.array([right, down]))
    difference = np.abs(moved.astype(int) - wanted)
    assert difference.max() <= 2
    assert difference.mean() < 0.5
    assert np.abs(image.astype(int) - wanted).mean() > 5, "it was moved"


def test_what_is_not_shifted_keeps_its_steering(images):
    augment = Augment([Shift(pixels=40, p=0.5)], "rgb")
    moved, steering = augment(images.repeat(20, axis=0), np.zeros(120, np.float32), seed=1)
    same = (moved == images.repeat(20, axis=0)).all(axis=(1, 2, 3))
    np.testing.assert_array_equal(same, steering == 0)
    assert 40 < same.sum() < 80


def test_grey_and_yuv_are_lit_as_rgb_is(recorded):
    gray = views(recorded, "gray")
    changed, _ = always(1.2, "gray")(gray, zeros(gray), seed=1)
    assert np.abs(changed - np.minimum(gray * 1.2, 255)).max() <= 0.5
    rgb, yuv = views(recorded, "rgb"), views(recorded, "yuv")
    lit_rgb, _ = always(0.5)(rgb, zeros(rgb), seed=1)
    lit_yuv, _ = always(0.5, "yuv")(yuv, zeros(yuv), seed=1)
    wanted = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2YUV) for image in lit_rgb])
    assert np.abs(lit_yuv.astype(int) - wanted).mean() < 1
    assert np.abs(yuv.astype(int) - wanted).mean() > 10, "it was changed"


def everything() -> list[albumentations.BasicTransform]:
    return [Brightness(), Shadow(p=0.5), Shift(), albumentations.GaussNoise(p=0.5)]


def test_same_seed_same_images(images):
    steering = zeros(images)
    augment = Augment(everything(), "rgb")
    drawn = augment(images, steering, seed=5)
    augment(images, steering, seed=6)
    for repeated in (augment, Augment(everything(), "rgb")):
        for array, again in zip(drawn, repeated(images, steering, seed=5), strict=True):
            np.testing.assert_array_equal(again, array)


def test_transforms_of_a_batch_draw_independently():
    """With albumentations' random stream both transforms would change the same images."""
    white = np.full((1, 8, 320, 3), 200, np.uint8)
    augment = Augment([Shift(p=0.5), Brightness(scale=(0.5, 0.5), p=0.5)], "rgb")
    seen = set()
    for seed in range(60):
        image, steering = augment(white, np.zeros(1, np.float32), seed)
        seen.add((steering[0] != 0, image.mean() < 150))
    assert len(seen) == 4


def test_what_is_fed_in_is_left_as_it_was(images):
    before, steering = images.copy(), zeros(images)
    Augment(everything(), "rgb")(images, steering, seed=1)
    np.testing.assert_array_equal(images, before)
    assert not steering.any()


@pytest.mark.parametrize(
    ("transforms", "colour"),
    [([], "yuv"), ([Shadow(p=0.0), Brightness(p=0.0), Shift(p=0.0)], "rgb")],
)
def test_a_batch_without_a_changed_sample_stays(images, transforms, colour):
    same, steering = Augment(transforms, colour)(images, zeros(images), seed=1)
    np.testing.assert_array_equal(same, images)
    assert not steering.any()


@pytest.mark.parametrize("transform", [albumentations.Normalize(), albumentations.Transpose(p=1)])
def test_an_image_of_another_type_or_shape_is_refused(images, transform):
    name = type(transform).__name__
    with pytest.raises(InputError, match=rf"^augment: {name} must return uint8 \[\d+, \d+, 3\]"):
        Augment([transform], "rgb")(images, zeros(images), seed=1)


@pytest.mark.parametrize("colour", CONVERSIONS)
@pytest.mark.parametrize("path", CONF, ids=lambda path: path.stem)
def test_every_yaml_runs_on_every_colour(path, colour, recorded):
    transform = instantiate(OmegaConf.load(path), p=1.0, _convert_="all")
    ours = isinstance(transform, Change)
    if ours:
        fitted(transform)
    inputs = views(recorded, colour)
    changed, steering = Augment([transform], colour)(inputs, zeros(inputs), seed=1)
    assert (changed.shape, changed.dtype) == (inputs.shape, np.uint8)
    assert (steering.shape, steering.dtype) == ((6,), np.float32)
    light = ours and transform.lighting
    assert np.array_equal(changed, inputs) == (light and colour == "hsv_s")
    assert steering.any() == (ours and not light)
    assert np.abs(changed.astype(int) - inputs).mean() < 128, "the image can still be recognized"


@pytest.mark.parametrize("path", CONF, ids=lambda path: path.stem)
def test_every_yaml_opens_with_the_command_that_uses_it(path):
    package, command = path.read_text().splitlines()[:2]
    assert package == f"# @package data.augment.{path.stem}"
    assert command.startswith("# drivezoo train 'augment=[")
    assert path.stem in command


def test_shadows_are_those_of_albumentations(recorded):
    """Both change 3,000 copies of an image alike, by quantiles of its means."""
    image = np.ascontiguousarray(views(recorded, "rgb")[0, ::2, ::2])
    keys = {"shadow_roi": (0, 0.2, 0.9, 1), "num_shadows_limit": (1, 2), "p": 0.5}
    batch = np.repeat(image[None], 3_000, axis=0)
    Augment([Shadow(**keys)], "rgb").in_place(batch, np.zeros(3_000, np.float32), seed=1)
    compose = albumentations.Compose([albumentations.RandomShadow(**keys)], seed=2)
    single = np.stack([compose(image=image)["image"] for _ in range(3_000)])
    for window in (np.s_[:, :, :], np.s_[:, :10, :25], np.s_[:, 20:, 75:]):
        ours, theirs = (kind[window].mean((1, 2, 3)) for kind in (batch, single))
        assert stats.ks_2samp(ours, theirs).pvalue > 0.001


def test_a_shadow_is_as_dark_as_that_of_albumentations(images):
    """Shadows differ by up to 1 of 255: albumentations truncates, OpenCV rounds."""
    shadow, theirs = Shadow(num_shadows_limit=(2, 2)), albumentations.RandomShadow()
    drawn = shadow.draw(images.shape, np.random.default_rng(3))
    for image, values in zip(images.copy(), drawn, strict=True):
        outlines = values.reshape(2, -1)
        corners = outlines[:, :-1].reshape(2, -1, 2).astype(int)
        wanted = theirs.apply(image, vertices_list=corners, intensities=outlines[:, -1])
        shadow.change_one(image, values)
        assert np.abs(image.astype(int) - wanted).max() <= 1


CAMERA = UDACITY.cameras["center"]
BEGUN = -rig.REAR_AXLE_M


def fitted(change: Change, crop: tuple[int, int] = (0, 0)) -> Change:
    """Return a change that knows the crop and the car of the recording."""
    change.fit(crop, UDACITY)
    return change


def aside(bend: Bend, rows: int, curvature: float, begin: float, length: float) -> np.ndarray:
    return bend.columns_aside(rows, tuple(np.array([[[curvature]], [[begin]], [[length]]])))[0]


@pytest.mark.parametrize("curvature", [0.02, -0.02])
def test_a_straight_line_becomes_the_circle_that_the_camera_would_see(curvature: float) -> None:
    """The reference projects points of a circle that touches the car at its rear axle."""
    moved = aside(fitted(Bend()), 160, curvature, BEGUN, 60.0)
    for ahead in (4.0, 8.0, 15.0):
        along = ahead + CAMERA.ahead_m + rig.REAR_AXLE_M
        sideways = (1 - np.sqrt(1 - (curvature * along) ** 2)) / curvature
        below = np.arctan(CAMERA.up_m / ahead) - np.radians(CAMERA.pitch_down_deg)
        row = 79.5 + CAMERA.focal_px * np.tan(below)  # of 160
        seen = CAMERA.focal_px * sideways / depth_of(ahead, CAMERA)
        assert np.interp(row, np.arange(160), moved) == pytest.approx(seen, rel=0.1)


def test_a_bend_that_has_begun_steers_by_its_radius_and_a_later_one_not_yet() -> None:
    angle = np.degrees(np.arctan(rig.WHEELBASE_M * 0.05)) / rig.MAX_STEERING_DEG
    curvature, begin = np.array([0.05, -0.05, 0.05, 0.05]), np.array([BEGUN, BEGUN, 2.0, 4.0])
    assert added_steering(curvature, begin, UDACITY) == pytest.approx([angle, -angle, angle / 2, 0])


def test_near_rows_stay_until_the_bend_begins_and_far_ones_move_most() -> None:
    moved = aside(fitted(Bend()), 160, 0.05, 6.0, 20.0)
    assert moved[-1] == 0
    assert (np.diff(moved[60:]) <= 0).all()
    assert moved[60] > 20


def test_a_cropped_and_resized_view_moves_like_the_rows_it_shows() -> None:
    whole, cropped = fitted(Bend()), fitted(Bend(), (40, 20))
    of_view = aside(cropped, 50, 0.04, BEGUN, 20.0)  # two rows of the recording each
    of_frame = aside(whole, 160, 0.04, BEGUN, 20.0)
    assert of_view == pytest.approx(of_frame[40:140].reshape(50, 2).mean(1), abs=0.7)


def test_a_rig_of_twice_the_pixels_moves_the_same_shares_of_a_view() -> None:
    shape, bends = (9, 50, 100, 3), [fitted(Bend(), (40, 20)), Bend()]
    bends[1].fit((40, 20), replace(UDACITY, cameras={"center": replace(CAMERA, size=(640, 320))}))
    usual, doubled = (bend.draw(shape, np.random.default_rng(2)) for bend in bends)
    assert doubled == pytest.approx(usual, abs=0.2)


def test_a_car_of_unknown_make_cannot_be_bent_for() -> None:
    with pytest.raises(InputError, match=r"bend.*recordings of one car.*data\.rig="):
        Bend().fit((40, 20), None)


def test_it_moves_the_image_to_the_side_it_steers_to() -> None:
    image = np.zeros((1, 66, 200, 3), np.uint8)
    image[:, :, 98:102] = 255  # a line straight ahead
    augment = Augment([fitted(Bend(p=1.0, begun=1.0), (40, 20))], "rgb")
    for seed in range(20):
        changed, steering = augment(image, np.zeros(1, np.float32), seed)
        column = changed[0, 30].mean(-1).argmax()
        if abs(steering[0]) > 0.1:
            assert np.sign(column - 99.5) == np.sign(steering[0])


def test_a_share_of_the_samples_is_left_alone() -> None:
    images = np.random.default_rng(0).integers(0, 255, (400, 8, 16, 1)).astype(np.uint8)
    changed, steering = Augment([fitted(Bend(p=0.3, begun=0.5))], "gray")(images, zeros(images), 1)
    assert 0.2 < (changed != images).any((1, 2, 3)).mean() < 0.4
    assert 0.15 < (steering != 0).mean() < 0.27
