"""Compare a search's samplers: `python benchmarks/search.py CKPT... budget=200`.

Each sampler searches each checkpoint with the same budget; the figure is the number of distinct
cells of the map in which a drive failed. Without a checkpoint, failures follow a fixed rule of the
features and parameters instead of drives, which takes minutes. Further keys are those of
`drivezoo search`, such as `speed=30 length=100`; `samplers=archive,random` compares only
these. A finished search below `out` is read, not repeated.
"""

import json
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from zoo.cli.command_config import read_options
from zoo.search.failure_archive import Archive
from zoo.search.first_failure import BATCH
from zoo.search.search_options import SearchOptions
from zoo.search.search_run import make_sampler
from zoo.search.search_space import Candidate, SearchSpace

SAMPLERS = ("archive", "tpe", "random", "family")
RULE_SEEDS = 3
EDGES = (0.9, 1.3, 1.7)  # of the rule: more than half of random roads fail, some, few
console = Console(width=100)


def difficulty(space: SearchSpace, one: Candidate) -> float:
    """Return how difficult a road and its day are by a rule: sharp bends, narrow roads, fog."""
    share = {key: feature.scale.share(one.features[key]) for key, feature in space.features.items()}
    road = 0.9 * (1 - share["bend"]) + 0.3 * (1 - share["width"]) + 0.2 * share["grade"]
    day = 0.5 * share["fog"] + 0.4 * share["rain"] + 0.8 * abs(share["brightness"] - 0.5)
    return road + day + 0.1 * (1 - share["sun"])


def failed_cells_by_rule(options: SearchOptions, edge: float) -> int:
    """Return the number of failing cells of a search whose failures follow the rule."""
    space = options.space()
    archive = Archive(options.grid(space))
    sampler = make_sampler(options, space, archive)
    for _ in range(0, options.budget, BATCH):
        chosen = sampler.propose(BATCH)
        values = [difficulty(space, one) / edge for one in chosen]
        for one, value in zip(chosen, values, strict=True):
            archive.add(one.features, value > 1)
        sampler.learn([min(value, 1.0) for value in values])
    return len(archive.failed)


def compare_by_rule(samplers: list[str], keys: list[str]) -> None:
    """Print the failing cells of each sampler for each edge of the rule and each seed."""
    table = Table("sampler", *(f"failure above {edge:g}" for edge in EDGES))
    for sampler in samplers:
        cells = []
        for edge in EDGES:
            given = [
                read_options("search", SearchOptions, [*keys, f"sampler={sampler}", f"seed={seed}"])
                for seed in range(RULE_SEEDS)
            ]
            found = [failed_cells_by_rule(one, edge) for one in given]
            cells.append(f"{np.mean(found):.1f} ({min(found)} to {max(found)})")
        console.print(sampler, *cells, sep=" | ")
        table.add_row(sampler, *cells)
    console.print(table)


def compare(checkpoints: list[str], samplers: list[str], keys: list[str], out: Path) -> None:
    """Print the failures and failing cells of each sampler on each checkpoint."""
    from zoo.search.search_report import RESULT, search_and_report

    table = Table("checkpoint", *samplers, title="cells with a failure (drives that failed)")
    for number, checkpoint in enumerate(checkpoints, start=1):
        cells = []
        for sampler in samplers:
            folder = out / f"{number}-{sampler}"
            own = [*keys, f"sampler={sampler}", f"out={folder}"]
            options = read_options("search", SearchOptions, own)
            written = folder / RESULT
            result = json.loads(written.read_text()) if written.is_file() else {"drives": []}
            if len(result["drives"]) < options.budget:
                written.unlink(missing_ok=True)
                result = search_and_report(checkpoint, options, console)
            cells.append(f"{result['cells']['failed']} ({result['failed']})")
            console.print(f"{checkpoint} {sampler}: {cells[-1]}")
        table.add_row(str(number), *cells)
    console.print(table)


def main() -> None:
    """Read the arguments and compare."""
    given = dict(one.partition("=")[::2] for one in sys.argv[1:] if "=" in one)
    checkpoints = [one for one in sys.argv[1:] if "=" not in one]
    samplers = given.pop("samplers", ",".join(SAMPLERS)).split(",")
    out = Path(given.pop("out", "outputs/search_benchmark"))
    keys = [f"{key}={value}" for key, value in given.items()]
    if checkpoints:
        compare(checkpoints, samplers, keys, out)
    else:
        compare_by_rule(samplers, keys)


if __name__ == "__main__":
    main()
