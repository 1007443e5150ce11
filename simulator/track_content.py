"""A track from the content of its YAML file."""

from pathlib import Path
from typing import Annotated

from simulator.centreline_keys import CentrelineKeys, read_centreline
from simulator.track import Stretch, Surroundings, Track, Verge
from simulator.yaml_fields import Flag, number, read_keys
from zoo.base.errors import InputError


class TrackKeys(CentrelineKeys):
    """Keys of a track's file; see `docs/simulator.md`."""

    shoulder: Annotated[float, number(0, 10)] = 1.4
    centre_line: Flag = False
    verge: Verge = Verge()
    stretches: tuple[Stretch, ...] = ()
    surroundings: Surroundings = Surroundings()


def make_track(name: str, content: object, folder: Path = Path()) -> Track:
    """Return the track of a YAML file's content.

    Args:
        name: name of the track.
        content: content of the file.
        folder: folder of the file, in which a survey lies.

    Raises:
        InputError: a key or value is wrong, a bend is too tight for the car, or the road
            crosses itself at one height.
    """
    keys = read_keys(TrackKeys, content)
    centreline = read_centreline(keys, folder)
    stretches = []
    for at, one in enumerate(keys.stretches, start=1):
        if not one.start <= one.end <= centreline["length"]:
            most = f"{one.start:g}..{centreline['length']:g}"
            raise InputError(f"stretches, number {at}: to: {one.end:g}; must be in {most}")
        sides = {"left", "right"} - one.model_fields_set
        stretches.append(one.model_copy(update={side: getattr(keys.verge, side) for side in sides}))
    return Track(
        name=name,
        shoulder=keys.shoulder,
        centre_line=keys.centre_line,
        stretches=tuple(stretches),
        verge=keys.verge,
        surroundings=keys.surroundings,
        **centreline,
    )
