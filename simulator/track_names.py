"""Which tracks come along: `conf/track/<name>.yaml`, and their ids for Gymnasium."""

import re
from pathlib import Path


def track_folder() -> Path:
    """Return the folder of the tracks that come along: of the checkout, or of the installation."""
    installed = Path(__file__).parent / "track"
    return installed if installed.is_dir() else Path(__file__).parents[1] / "conf" / "track"


def track_names() -> list[str]:
    """Return the names of the tracks that come along."""
    return sorted(path.stem for path in track_folder().glob("*.yaml"))


def environment_id(name: str) -> str:
    """Return the id of a track's environment.

    >>> environment_id("lake"), environment_id("figure_of_8")
    ('Lake-v0', 'FigureOf8-v0')
    """
    return "".join(word.capitalize() for word in re.findall(r"[A-Za-z0-9]+", name)) + "-v0"
