"""Open-loop figures: how near the predicted steering is to the recorded one.

They do not say whether the car stays on the road; they say what a recording can.
"""

import numpy as np
import torch

from datamodules.batches import EvaluationBatches

# 21 bins of 0.1, the middle one around straight ahead.
BIN_EDGES = np.linspace(-1.05, 1.05, 22)


def open_loop_metrics(predicted: np.ndarray, true: np.ndarray) -> dict[str, float]:
    """Figures of steering, both float [N] in -1..1.

    `mse` and `mae` as usual; `balanced_mae` is the mean over steering bins of each bin's MAE, so
    that a log that goes straight 72 % of the time cannot be answered by going straight; `bias` is
    the mean of predicted less true, positive to the right.
    """
    error = np.asarray(predicted, np.float64) - np.asarray(true, np.float64)
    bins = np.digitize(true, BIN_EDGES)
    return {
        "mse": float(np.square(error).mean()),
        "mae": float(np.abs(error).mean()),
        "balanced_mae": float(np.mean([np.abs(error[bins == b]).mean() for b in np.unique(bins)])),
        "bias": float(error.mean()),
    }


def baseline_metrics(true: np.ndarray, train_mean: float) -> dict[str, dict[str, float]]:
    """What two networks that look at nothing would get: always zero, always the training mean."""
    return {
        "always zero": open_loop_metrics(np.zeros_like(true), true),
        "mean": open_loop_metrics(np.full_like(true, train_mean), true),
    }


def side_response(left: np.ndarray, right: np.ndarray) -> float | None:
    """How hard a network turns back: half of what the left camera's pictures make it steer more
    than the right one's, -1..1 (the cameras stand 0.8 m aside); None without such pictures.

    It needs no label. Of all figures that need no drive it was the best guide to who drives well
    (`docs/offline_metrics.md`).
    """
    return float((left - right).mean() / 2) if len(left) else None


@torch.inference_mode()
def predict_steering(module: torch.nn.Module, batches: EvaluationBatches) -> np.ndarray:
    """The steering (float32 [N]) that a `SteeringModule` gives for rows, on its own device."""
    module.eval()
    steering: list[float] = []  # small arrays, kept between batches, would break up the heap
    for batch in batches:
        batch = {name: tensor.to(module.device) for name, tensor in batch.items()}
        steering += module(batch)[:, 0].float().tolist()
    return np.array(steering, np.float32)
