"""Names of the included tracks (`conf/track/<name>.yaml`) and their Gymnasium ids."""

import re
from pathlib import Path


def track_folder() -> Path:
    """Return the folder of the included tracks, in the installation or in the checkout."""
    return _conf_folder("track")


def road_folder() -> Path:
    """Return the folder of the included families of roads."""
    return _conf_folder("road")


def _conf_folder(name: str) -> Path:
    installed = Path(__file__).parent / name
    return installed if installed.is_dir() else Path(__file__).parents[1] / "conf" / name


def track_names() -> list[str]:
    """Return the names of the included tracks, sorted."""
    return sorted(path.stem for path in track_folder().glob("*.yaml"))


def environment_id(name: str) -> str:
    """Return the Gymnasium id of a track's environment.

    >>> environment_id("lake"), environment_id("figure_of_8")
    ('Lake-v0', 'FigureOf8-v0')
    """
    return "".join(word.capitalize() for word in re.findall(r"[A-Za-z0-9]+", name)) + "-v0"
