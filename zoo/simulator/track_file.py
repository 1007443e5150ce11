"""A reader of tracks: an included track, a user's own YAML file, or a road of a family."""

from pathlib import Path

from zoo.base.errors import UsageError, hint, placed_errors
from zoo.base.plain_files import read_yaml
from zoo.simulator.road_family import draw_road, find_family
from zoo.simulator.track import Track
from zoo.simulator.track_content import make_track
from zoo.simulator.track_names import (
    ALIASES,
    DRAWN,
    family_names,
    recorded_name,
    short_name,
    track_folder,
    track_names,
)

MOST_PATH = 4096  # characters of the path of a track's file


def read_track(name: str) -> Track:
    """Read a track by its name, by the path of its YAML file, or as `FAMILY:SEED`.

    Raises:
        InputError: there is no such track, file or family, a key or value is wrong, a bend is
            too tight for the car, or the road crosses itself at one height.
    """
    path = track_folder() / f"{ALIASES.get(name, name)}.yaml"
    if name.endswith((".yaml", ".yml")):
        path = Path(name)
    usable = "\0" not in name and len(name) <= MOST_PATH
    if usable and not path.exists() and (drawn := DRAWN.fullmatch(name)):
        return draw_road(find_family(drawn[1]), int(drawn[2]))
    if not usable or not path.exists():
        name = ascii(name[:MOST_PATH])[1:-1] if "\0" in name else name[:MOST_PATH]
        names, families = sorted(map(recorded_name, track_names())), family_names()
        raise UsageError(
            f"there is no track {name}, .yaml file, or road of a family and a number, "
            f"such as {families[0]}:17 ({', '.join(families)}); {hint(name, names)}"
        )
    content = read_yaml(path)
    with placed_errors(path):
        return make_track(recorded_name(short_name(str(path))), content, path.parent)
