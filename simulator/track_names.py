"""Names of the included tracks (`conf/track/<name>.yaml`) and their Gymnasium ids."""

import re
from pathlib import Path


def track_folder() -> Path:
    """Return the folder of the included tracks, in the installation or in the checkout."""
    installed = Path(__file__).parent / "track"
    return installed if installed.is_dir() else Path(__file__).parents[1] / "conf" / "track"


def track_names() -> list[str]:
    """Return the names of the included tracks, sorted."""
    return sorted(path.stem for path in track_folder().glob("*.yaml"))


def environment_id(name: str) -> str:
    """Return the Gymnasium id of a track's environment.

    >>> environment_id("lake"), environment_id("figure_of_8")
    ('Lake-v0', 'FigureOf8-v0')
    """
    return "".join(word.capitalize() for word in re.findall(r"[A-Za-z0-9]+", name)) + "-v0"
