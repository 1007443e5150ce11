"""Names of the included tracks (`conf/track/<name>.yaml`), their aliases and Gymnasium ids."""

import re
from pathlib import Path

from zoo.base.conf_files import conf_folder

# Records and figures keep the older names of these tracks, so that no road is ranked as two.
ALIASES = {"lake": "zoo_lake", "mountain": "zoo_mountain"}
# A road of a family: the family and a number, of which `017` would be a second name.
DRAWN = re.compile(r"(.+):(0|[1-9]\d{0,9})")
ANY_ROAD = "*"  # in place of the number: an environment draws another road for each seed
RECORDED = {name: alias for alias, name in ALIASES.items()}


def track_folder() -> Path:
    """Return the folder of the included tracks, in the installation or in the checkout."""
    return conf_folder() / "track"


def road_folder() -> Path:
    """Return the folder of the included families of roads."""
    return conf_folder() / "road"


def track_names() -> list[str]:
    """Return the names of the included tracks, sorted, without aliases."""
    return sorted(path.stem for path in track_folder().glob("*.yaml"))


def family_names() -> list[str]:
    """Return the names of the included families of roads, sorted."""
    return sorted(path.stem for path in road_folder().glob("*.yaml"))


def is_included(track: str) -> bool:
    """Return whether a name is that of an included track, or of a road of an included family.

    >>> is_included("lake"), is_included("alpine:17"), is_included("roads/own.yaml:17")
    (True, True, False)
    """
    drawn = DRAWN.fullmatch(track)
    names = family_names() if drawn else map(recorded_name, track_names())
    return (drawn[1] if drawn else recorded_name(track)) in names


def recorded_name(name: str) -> str:
    """Return the name of a track in records and figures.

    >>> recorded_name("zoo_lake"), recorded_name("lake"), recorded_name("udacity_lake")
    ('lake', 'lake', 'udacity_lake')
    """
    return RECORDED.get(name, name)


def short_name(track: str) -> str:
    """Return the name of a track for headings: without the folder and suffix of its file.

    A user's file is never called as the included track of its name.

    >>> short_name("udacity_lake"), short_name("alpine:17"), short_name("roads/own.yaml:17")
    ('udacity_lake', 'alpine:17', 'own:17')
    >>> short_name("roads/own.yaml"), short_name("roads/lake.yaml")
    ('own', 'lake.yaml')
    """
    path = Path(track)
    if drawn := DRAWN.fullmatch(track):
        return f"{Path(drawn[1]).stem}:{drawn[2]}"
    is_users = path.suffix and path.absolute().parent != track_folder()
    return path.name if is_users and is_included(path.stem) else path.stem


def full_name(track: str) -> str:
    """Return the name of a track for sentences, which never takes one track for another.

    >>> full_name("lake"), full_name("udacity_lake"), full_name("roads/lake.yaml")
    ('zoo_lake', 'udacity_lake', 'lake.yaml')
    """
    return ALIASES.get(track, short_name(track))


def file_name(track: str) -> str:
    """Return the name of a track for files and folders; Windows allows no colon in them.

    >>> file_name("udacity_lake"), file_name("alpine:17"), file_name("roads/own.yaml")
    ('udacity_lake', 'alpine-17', 'own')
    """
    return short_name(track).replace(":", "-")


def environment_id(name: str) -> str:
    """Return the Gymnasium id of a track's environment.

    >>> environment_id("lake"), environment_id("figure_of_8")
    ('Lake-v0', 'FigureOf8-v0')
    """
    return "".join(word.capitalize() for word in re.findall(r"[A-Za-z0-9]+", name)) + "-v0"
