"""Draw `docs/architecture.png` from the imports: `python docs/draw_architecture.py`.

A row is a room; the numbers in it count its imports of the rooms that name the columns. A room
imports only rooms that stand above it: all numbers stand below the diagonal.
"""

from collections import Counter
from pathlib import Path

import grimp  # of import-linter
import matplotlib.pyplot as plt
import tomllib  # of Python 3.11

ROOT = Path(__file__).parents[1]
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
    "contracts"
]
(LAYERS,) = [contract["layers"] for contract in CONTRACTS if contract["type"] == "layers"]
# The base room, which all import; the package that imports no other room; the rooms above.
BASE, *ROOMS = [
    f"zoo.{room}" for layer in reversed(LAYERS) for room in reversed(layer.split(" : "))
]
ORDER = [BASE, "datamodules", *ROOMS]


def room_of(module: str) -> str:
    """Return the room that a module is in.

    >>> room_of("zoo.driving.intervals"), room_of("zoo.commands.film"), room_of("datamodules.view")
    ('zoo.driving', 'zoo.commands', 'datamodules')
    """
    first, _, rest = module.partition(".")
    inner = f"{first}.{rest.split('.')[0]}"
    return inner if inner in ORDER else first


def count_imports() -> Counter[tuple[str, str]]:
    """Return the number of imports between two rooms; zoo's `__init__` imports for all."""
    graph, arrows = grimp.build_graph("zoo", "datamodules"), Counter()
    for module in graph.modules - {"zoo"}:
        for imported in graph.find_modules_directly_imported_by(module):
            if room_of(module) != room_of(imported):
                arrows[room_of(module), room_of(imported)] += 1
    return arrows


def draw(target: Path) -> None:
    """Write the matrix of imports, rooms in their order on both sides."""
    size = len(ORDER)
    figure, axes = plt.subplots(figsize=(11, 8))
    for (importer, imported), count in count_imports().items():
        row, column = ORDER.index(importer), ORDER.index(imported)
        colour = "#3b6ea5" if column < row else "#cc0000"  # red: against the layers
        shade = min(1, 0.2 + count / 40)
        axes.add_patch(plt.Rectangle((column, row), 1, 1, color=colour, alpha=shade))
        text = "white" if shade > 0.6 else "black"
        axes.text(column + 0.5, row + 0.5, count, ha="center", va="center", fontsize=9, color=text)
    for place in range(size):
        axes.add_patch(plt.Rectangle((place, place), 1, 1, color="#dddddd"))
    names = [room.replace(".", "/") for room in ORDER]
    axes.set_yticks([place + 0.5 for place in range(size)], names)
    axes.set_xticks([place + 0.5 for place in range(size)], names, rotation=60, ha="left")
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.set_xlim(0, size)
    axes.set_ylim(size, 0)
    axes.grid(False)
    axes.set_aspect("equal")
    for side in axes.spines.values():
        side.set_color("#bbbbbb")
    figure.tight_layout()
    figure.savefig(target, dpi=110)


if __name__ == "__main__":
    draw(Path(__file__).with_name("architecture.png"))
