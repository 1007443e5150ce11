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

from benchmarks.measuring import make_console, print_table
from zoo.base.command_keys import read_options
from zoo.search.failure_map import Archive
from zoo.search.search_options import SearchOptions
from zoo.search.search_run import BATCH, make_sampler
from zoo.search.search_space import Candidate, SearchSpace

SAMPLERS = "archive,tpe,random,family"
EDGES = (0.9, 1.3, 1.7)  # of the rule: more than half of random roads fail, some, few


def difficulty(space: SearchSpace, road: Candidate) -> float:
    """Return how difficult a road and its day are by a rule: sharp bends, narrow roads, fog."""
    share = {
        key: feature.scale.share(road.features[key]) for key, feature in space.features.items()
    }
    hard = 0.9 * (1 - share["bend"]) + 0.3 * (1 - share["width"]) + 0.2 * share["grade"]
    day = 0.5 * share["fog"] + 0.4 * share["rain"] + 0.8 * abs(share["brightness"] - 0.5)
    return hard + day + 0.1 * (1 - share["sun"])


def failed_cells_by_rule(options: SearchOptions, edge: float) -> int:
    """Return the number of failing cells of a search whose failures follow the rule."""
    space = options.space()
    archive = Archive(options.grid(space))
    sampler = make_sampler(options, space, archive)
    for _ in range(0, options.budget, BATCH):
        roads = sampler.propose(BATCH)
        values = [difficulty(space, road) / edge for road in roads]
        for road, value in zip(roads, values, strict=True):
            archive.add(road.features, value > 1)
        sampler.learn([min(value, 1.0) for value in values])
    return len(archive.failed)


def by_rule(sampler: str, keys: list[str]) -> list[str]:
    """Return the failing cells of a sampler for each edge of the rule, over three seeds."""
    searches = [
        read_options(SearchOptions, [*keys, f"sampler={sampler}", f"seed={seed}"])
        for seed in range(3)
    ]
    counts = [[failed_cells_by_rule(options, edge) for options in searches] for edge in EDGES]
    return [f"{np.mean(cells):.1f} ({min(cells)} to {max(cells)})" for cells in counts]


def by_driving(checkpoint: str, sampler: str, keys: list[str], folder: Path) -> str:
    """Return the failing cells, and the failed drives, of a search."""
    from zoo.search.search_report import RESULT, search_and_report

    own = [*keys, f"sampler={sampler}", f"out={folder}"]
    options, written = read_options(SearchOptions, own), folder / RESULT
    result = json.loads(written.read_text()) if written.is_file() else {"drives": []}
    if len(result["drives"]) < options.budget:
        written.unlink(missing_ok=True)
        result = search_and_report(checkpoint, options, make_console())
    cells = f"{result['cells']['failed']} ({result['failed']})"
    print(checkpoint, sampler, cells, flush=True)
    return cells


def main() -> None:
    """Read the arguments and compare."""
    given = dict(word.partition("=")[::2] for word in sys.argv[1:] if "=" in word)
    checkpoints = [word for word in sys.argv[1:] if "=" not in word]
    samplers = given.pop("samplers", SAMPLERS).split(",")
    out = Path(given.pop("out", "outputs/search_benchmark"))
    keys = [f"{key}={value}" for key, value in given.items()]
    if not checkpoints:
        rows = [[sampler, *by_rule(sampler, keys)] for sampler in samplers]
        print_table(["sampler", *(f"failure above {edge:g}" for edge in EDGES)], rows)
        return
    rows = [
        [path, *(by_driving(path, name, keys, out / f"{number}-{name}") for name in samplers)]
        for number, path in enumerate(checkpoints, start=1)
    ]
    print("cells with a failure (drives that failed)")
    print_table(["checkpoint", *samplers], rows)


if __name__ == "__main__":
    main()
