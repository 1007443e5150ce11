"""Rollouts of policies that other programs wrote: LeRobot, Bench2Drive, and tables.

A kind of file is an object with `detect` and `read`, named by the entry point `drivezoo.rollouts`.
"""

import csv
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from zoo.base.bounded_files import hash_file, open_text
from zoo.base.entry_points import load_entry, named_entries
from zoo.base.errors import InputError, UsageError, hint
from zoo.base.limits import check_most, is_ordinary
from zoo.base.plain_files import read_json

MOST_CSV_BYTES = 64_000_000
EVAL_INFO, MERGED = "eval_info.json", "merged.json"  # as both programs name their files
SCENES = ("scene", "task", "route", "track", "env")
TRAININGS = ("training_seed", "train_seed", "training")
SCORES = ("success", "score")
LISTS = {"success": "successes", "sum_reward": "sum_rewards", "max_reward": "max_rewards"}
FULL = {"score_penalty": 1}  # most of Bench2Drive's scores that are no percentages
WHOLE = re.compile(r"^(-?\d+)\.0+$")  # as pandas writes a column of numbers that lacks one
WORDS = {"true": 1.0, "yes": 1.0, "false": 0.0, "no": 0.0}


@dataclass(frozen=True)
class Rollout:
    """A rollout of a policy.

    Attributes:
        policy: name of the policy.
        score: its score; 0 or 1 for a success.
        scene: task, route or scene; empty where it is unknown.
        seed: random seed of the rollout; empty where it is unknown.
        training: training seed of the policy; empty where it is unknown.
        weight: what it counts in the policy's mean.
    """

    policy: str
    score: float
    scene: str = ""
    seed: str = ""
    training: str = ""
    weight: float = 1.0


@dataclass(frozen=True)
class Wanted:
    """What a user says about a file.

    Attributes:
        score: name of the score; empty for the file's usual one.
        columns: columns of a table by `policy`, `scene`, `seed` and `training`.
    """

    score: str = ""
    columns: dict[str, str] = field(default_factory=dict)


class Row(dict[str, str]):
    """A row of a CSV file.

    Args:
        line: number of the row's last line in the file.
        cells: names of columns and cells.
    """

    def __init__(self, line: int, cells: Iterable[tuple[str, str]]) -> None:
        super().__init__(cells)
        self.line = line


@runtime_checkable
class RolloutKind(Protocol):
    """A kind of file with rollouts."""

    title: str

    def detect(self, content: Any) -> bool:
        """Return whether a table's rows, or the value of a JSON file, are of this kind."""

    def read(self, content: Any, path: Path, wanted: Wanted) -> tuple[list[Rollout], list[str]]:
        """Return the rollouts, and what else a reader of the figures needs to know."""


class LeRobotKind:
    """`eval_info.json` of `lerobot-eval` from version 0.4 on."""

    title = "LeRobot"

    def detect(self, content: Any) -> bool:
        """Return whether there are metrics of tasks."""
        return isinstance(content, dict) and "per_task" in content

    def read(self, content: Any, path: Path, wanted: Wanted) -> tuple[list[Rollout], list[str]]:
        """Return an episode as a rollout and a task as a scene."""
        rollouts, name = [], wanted.score or "success"
        for task in content["per_task"]:
            scores = {key: task["metrics"][list_key] for key, list_key in LISTS.items()}
            scene = f"{task['task_group']}/{task['task_id']}"
            rollouts += [Rollout("", _number(n, path), scene) for n in _score(scores, name, path)]
        return rollouts, []


