"""Measure training on a GPU: `python benchmarks/gpu.py [NETWORK...] [device=cpu] [short]`.

For each network `drivezoo train trainer=gpu` trains on views that stay in the GPU's memory: as a
graph, compiled, in 32 bits, and with each operation by itself. The processes take turns, an epoch
each. The table has their operations per second relative to the machine's own limit, the best matrix
product in the same run. Before that, outputs and gradients of each network are compared with the
CPU's.

`device=cpu` runs the same path on a CPU, and `short` with tiny sizes: the figures mean nothing.
Without a GPU the script prints one line.
"""

import copy
import os
import statistics
import sys
from multiprocessing.connection import Connection

import numpy as np
import torch

from benchmarks.material import AUGMENT, OUT, config_for, linked_recording
from benchmarks.measuring import Row, contestants, print_rows, ratios, take_turns
from benchmarks.training import flops_of_sample, run_product, untrained
from benchmarks.training_callbacks import train_by_turns
from zoo.base.compose import choices
from zoo.training.batch_outputs import predictor

NETWORKS = ("nvidia", "vgg", "tiny", "cnn_gru", "pilotnet_stack")
BATCH, ROWS, ROUNDS = 256, 2_000, 5
EPOCH, EPOCH_FLOP = (20, 400), 2e14  # batches of an epoch, and their operations within that
SIDE = {"cuda": 8192, "cpu": 1024}  # of the square matrices whose product is timed
LIMIT = "bfloat16 matrix product"
TOLERANCE = 1e-3  # of the largest value: sums in another order, in 32 bits


def main(names: list[str], device: str, short: bool) -> int:
    """Print the comparison and the table; return the exit status."""
    unknown = [name for name in names if name not in choices("model")]
    if unknown:
        print(f"gpu.py: {unknown[0]}: no such network; available: {', '.join(choices('model'))}")
        return 2
    if device == "cuda" and not torch.cuda.is_available():
        print("gpu.py: no GPU found by torch.cuda.is_available(); device=cpu runs the same path")
        return 1
    differ = {name: difference(name, device) for name in names}
    linked_recording(ROWS)  # created once, before the processes need it
    with contestants(targets(names, device, short)) as measures:
        speeds = take_turns(measures, 1 if short else ROUNDS)
    rows = []
    for label in speeds.keys() - {LIMIT}:
        name = label.partition(",")[0]
        used = [flops_of_sample(name) * speed for speed in speeds[label]]
        figures = {"samples/s": statistics.median(speeds[label]), "from the CPU's": differ[name]}
        rows.append(Row(label, LIMIT, ratios(used, speeds[LIMIT]), figures=figures))
    print_rows(sorted(rows, key=lambda row: row.what))
    wrong = [name for name, value in differ.items() if value > TOLERANCE]
    if wrong:
        print(f"gpu.py: {', '.join(wrong)}: other results than on the CPU")
    return 1 if wrong else 0


def targets(names: list[str], device: str, short: bool) -> dict[str, tuple]:
    """Return the measured processes: the matrix product, and each network in several ways."""
    side = 64 if short else SIDE[device]
    processes: dict[str, tuple] = {LIMIT: (run_product, device, side, torch.bfloat16)}
    for name in names:
        batch, (least, most) = (8, (2, 2)) if short else (BATCH, EPOCH)
        batches = int(np.clip(EPOCH_FLOP / flops_of_sample(name) / batch, least, most))
        words = [AUGMENT, f"model={name}", "model.weights=null", "trainer=gpu"]
        words += ["callbacks=published", "data.augment_on=device", f"data.batch_size={batch}"]
        words += ["trainer.max_epochs=100000", f"data.samples_per_epoch={batch * batches}"]
        words += [f"trainer.accelerator={'gpu' if device == 'cuda' else 'cpu'}"]
        processes[name] = run_network, words
        if not short:
            processes[f"{name}, compiled"] = run_network, [*words, "trainer.compile=true"]
            processes[f"{name}, 32 bits"] = run_network, [*words, "trainer.precision=32-true"]
            processes[f"{name}, no graph"] = run_network, [*words, "trainer.group_batches=false"]
    return processes


def run_network(pipe: Connection, words: list[str]) -> None:
    """Train a network; send the samples per second of an epoch at each request."""
    config = config_for(linked_recording(ROWS), *words)
    train_by_turns(pipe, config, OUT / f"gpu-{os.getpid()}")


def difference(name: str, device: str) -> float:
    """Return the largest difference of outputs and gradients from the CPU's, as a share.

    In 32 bits and without dropout, because devices draw other random numbers.
    """
    network, batch = untrained(name, 4)
    for layer in network.modules():
        if isinstance(layer, torch.nn.Dropout):
            layer.p = 0.0
    torch.backends.cudnn.allow_tf32 = torch.backends.cuda.matmul.allow_tf32 = False
    results = []
    for where in ("cpu", device):
        moved = copy.deepcopy(network).to(where).train()
        outputs = predictor(moved)({key: value.to(where) for key, value in batch.items()})
        outputs.square().mean().backward()
        gradients = [weight.grad for weight in moved.parameters() if weight.grad is not None]
        results.append([tensor.detach().cpu() for tensor in (outputs, *gradients)])
    return max(
        float((ours - theirs).abs().max() / theirs.abs().max().clamp(min=1e-6))
        for theirs, ours in zip(*results, strict=True)
    )


if __name__ == "__main__":
    words = sys.argv[1:]
    wanted = [word for word in words if word != "short" and "=" not in word]
    device = "cpu" if "device=cpu" in words else "cuda"
    sys.exit(main(wanted or list(NETWORKS), device, "short" in words))
