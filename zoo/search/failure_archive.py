"""The map of a search: cells over two features, which were driven and in which a drive failed."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from zoo.search.search_space import Feature

Cell = tuple[int, int]


@dataclass(frozen=True)
class Grid:
    """A grid of cells over two features.

    Attributes:
        x, y: names of the features.
        scales: the two features' ranges, by their names.
        cells: number of cells along each feature; the outer cells have what lies beyond the range.
    """

    x: str
    y: str
    scales: Mapping[str, Feature]
    cells: int

    def cell(self, features: Mapping[str, float]) -> Cell:
        """Return the cell that a road's features lie in."""
        column, row = (
            min(int(self.scales[name].scale.share(features[name]) * self.cells), self.cells - 1)
            for name in (self.x, self.y)
        )
        return column, row

    def edges(self, name: str) -> np.ndarray:
        """Return the borders between a feature's cells, float64 [cells + 1]."""
        scale = self.scales[name].scale
        return np.array([scale.at(number / self.cells) for number in range(self.cells + 1)])


@dataclass
class Archive:
    """Counts of drives and failures in each cell of a grid."""

    grid: Grid
    driven: Counter[Cell] = field(default_factory=Counter)
    failed: Counter[Cell] = field(default_factory=Counter)

    def add(self, features: Mapping[str, float], failed: bool) -> None:
        """Count a drive."""
        cell = self.grid.cell(features)
        self.driven[cell] += 1
        if failed:
            self.failed[cell] += 1
