"""The roads of recordings by the embedded simulator, named by what they look like."""

from collections.abc import Iterable
from pathlib import Path

from simulator.road_family import roads_digest
from simulator.track_names import DRAWN, recorded_name, short_name
from zoo.base.bounded_files import read_json
from zoo.base.errors import InputError
from zoo.base.new_folder import RECIPE


def road_key(track: str) -> str:
    """Return the digest of a drawn road, or the name of a track with a file.

    A road has the same digest under each name of its family.

    Raises:
        InputError: there is no such family.
    """
    return roads_digest([track]) if DRAWN.fullmatch(track) else recorded_name(short_name(track))


def recorded_roads(folders: Iterable[str]) -> list[str]:
    """Return the sorted keys of the roads that recordings name, without those that are unknown."""
    tracks = {track for folder in folders for track in _recipe_tracks(Path(folder) / RECIPE)}
    found = set()
    for track in tracks:
        try:
            found.add(road_key(track))
        except InputError:  # the family's file is not on this machine
            continue
    return sorted(found)


def _recipe_tracks(path: Path) -> set[str]:
    """Return the tracks in a recording's recipe; none without one that can be read."""
    try:
        recipe = read_json(path)
    except InputError:
        return set()
    passes = recipe.get("passes") if isinstance(recipe, dict) else None
    known = passes if isinstance(passes, list) else []
    return {str(one["track"]) for one in known if isinstance(one, dict) and "track" in one}
