"""Open-loop figures: the difference between predicted and recorded steering.

They do not show whether the car stays on the road.
"""

import lightning
import numpy as np
import torch

from datamodules.batches import EvaluationBatches

# 21 bins of 0.1, the middle one around straight ahead.
BIN_EDGES = np.linspace(-1.05, 1.05, 22)


def open_loop_metrics(predicted: np.ndarray, true: np.ndarray) -> dict[str, float]:
    """Return figures of steering, predicted and true, float [N] each, in -1..1.

    `mse` and `mae` are the mean squared and the mean absolute error. `balanced_mae` is the mean of
    the MAEs of 21 steering bins: driving straight does not score well on a log that is straight for
    72 % of its rows. `bias` is the mean of predicted minus true, positive to the right.
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
    """Return the figures of two constant outputs: always zero, always the training mean."""
    return {
        "always zero": open_loop_metrics(np.zeros_like(true), true),
        "mean": open_loop_metrics(np.full_like(true, train_mean), true),
    }


def side_response(left: np.ndarray, right: np.ndarray) -> float | None:
    """Return a network's recovery response, -1..1; None without side images.

    It is half of the mean difference in steering between the left camera's images and the right
    camera's (0.8 m to each side), and needs no label. Of all figures without a drive it predicted
    driving best (`docs/offline_metrics.md`).
    """
    return float((left - right).mean() / 2) if len(left) else None


@torch.inference_mode()
def predict_steering(module: lightning.LightningModule, batches: EvaluationBatches) -> np.ndarray:
    """Return a `SteeringModule`'s steering of rows, float32 [N], computed on its device."""
    module.eval()
    steering: list[float] = []  # small arrays, kept between batches, would fragment the heap
    for number in range(len(batches)):
        batch = {name: tensor.to(module.device) for name, tensor in batches[number].items()}
        steering += module(batch)[:, 0].float().tolist()
    return np.array(steering, np.float32)
