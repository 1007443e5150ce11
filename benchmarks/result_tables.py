"""The tables of `docs/results.csv`: every recipe, and those of one network."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.marked_page import markdown_table, write_between
from zoo.drives.intervals import count_with_interval

FULL = Path("docs/recipes.md")
NETWORK_PAGES = Path("docs/models")
BEGIN, END = "<!-- results -->", "<!-- end of results -->"
TRACKS = ("lake", "mountain")
CLEAN = "drives without intervention (95 %)"


@dataclass(frozen=True)
class Trained:
    """The runs of one recipe, a training seed each.

    Attributes:
        model: name of the network.
        setting: name of the recipe.
        runs: lines of `docs/results.csv`, with numbers as numbers.
    """

    model: str
    setting: str
    runs: tuple[dict, ...]

    def mean(self, key: str) -> float:
        """Return the mean over the training seeds."""
        return float(np.mean([run[key] for run in self.runs]))

    def autonomy(self, track: str) -> str:
        """Return the mean autonomy on a track and, in brackets, the worst."""
        values = [run[f"{track}_autonomy"] for run in self.runs]
        return f"{np.mean(values):.1%} ({min(values):.1%})"

    def clean_drives(self, track: str) -> str:
        """Return the number of drives without an intervention, with its 95 % interval."""
        clean = sum(run[f"{track}_interventions"] == 0 for run in self.runs)
        return count_with_interval(clean, len(self.runs)).replace("95 %: ", "")


def table_groups(rows: Iterable[dict]) -> list[Trained]:
    """Return the recipes of the table in the order of the file; those never driven are left out."""
    groups: dict[tuple[str, str], list[dict]] = {}
    for row in rows:
        if int(row["in_table"]) and row["lake_autonomy"] != "":
            groups.setdefault((row["model"], row["setting"]), []).append(row)
    return [Trained(*names, tuple(runs)) for names, runs in groups.items()]


def full_table(groups: list[Trained]) -> str:
    """Return a line for each recipe: means over its training seeds, and the worst of them."""
    head = ["model", "setting", "parameters", "training seeds", "training", "test MSE (zero)"]
    head += ["lake: autonomy (worst)", "mean, max error, m", "mountain: autonomy (worst)"]
    head += ["latency, ms"]
    rows = [
        [
            group.model,
            group.setting,
            _parameters(group),
            str(len(group.runs)),
            _duration(group.mean("train_s")),
            f"{group.mean('test_mse'):.4f} ({group.mean('test_zero_mse'):.4f})",
            group.autonomy("lake"),
            _error(group),
            group.autonomy("mountain"),
            f"{group.mean('lake_latency_ms'):.1f}",
        ]
        for group in groups
    ]
    return markdown_table(head, rows, left=2)


def network_table(groups: list[Trained]) -> str:
    """Return a line for each recipe of one network, and below the commands that train them."""
    head = ["recipe", "parameters", "lake: autonomy (worst)", CLEAN, "mean, max error, m"]
    head += ["mountain: autonomy (worst)", CLEAN]
    rows = [
        [group.setting, _parameters(group), *_driven(group)[:2], _error(group), *_driven(group)[2:]]
        for group in groups
    ]
    commands = "\n".join(
        f"# {group.setting}\n{group.runs[0]['command'].removesuffix(' seed=1')}" for group in groups
    )
    return f"{markdown_table(head, rows)}\n\n```bash\n{commands}\n```"


def _driven(group: Trained) -> list[str]:
    return [cell for track in TRACKS for cell in (group.autonomy(track), group.clean_drives(track))]


def _parameters(group: Trained) -> str:
    return f"{int(group.runs[0]['parameters']):,}"


def _error(group: Trained) -> str:
    farthest = max(run["lake_cte_max_m"] for run in group.runs)
    return f"{group.mean('lake_cte_mean_m'):.2f}, {farthest:.2f}"


def _duration(seconds: float) -> str:
    if not seconds:  # a run that was interrupted and resumed after its last epoch
        return "-"
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def write_tables(rows: list[dict]) -> list[Path]:
    """Write the tables into their pages; return the pages.

    A network's page has a line `<!-- results of NAME -->` where its table belongs.
    """
    groups = table_groups(rows)
    tables = [(FULL, BEGIN, full_table(groups))]
    for model in dict.fromkeys(group.model for group in groups):
        mark = f"<!-- results of {model} -->"
        own = network_table([group for group in groups if group.model == model])
        pages = sorted(NETWORK_PAGES.glob("*.md"))
        tables += [(page, mark, own) for page in pages if mark in page.read_text()]
    for page, mark, table in tables:
        write_between(page, mark, END, table)
    return list(dict.fromkeys(page for page, *_ in tables))
