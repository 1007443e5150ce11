"""Inputs that a network of 2016 to 2022 may have been trained with."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from datamodules.errors import InputError
from datamodules.image import FRAME_HEIGHT, FRAME_WIDTH
from datamodules.view import CONVERSIONS, RESIZES, View

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
        shape: input's `(height, width, channels)`; height and width may be None.
        colour, crop, size, resize: as in `View`.
        scale: as in `Combination`.
    """

    shape: tuple[int | None, int | None, int]
    colour: str | None = None
    crop: Pair | None = None
    size: Pair | None = None
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
        height, width, channels = (one or "any" for one in known.shape)
        given = " ".join(
            f"{key}={_pair(one) if isinstance(one, tuple) else one}"
            for key in ("colour", "crop", "size")
            if (one := getattr(known, key)) is not None
        )
        raise InputError(
            f"{given or 'the file'}: the network's input is {height} x {width} x {channels}; set "
            "colour, crop and size to views of that shape"
        )
    return found


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
    colours = [known.colour] if known.colour else list(CONVERSIONS)
    for colour in colours:
        for crop, size in _crops_and_sizes(known):
            view = View(crop, colour, size, known.resize or USUAL_RESIZE)
            if all(
                want in (None, have) for want, have in zip(known.shape, view.shape, strict=True)
            ):
                yield view


def _crops_and_sizes(known: KnownInput) -> Iterator[tuple[Pair, Pair | None]]:
    """Yield crops with the size after each; None is a view that is not resized."""
    height, width, _ = known.shape
    size = known.size or (None if height is None or width is None else (height, width))
    whole = (FRAME_HEIGHT, FRAME_WIDTH)
    if known.crop is not None:
        cropped = (FRAME_HEIGHT - sum(known.crop), FRAME_WIDTH)
        yield known.crop, None if size == cropped else size
    elif size in (None, whole):
        yield (0, 0), None
    else:
        for crop in CROPS:
            cropped = (FRAME_HEIGHT - sum(crop), FRAME_WIDTH)
            yield crop, None if size == cropped else size


def _pair(pair: Sequence[float]) -> str:
    return f"[{','.join(f'{number:g}' for number in pair)}]"
