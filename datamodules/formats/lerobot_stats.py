"""Statistics of a dataset's features, which LeRobot normalizes by."""

from dataclasses import dataclass, field

import numpy as np

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
SAMPLED_FRAMES, SAMPLED_PIXELS = 10, 2  # every tenth frame, every second row and column


def column_stats(values: np.ndarray) -> dict[str, list]:
    """Return a feature's statistics, float [N] or [N, D], as lists of D numbers."""
    table = values.reshape(len(values), -1).astype(float)
    found = {
        "min": table.min(0),
        "max": table.max(0),
        "mean": table.mean(0),
        "std": table.std(0),
        **{name: np.quantile(table, share, axis=0) for name, share in QUANTILES.items()},
    }
    return {name: one.tolist() for name, one in found.items()} | {"count": [len(table)]}


@dataclass
class FrameCounts:
    """Counts of the pixels of a camera's sampled frames: int64 [3, 256], RGB."""

    counts: np.ndarray = field(default_factory=lambda: np.zeros((3, 256), np.int64))
    frames: int = 0

    def add(self, frame: np.ndarray) -> None:
        """Count a frame's pixels, uint8 [H, W, 3]."""
        pixels = frame[::SAMPLED_PIXELS, ::SAMPLED_PIXELS]
        for channel in range(3):
            self.counts[channel] += np.bincount(pixels[..., channel].ravel(), minlength=256)
        self.frames += 1

    def __add__(self, other: "FrameCounts") -> "FrameCounts":
        return FrameCounts(self.counts + other.counts, self.frames + other.frames)

    def stats(self) -> dict[str, list]:
        """Return the statistics of pixels in 0..1, as [3][1][1], as LeRobot shapes them."""
        levels = np.arange(256) / 255
        total = self.counts.sum(1)
        mean = self.counts @ levels / total
        reached = self.counts.cumsum(1)
        found = {
            "min": levels[(self.counts > 0).argmax(1)],
            "max": levels[255 - (self.counts[:, ::-1] > 0).argmax(1)],
            "mean": mean,
            "std": np.sqrt(np.maximum(self.counts @ levels**2 / total - mean**2, 0)),
        }
        for name, share in QUANTILES.items():
            found[name] = levels[(reached >= share * total[:, None]).argmax(1)]
        shaped = {name: one.reshape(3, 1, 1).tolist() for name, one in found.items()}
        return shaped | {"count": [self.frames]}
