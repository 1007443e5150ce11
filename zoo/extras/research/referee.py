"""The result of comparing policies by their rollouts: its tables, its lines, and its file."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from matplotlib.figure import Figure
from rich.box import SIMPLE_HEAD
from rich.console import Console

from zoo.base.errors import InputError
from zoo.base.terminal import counted, print_line, print_written, printable
from zoo.base.whole_file import json_text, write_output
from zoo.driving.clustered import EQUAL, SHARE, SMALLEST
from zoo.driving.intervals import FEWEST_ROADS, Estimate
from zoo.extras.research.rollout_differences import (
    NEW,
    SCOPES,
    THESE,
    UNDECIDED,
    UNKNOWN,
    Difference,
    compare_policies,
    is_thin,
    limits_of,
    mean_score,
)
from zoo.extras.research.rollouts import Rollout, Wanted, read_policies
from zoo.runs.plots import interval_plot
from zoo.runs.result_table import Cell, Column, Table, interval_column, number_column
from zoo.runs.table_files import Result

VERSION = 1  # of the JSON file
INTERVALS = (
    "95 % interval, for new rollouts in these scenes or for new scenes like them; with several "
    "trainings of a policy, for new trainings, too. p: corrected for the number of pairs (Holm)."
)
COLUMNS = ("pair", "scope", "difference", "p", "verdict", "needed")
UNTOLD = ("scene", "training")  # fields that a file may lack
WAYS = {
    "rollouts": "{} rollouts in each scene",
    "scenes": "{} scenes",
    "trainings": "{} trainings of each",
}


@dataclass(frozen=True, repr=False)
class Referee(Result):
    """Policies and the difference of each pair.

    Attributes:
        policies: rollouts by the name of the policy.
        differences: differences on these scenes, then those on new ones.
        notes: what the files do not tell, and what that costs.
        score: name of the compared score.
        written: paths of the files written.
    """

    policies: Mapping[str, list[Rollout]]
    differences: list[Difference]
    notes: list[str]
    score: str
    written: list[Path] = field(default_factory=list)

    @classmethod
    def read(
        cls,
        paths: Sequence[Path],
        names: Sequence[str],
        wanted: Wanted,
        same_seeds: bool,
        paired: bool,
    ) -> "Referee":
        """Compare the policies of some files; see `rollout_compare.compare`.

        Raises:
            InputError: see `read_policies`, or paired trainings share no seed.
            UsageError: see `read_policies`.
        """
        policies, notes = read_policies(paths, names, wanted)
        if same_seeds:
            policies = {name: _numbered(rollouts) for name, rollouts in policies.items()}
        whole, before = policies, None
        while policies != before:  # without some trainings, policies may share fewer scenes
            before, policies = policies, _shared(policies, "scene", notes)
            policies = _shared(policies, "training", notes) if paired else policies
        policies = _weighted(policies)
        for name in ("scene", "training") if paired else ("scene",):
            every, kept = (set[str]().union(*_values(side, name)) for side in (whole, policies))
            if others := every - kept:
                notes.append(f"{counted(len(others), name)} left out, which not every policy has")
        notes = [*dict.fromkeys(notes), *_untold(policies)]
        scores = {row.score for rollouts in policies.values() for row in rollouts}
        score = wanted.score or ("success" if scores <= {0, 1} else "score")
        return cls(policies, compare_policies(policies, paired), notes, score)

    @property
    def lines(self) -> list[str]:
        """Return a verdict for each pair, then what the files do not tell."""
        half = len(self.differences) // 2
        lines = []
        for these, new in zip(self.differences[:half], self.differences[half:], strict=True):
            too = f", and on {NEW}" if these.verdict == new.verdict else ""
            lines.append(f"verdict: {these.a}, {these.b}: {these.verdict} on {THESE}{too}")
            if not too:
                lines.append(f"on {NEW}: {new.verdict}")
            lines += [
                f"to tell on {row.scope}: {text}"
                for row in (these, new)
                if (text := needed_text(row))
            ]
        return [*lines, *self.notes]

    def __repr__(self) -> str:
        names = ", ".join(self.policies)
        return "\n".join([f"Referee of {names}", *(f"  {line}" for line in self.lines)])

    def show(self) -> None:
        """Print the policies, the difference of each pair, and the verdicts."""
        console = Console(emoji=False, soft_wrap=True)
        pairs = self.result_table().chosen(",".join(COLUMNS[:-1]))  # the lines have the last one
        for table, caption in ((self.policy_table(), None), (pairs, INTERVALS)):
            shown = table.narrow().printed(
                left=1, box=SIMPLE_HEAD, show_edge=False, caption=caption, caption_justify="left"
            )
            console.print(shown)
        for line in self.lines:
            print_line(console, printable(line))
        print_written(self.written, console=console)

    def policy_table(self) -> Table:
        """Return a row for each policy: what was counted, and its mean score."""
        rows = list(self.policies.values())
        counts: dict[str, list[Cell]] = {
            "rollouts": [len(rollouts) for rollouts in rows],
            **{f"{name}s": [len(_known(r, name)) or None for r in rows] for name in UNTOLD},
        }
        limits = limits_of(rows)
        figures = {scope: [mean_score(each, scope, limits) for each in rows] for scope in SCOPES}
        return Table(
            [
                Column("policy", "policy", list(map(printable, self.policies))),
                *(number_column(name, name, numbers) for name, numbers in counts.items()),
                *(
                    self._column(f"{self.score}\n{scope}", found)
                    for scope, found in figures.items()
                ),
            ]
        )

    def result_table(self) -> Table:
        """Return a row for each pair and scope; differences are the first minus the second."""
        rows = self.differences
        needed = {f"needed_{way}": [row.needed.get(way) for row in rows] for way in WAYS}
        return Table(
            [
                Column("pair", "pair", [printable(f"{row.a} - {row.b}") for row in rows]),
                Column("scope", "on", [row.scope for row in rows]),
                self._column("difference", [row.figure for row in rows]),
                number_column("p", "p", [row.p for row in rows], "{:.3f}"),
                Column("verdict", "verdict", [printable(row.verdict) for row in rows]),
                Column("needed", "to tell", [needed_text(row) for row in rows], needed),
            ],
            INTERVALS,
        )

    def plot(self) -> Figure:
        """Return the difference of each pair with its 95 % interval."""
        figures = {f"{row.a} - {row.b}, {row.scope}": row.figure for row in self.differences}
        factor = 100 if self._is_share else 1
        return interval_plot(figures, f"difference in {self.score}", 0.0, factor)

    def write(self, path: Path) -> Path:
        """Write all figures as JSON; return the path.

        Raises:
            InputError: see `write_output`.
        """
        rows = {name: [asdict(row) for row in rollouts] for name, rollouts in self.policies.items()}
        written = {"version": VERSION, "score": self.score, "notes": self.notes, "rollouts": rows}
        written["differences"] = [
            {**asdict(row), "verdict": row.verdict} for row in self.differences
        ]
        return write_output(path, json_text(written))

    @property
    def _is_share(self) -> bool:
        return limits_of(self.policies.values()) == SHARE

    def _column(self, heading: str, figures: Sequence[Estimate]) -> Column:
        form, factor = ("{:.1f}", 100) if self._is_share else ("{:.4g}", 1)
        percent = ", points" if heading == "difference" else ", %"
        unit = percent if self._is_share else ""
        return interval_column(heading.split("\n")[0], heading + unit, figures, form, factor)


def needed_text(row: Difference) -> str:
    """Return what would tell two policies apart; empty if they are, or nothing is known.

    >>> needed = {"rollouts": None, "scenes": 24}
    >>> needed_text(Difference("a", "b", NEW, Estimate(0.1, 0, 0.2), 1, needed))
    'about 24 scenes; not by more rollouts alone'
    """
    if row.verdict not in (UNKNOWN, UNDECIDED):
        return ""
    if abs(row.figure.value) <= EQUAL:
        return "both have the same score"
    if row.verdict == UNKNOWN:
        what = "scenes" if row.scope == NEW else "rollouts"
        # A p-value below 1 has three or more of them, whose differences are all the same.
        return f"{what} that vary" if row.p < 1 else f"three or more {what}, to estimate how many"
    if not row.needed:
        return f"{SMALLEST} or more rollouts in each scene, to estimate how many"
    enough = [WAYS[way].format(count) for way, count in row.needed.items() if count]
    alone = [way for way, count in row.needed.items() if not count]
    texts = [f"about {' or '.join(enough)}"] if enough else []
    return "; ".join(texts + [f"not by more {' or '.join(alone)} alone"] * bool(alone))


def _known(rollouts: Sequence[Rollout], name: str) -> set[str]:
    """Return the values of a field that are known."""
    return {getattr(row, name) for row in rollouts} - {""}


def _numbered(rollouts: Sequence[Rollout]) -> list[Rollout]:
    """Return rollouts with their number in scene and training where they have no seed."""
    counts: Counter[tuple[str, str]] = Counter()
    numbered = []
    for row in rollouts:
        key = row.scene, row.training
        numbered.append(row if row.seed else replace(row, seed=f"number {counts[key]}"))
        counts[key] += 1
    return numbered


def _weighted(policies: Mapping[str, list[Rollout]]) -> dict[str, list[Rollout]]:
    """Return rollouts with weights by which a scene counts alike in each policy's mean."""
    own = Counter((name, row.scene) for name, rows in policies.items() for row in rows)
    every = Counter(row.scene for rows in policies.values() for row in rows)
    return {
        name: [replace(r, weight=every[r.scene] / own[name, r.scene] / len(policies)) for r in rows]
        for name, rows in policies.items()
    }