class Bench2DriveKind:
    """`merged.json` of Bench2Drive, or the leaderboard's JSON with its records."""

    title = "Bench2Drive"
    routes = 220  # by which its own figures divide, however many were driven

    def detect(self, content: Any) -> bool:
        """Return whether there are records of routes."""
        return isinstance(content, dict) and isinstance(content.get("_checkpoint"), dict)

    def read(self, content: Any, path: Path, wanted: Wanted) -> tuple[list[Rollout], list[str]]:
        """Return a route as a scene; a repetition of it is a further rollout."""
        rollouts, name = [], wanted.score or "success"
        for record in content["_checkpoint"]["records"]:
            broken = (
                key
                for key, events in record["infractions"].items()
                if events and key != "min_speed_infractions"
            )
            done = record["status"] in ("Completed", "Perfect")
            scores = {key: value / FULL.get(key, 100) for key, value in record["scores"].items()}
            # As its tools/merge_route_json.py counts a success.
            scores["success"] = float(done and not any(broken))
            scene = record["route_id"].rpartition("_rep")[0] or record["route_id"]
            rollouts.append(Rollout("", _number(_score(scores, name, path), path), scene))
        if len(rollouts) == self.routes:
            return rollouts, []
        return rollouts, [
            f"{path}: has {len(rollouts)} rollouts; its own driving score and success rate "
            f"divide by {self.routes}, those here by what was driven"
        ]


class TableKind:
    """A CSV file with a row for each rollout."""

    title = "table"

    def detect(self, content: Any) -> bool:
        """Return whether the contents are rows."""
        return isinstance(content, list) and all(isinstance(row, dict) for row in content)

    def read(self, content: Any, path: Path, wanted: Wanted) -> tuple[list[Rollout], list[str]]:
        """Return a row as a rollout."""
        names = [name for name in content[0] if name] if content else []
        usual = {"policy": ("policy",), "scene": SCENES, "seed": ("seed",), "training": TRAININGS}
        columns = {}
        for key, choices in usual.items():
            typed = wanted.columns.get(key)
            if typed is not None and typed not in names:
                raise UsageError(f"{key}={typed}: {path} has no such column; {hint(typed, names)}")
            columns[key] = typed or next((name for name in choices if name in names), None)
        score = wanted.score or next((name for name in SCORES if name in names), "")
        rollouts = []
        for number, row in enumerate(content, 1):
            cells = {key: row[name] if name else None for key, name in columns.items()}
            texts: Any = {key: "" if cell is None else str(cell) for key, cell in cells.items()}
            for key in ("scene", "seed", "training"):
                texts[key] = WHOLE.sub(r"\1", texts[key])
            row_name = f"line {row.line}" if isinstance(row, Row) else f"rollout {number}"
            where = f"{path}: {row_name}"
            if columns["policy"] and not texts["policy"]:
                raise InputError(f"{where}: column {columns['policy']} is empty; name the policy")
            value = _number(_score(row, score, path), where)
            if score == "success" and value not in (0, 1):
                raise InputError(f"{where}: success is {value:g}, not 0 or 1; name it score")
            rollouts.append(Rollout(score=value, **texts))
        return rollouts, []


lerobot, bench2drive, table = LeRobotKind(), Bench2DriveKind(), TableKind()


def rollouts_path(path: Path) -> Path:
    """Return the file of a path, which may be the folder that a program wrote it in."""
    files = (path / name for name in (EVAL_INFO, MERGED))
    return next((file for file in files if file.is_file()), path) if path.is_dir() else path


def read_file(path: Path, wanted: Wanted) -> tuple[list[Rollout], list[str], bool | None]:
    """Return the rollouts of a file, notes, and whether the usual scores are successes.

    That is None for a column `score` of 0 and 1, which may be either.

    Raises:
        InputError: the file cannot be read, is of no known kind, or a value is wrong.
        UsageError: there is no such column or score.
    """
    path = rollouts_path(path)
    if path.is_dir():
        raise InputError(f"{path}: has no {EVAL_INFO} or {MERGED}; name a file of rollouts")
    content: Any = read_json(path) if path.suffix.lower() == ".json" else _rows(path)
    entries = named_entries("drivezoo.rollouts").values()
    kinds: list[RolloutKind] = [load_entry(entry, RolloutKind) for entry in entries]
    kind = next((kind for kind in kinds if kind.detect(content)), None)
    if kind is None:
        titles = ", ".join(sorted(kind.title for kind in kinds))
        raise InputError(f"{path}: is no file of rollouts; known are: {titles}")
    try:
        rollouts, notes = kind.read(content, path, wanted)
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise InputError(
            f"{path}: is not as {kind.title} writes it ({type(error).__name__}: {error})"
        ) from None
    if not rollouts:
        raise InputError(f"{path}: has no rollouts; evaluate the policy again")
    is_won = all(row.score in (0, 1) for row in rollouts)
    is_either = is_won and kind is table and SCORES[0] not in content[0]
    return rollouts, notes, None if is_either else is_won


