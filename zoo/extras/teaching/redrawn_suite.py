"""A suite on other roads of the same families, which nobody has seen."""

from pathlib import Path

from zoo.base.file_text import yaml_text
from zoo.base.limits import check_most
from zoo.results.suite import read_suite_file, road_numbers, suite_path
from zoo.runs.record_fields import check_fields
from zoo.simulator.track_names import DRAWN


def redraw_suite(name: str, seed: int | None, roads: int) -> str:
    """Return the YAML of a suite on other roads of the same families.

    Args:
        name: name or path of the suite.
        seed: number that draws the roads; None keeps those of the suite.
        roads: roads in place of each one.

    Raises:
        UsageError: there is no such suite.
        InputError: the file cannot be read, a key or value is wrong, or the roads are too many.
    """
    file = read_suite_file(suite_path(name))
    content = file.model_dump(exclude_unset=True)
    if seed is not None:
        content["name"] += "-drawn"  # included suites have fixed roads
        content |= {"seed": seed, "roads": roads * file.roads} if file.axes else {}
        content["groups"] = {
            group: [
                drive | {"track": track}
                for drive in drives
                for track in redrawn(drive["track"], seed, roads)
            ]
            for group, drives in content.get("groups", {}).items()
        }
    drawn = check_fields(type(file), content, f"roads={roads}: name fewer for suite={name}")
    drives = len(drawn.dev) + len(drawn.laps) + sum(map(len, drawn.groups.values()))
    drives += drawn.roads * sum(map(len, drawn.axes.values()))
    check_most("drives", drives, f"roads={roads}: suite={name}", "name fewer roads")
    return yaml_text(content)


def redrawn(track: str, seed: int, roads: int) -> list[str]:
    """Return roads of the same family; a track with a file is kept."""
    if not (drawn := DRAWN.fullmatch(track)):
        return [track]
    name = f"{Path(drawn[1]).stem}:{drawn[2]}"  # the same roads wherever a family's file lies
    return [f"{drawn[1]}:{number}" for number in road_numbers(f"{seed} {name}", roads)]