def _values(policies: Mapping[str, list[Rollout]], name: str) -> list[set[str]]:
    return [{getattr(row, name) for row in rollouts} for rollouts in policies.values()]


def _shared(
    policies: dict[str, list[Rollout]], name: str, notes: list[str]
) -> dict[str, list[Rollout]]:
    """Return the rollouts whose scene or training all policies have; note if they share none."""
    shared = set.intersection(*_values(policies, name)) - ({""} if name == "training" else set())
    if name == "training" and not shared:
        raise InputError("paired=true: the policies share no training seed; leave it out")
    if not shared:
        notes.append("scenes: the policies share none, so they are samples of different scenes")
        return policies
    return {
        policy: [row for row in rollouts if getattr(row, name) in shared]
        for policy, rollouts in policies.items()
    }


def _untold(policies: Mapping[str, Sequence[Rollout]]) -> list[str]:
    """Return what the files do not tell, and what that costs."""
    notes, scenes = [], min(len(_known(rollouts, "scene")) for rollouts in policies.values())
    if scenes < FEWEST_ROADS:
        number = counted(scenes, "scene") if scenes else "none is named"
        notes.append(f"scenes: {number}: whether the difference survives new ones is unknown")
    if is_thin(*policies.values()):
        notes.append(
            f"rollouts: fewer than {SMALLEST} in a scene: the interval on {THESE} is that on {NEW}"
        )
    unseeded = [name for name, rollouts in policies.items() if not _known(rollouts, "seed")]
    if unseeded and not is_thin(*policies.values()):
        notes.append(
            f"seeds: none in {', '.join(unseeded)}: rollouts are not paired, which takes more of "
            "them; same_seeds=true pairs them by number, if all evaluations began with one seed"
        )
    seeds = [{(row.scene, row.seed) for row in rollouts} for rollouts in policies.values()]
    if not (unseeded or is_thin(*policies.values()) or set.intersection(*seeds)):
        notes.append("seeds: the policies share none in a scene: rollouts are not paired")
    single = [name for name, rollouts in policies.items() if len(_known(rollouts, "training")) < 2]
    if single:
        notes.append(
            f"trainings: one, or not named, of {', '.join(single)}: the verdict is about these "
            "weights; a second training of each may turn it"
        )
    return notes
