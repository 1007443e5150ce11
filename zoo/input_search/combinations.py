"""Inputs that a network of 2016 to 2022 may have been trained with."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from datamodules.image import FRAME_HEIGHT, FRAME_WIDTH
from datamodules.view import CONVERSIONS, RESIZES, View
from zoo.base.errors import InputError

Scale = tuple[float, float]
Pair = tuple[int, int]

# Rows off the top and the bottom in published solutions of the course's project: none, then the
# most frequent first. (60, 25) and (50, 20) stood before a resize to 66 x 200, (32, 25) before one
# to 64 x 64; (70, 25) and (50, 20) are the course's own Cropping2D.
CROPS: tuple[Pair, ...] = (
    (0, 0),
    (60, 25),
    (70, 25),
    (50, 20),
    (60, 20),
    (65, 25),
    (55, 25),
    (50, 25),
    (65, 20),
    (70, 20),
    (40, 20),
    (32, 25),
    (80, 20),
)
# The network computes pixel / scale[0] - scale[1]: x/127.5-1, x/255-0.5, x/255, (x-128)/128, x.
SCALES: tuple[Scale, ...] = ((127.5, 1.0), (255.0, 0.5), (255.0, 0.0), (128.0, 1.0), (1.0, 0.0))
USUAL_RESIZE = "area"
USUAL_CROP = (60, 25)


@dataclass(frozen=True)
class Combination:
    """A view, and the scale of its pixels: the network computes `pixel / scale[0] - scale[1]`."""

    view: View
    scale: Scale

    def text(self) -> str:
        """Return the keys of `drivezoo import` that choose this combination.

        >>> Combination(View((60, 25), "yuv", (66, 200)), (127.5, 1.0)).text()
        'colour=yuv crop=[60,25] size=[66,200] resize=area scale=[127.5,1]'
        """
        view = self.view
        keys = [f"colour={view.colour}", f"crop={_pair(view.crop)}"]
        keys += [f"size={_pair(view.size)}", f"resize={view.resize}"] if view.size else []
        return " ".join([*keys, f"scale={_pair(self.scale)}"])


@dataclass(frozen=True, kw_only=True)
class KnownInput:
    """What is known of a network's input from its file or from the user; None is not known.

    Attributes:
        shape: input's `(height, width, channels)`.
        colour, crop, resize: as in `View`.
        scale: as in `Combination`.
    """

    shape: tuple[int, int, int]
    colour: str | None = None
    crop: Pair | None = None
    resize: str | None = None
    scale: Scale | None = None


def combinations(known: KnownInput) -> list[Combination]:
    """Return the combinations that fit what is known, the likeliest first, resized by area.

    Raises:
        InputError: no view has the network's input shape.
    """
    found = [
        Combination(view, scale)
        for scale in ([known.scale] if known.scale else SCALES)
        for view in _views(known)
    ]
    if not found:
        height, width, channels = known.shape
        raise InputError(
            f"colour={known.colour}: the network's input is {height} x {width} x {channels}; set a "
            f"colour of {channels} channel{'s' * (channels > 1)}"
        )
    return found


def likeliest_combination(known: KnownInput) -> Combination:
    """Return the most usual combination that fits what is known.

    It is a view of the cropped frame as it is, or else one after a crop of (60, 25).
    """

    def rank(one: Combination) -> tuple[bool, bool]:
        return one.view.size is not None, one.view.crop != USUAL_CROP

    return min(combinations(known), key=rank)


def with_each_resize(found: Combination, known: KnownInput) -> list[Combination]:
    """Return a combination with each way of resizing that is possible, its own first."""
    if known.resize or found.view.size is None:
        return [found]
    ways = [way for way in RESIZES if way != found.view.resize]
    # A single channel of an RGB image is resized the same before and after the conversion.
    if found.view.colour in ("rgb", "bgr"):
        ways = [way for way in ways if not way.endswith("_first")]
    return [found, *(replace(found, view=replace(found.view, resize=way)) for way in ways)]


def _views(known: KnownInput) -> Iterator[View]:
    for colour in [known.colour] if known.colour else CONVERSIONS:
        for crop in _crops(known):
            cropped = (FRAME_HEIGHT - sum(crop), FRAME_WIDTH)
            size = None if known.shape[:2] == cropped else known.shape[:2]
            view = View(crop, colour, size, known.resize or USUAL_RESIZE)
            if view.shape == known.shape:
                yield view


def _crops(known: KnownInput) -> Sequence[Pair]:
    if known.crop is not None:
        return [known.crop]
    return CROPS[:1] if known.shape[:2] == (FRAME_HEIGHT, FRAME_WIDTH) else CROPS


def _pair(pair: Sequence[float]) -> str:
    return f"[{','.join(f'{number:g}' for number in pair)}]"
