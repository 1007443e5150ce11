"""The roads of recordings by the embedded simulator, named by what they look like."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from zoo.base.errors import InputError
from zoo.base.new_folder import RECIPE
from zoo.base.plain_files import read_json
from zoo.simulator.road_family import roads_digest
from zoo.simulator.track_names import DRAWN, recorded_name, short_name


def road_key(track: str) -> str:
    """Return the digest of a drawn road, or the name of a track with a file.

    A road has the same digest under each name of its family.

    Raises:
        InputError: there is no such family.
    """
    return roads_digest([track]) if DRAWN.fullmatch(track) else recorded_name(short_name(track))


def recorded_roads(folders: Iterable[str]) -> list[str]:
    """Return the sorted keys of the roads that recordings name, without those that are unknown."""
    return _keys_of({track for folder in folders for track in _tracks_in(Path(folder) / RECIPE)})


def trained_roads(config: Mapping, data: Mapping) -> list[str] | None:
    """Return the keys of a training's roads; None where its file tells nothing of them.

    Args:
        config: config of the training; a stranger's may hold anything.
        data: facts on its recording. Earlier versions did not write the roads.
    """
    section = config.get("data")
    section = section if isinstance(section, Mapping) else {}
    recipe, root = section.get("record"), section.get("root")
    if "roads" in data or not isinstance(recipe, Mapping) or root not in (None, recipe.get("out")):
        return data.get("roads")
    return _keys_of(_recipe_tracks(recipe)) or None


def _keys_of(tracks: Iterable[str]) -> list[str]:
    keys = set()
    for track in tracks:
        try:
            keys.add(road_key(track))
        except InputError:  # the family's file is not on this machine
            continue
    return sorted(keys)


def _tracks_in(path: Path) -> set[str]:
    """Return the tracks in a recording's recipe; none without one that can be read."""
    try:
        return _recipe_tracks(read_json(path))
    except InputError:
        return set()


def _recipe_tracks(recipe: object) -> set[str]:
    passes = recipe.get("passes") if isinstance(recipe, dict) else None
    drives = passes if isinstance(passes, list) else []
    return {str(drive["track"]) for drive in drives if isinstance(drive, dict) and "track" in drive}