def read_policies(
    paths: Sequence[Path], names: Sequence[str], wanted: Wanted
) -> tuple[dict[str, list[Rollout]], list[str]]:
    """Return the rollouts of each policy, in the order of the files, and notes.

    Files of one name are trainings of one policy.

    Raises:
        InputError: see `read_file`, a file is there twice, or there are fewer than two policies.
        UsageError: see `read_file`, there is not one name for each file or a file of several
            policies has a name, or one file has successes and another has other scores.
    """
    if names and (len(names) != len(paths) or "" in names):
        raise UsageError(f"names={','.join(names)}: needs a name for each of {len(paths)} files")
    policies: dict[str, list[Rollout]] = {}
    notes: list[str] = []
    successes: dict[bool | None, Path] = {}  # a file for each
    files: set[object] = set()  # of two policies that scored alike, contents may be equal
    for number, path in enumerate(paths):
        rollouts, more, is_won = read_file(path, wanted)
        notes += more
        inside = [*dict.fromkeys(row.policy for row in rollouts)]
        if names and len(inside) > 1:
            raise UsageError(
                f"names={','.join(names)}: {path} has {len(inside)} policies, {inside[0]} first; "
                "leave names= out, or save one policy in each file"
            )
        successes.setdefault(is_won, path)
        for row in rollouts:
            name = names[number] if names else row.policy or str(path)
            training = row.training or (str(path) if names.count(name) > 1 else "")
            policies.setdefault(name, []).append(replace(row, policy=name, training=training))
        same = {(file := rollouts_path(path)).resolve(), (name, hash_file(file))}
        if not files.isdisjoint(same):
            raise InputError(f"{path}: is named twice, or a copy; name each file once")
        files |= same
    if {True, False} <= successes.keys() and not wanted.score:
        raise UsageError(
            f"{successes[True]}: has successes, {successes[False]} other scores; name the score "
            "that all files have with score=NAME"
        )
    if len(policies) < 2:
        raise InputError(
            f"{paths[0]}: one policy alone; name a second file, or the column with the policies' "
            "names: policy=COLUMN"
        )
    return policies, notes


def _rows(path: Path) -> list[Row]:
    with open_text(path, MOST_CSV_BYTES) as file:
        try:
            first = next((line for line in file if line.strip()), "")
            file.seek(0)
            # Of a single column, the comma.
            reader = csv.reader(file, delimiter=max(",;\t", key=first.count), skipinitialspace=True)
            stripped = ([cell.strip() for cell in cells] for cells in reader)
            names, rows = next(filter(any, stripped), []), []
            for number, name in enumerate(names):
                if name and name in names[:number]:
                    raise InputError(f"{path}: has the column {name} twice; rename or delete one")
            for cells in filter(any, stripped):
                if any(cells[len(names) :]):  # such as what follows a decimal comma
                    where = f"{path}: line {reader.line_num}"
                    raise InputError(f"{where}: has more cells than the header; write 0.5, not 0,5")
                rows.append(Row(reader.line_num, zip_longest(names, cells, fillvalue="")))
        except (csv.Error, UnicodeDecodeError) as error:
            raise InputError(f"{path}: is no CSV in UTF-8 ({error}); save it again") from None
    check_most("rows", len(rows), path, "compare fewer rollouts")
    return rows


def _score(scores: Any, name: str, path: Path) -> Any:
    if not name:
        raise UsageError(f"{path}: has no column success or score; name another with score=COLUMN")
    if name not in scores:
        raise UsageError(f"score={name}: {path} has no such score; {hint(name, list(scores))}")
    return scores[name]


def _number(value: Any, where: object) -> float:
    """Return a score as a number; a word such as true counts as 1."""
    try:
        number = float(WORDS.get(str(value).strip().lower(), value))
    except (TypeError, ValueError):
        number = math.nan
    if not is_ordinary(number):
        raise InputError(f"{where}: {str(value)!a:.40} is no score; write 0, 1 or 0.5")
    return number
