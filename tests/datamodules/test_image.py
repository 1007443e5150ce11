import io

import numpy as np
import pytest
from PIL import Image

from datamodules.image import checked_size, decode_image
from zoo.commands.check import look_at_image


@pytest.fixture
def jpeg(recorded) -> bytes:
    return recorded.image(7).read_bytes()


def encoded(image: np.ndarray, kind: str) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, kind)
    return buffer.getvalue()


def test_jpeg_is_rgb_as_another_library_decodes_it(jpeg):
    theirs = np.asarray(Image.open(io.BytesIO(jpeg)).convert("RGB")).astype(int)
    ours = decode_image(jpeg)
    assert (ours.shape, ours.dtype) == ((160, 320, 3), np.uint8)
    assert np.abs(ours - theirs).mean() < 1
    assert ours[5, 5, 2] > ours[5, 5, 0] + 50, "the sky is blue"


def test_grey_png_becomes_rgb():
    image = np.random.default_rng(0).integers(0, 256, (160, 320), np.uint8)
    np.testing.assert_array_equal(decode_image(encoded(image, "PNG"))[:, :, 2], image)


@pytest.mark.parametrize("size", [(160, 320), (120, 160), (480, 640), (256, 455)])
def test_png_to_the_bit_in_its_own_size(size):
    image = np.random.default_rng(0).integers(0, 256, (*size, 3), np.uint8)
    np.testing.assert_array_equal(decode_image(encoded(image, "PNG")), image)


@pytest.mark.parametrize("share", [0.999, 0.9, 0.5, 0.1])
def test_truncated_jpeg(jpeg, share):
    with pytest.raises(ValueError, match="truncated"):
        decode_image(jpeg[: int(share * len(jpeg))])


def test_jpeg_with_bytes_after_its_end(jpeg):
    np.testing.assert_array_equal(decode_image(jpeg + b"\0" * 64), decode_image(jpeg))


@pytest.mark.parametrize("kind", ["GIF", "BMP", "WEBP", "TIFF", "PPM", "JPEG2000"])
def test_another_kind_of_image_is_refused_by_training_and_check_alike(jpeg, tmp_path, kind):
    data = encoded(decode_image(jpeg), kind)
    with pytest.raises(ValueError, match="no JPEG or PNG") as caught:
        decode_image(data)
    image = tmp_path / "center_1.jpg"
    image.write_bytes(data)
    assert look_at_image(str(image)) == str(caught.value)


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
def test_what_is_cut_off_is_refused_by_training_and_check_alike(jpeg, tmp_path, kind):
    image = tmp_path / "center_1.jpg"
    whole = encoded(decode_image(jpeg), kind)
    for size in (0, 1, 2, 8, 100, len(whole) // 2, len(whole) - 12):
        image.write_bytes(whole[:size])
        with pytest.raises(ValueError) as caught:  # noqa: PT011 - any words, the same in both
            decode_image(whole[:size])
        assert look_at_image(str(image)) == str(caught.value)


@pytest.mark.parametrize(
    "data", [b"version https://git-lfs.github.com/spec/v1", b"\xff\xd8\xff\xd9"]
)
def test_no_image(data):
    with pytest.raises(ValueError, match="no JPEG or PNG"):
        decode_image(data)


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
@pytest.mark.parametrize("turn", [*range(1, 9), 0, 99, 65_535])
def test_a_size_is_that_after_the_turn_that_exif_names(kind, turn):
    image = Image.fromarray(np.zeros((80, 160, 3), np.uint8))
    exif, buffer = image.getexif(), io.BytesIO()
    exif[0x0112] = turn
    image.save(buffer, kind, exif=exif)
    height, width, _ = decode_image(buffer.getvalue()).shape
    assert checked_size(buffer.getvalue()) == (width, height)
    assert (width, height) == ((80, 160) if 5 <= turn <= 8 else (160, 80))


@pytest.mark.parametrize("tag", [b"Exif\0\0", b"Exif\0\0MM\0*\0\0\xff\xff", b"Exif\0\0XX", b"Exif"])
def test_a_damaged_exif_turns_nothing(tag):
    buffer = io.BytesIO()
    Image.fromarray(np.zeros((80, 160, 3), np.uint8)).save(buffer, "JPEG", exif=tag)
    assert decode_image(buffer.getvalue()).shape == (80, 160, 3)
    assert checked_size(buffer.getvalue()) == (160, 80)
