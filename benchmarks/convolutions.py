"""Measure PilotNet's convolutions layer by layer: `python benchmarks/convolutions.py`.

It reads oneDNN's verbose log of the bare loop of `benchmarks/training.py`, and compares each
convolution's operations per second with the best matrix product. oneDNN computes channels in groups
of 16, so the table also states which share of the computed channels exists.
"""

import os
import re
import subprocess
import sys
from collections import Counter

import torch

from benchmarks.measuring import print_table
from benchmarks.training import BATCH, bare_step, best_product

STEPS, GROUP = 10, 16
PASSES = {
    "forward_training": "forward",
    "backward_data": "backward, images",
    "backward_weights": "backward, weights",
}
SHAPE = re.compile(r"ic(\d+)oc(\d+)_ih\d+oh(\d+)kh(\d+)\S*_iw\d+ow(\d+)kw(\d+)")


def run_steps() -> None:
    """Run the bare loop; oneDNN writes its log."""
    from zoo.training.host_settings import keep_freed_memory

    keep_freed_memory()
    images = torch.randint(0, 255, (BATCH, 66, 200, 3), dtype=torch.uint8).permute(0, 3, 1, 2)
    step, targets = bare_step(tuned=True), torch.rand(BATCH, 1)
    for _ in range(2):
        step(images, targets)
    with torch.backends.mkldnn.verbose(torch.backends.mkldnn.VERBOSE_ON):
        for _ in range(STEPS):
            step(images, targets)


def read_log(log: str) -> tuple[dict[tuple[str, ...], float], float]:
    """Return the ms of a step by layer, pass and algorithm, and those of changes of layout."""
    spent: Counter[tuple[str, ...]] = Counter()
    layout = 0.0
    for line in log.splitlines():
        fields = line.split(",")
        if not line.startswith("onednn_verbose") or "exec" not in fields:
            continue
        kind, algorithm, direction = fields[5:8]
        milliseconds = float(fields[-1]) / STEPS
        if kind == "convolution":
            spent[fields[-2], direction, algorithm] += milliseconds
        elif kind == "reorder":
            layout += milliseconds
    return dict(spent), layout


def main() -> int:
    """Print the table; return the exit status."""
    again = [sys.executable, __file__, "steps"]
    log = subprocess.run(again, env=os.environ, capture_output=True, text=True, check=True).stdout
    spent, layout = read_log(log)
    if not spent:
        print("convolutions.py: oneDNN computes no convolution on this processor")
        return 1
    limit = max(best_product("cpu", 1024, torch.float32) for _ in range(3))
    rows = []
    for (problem, direction, algorithm), ms in spent.items():
        inputs, outputs, high, tall, across, wide = map(int, SHAPE.search(problem).groups())
        rate = 2 * BATCH * inputs * outputs * high * across * tall * wide / ms * 1000
        layer = f"{inputs} to {outputs}, {tall} x {wide}"
        cells = [f"{ms:.2f}", f"{rate / 1e9:.0f}", f"{rate / limit:.2f}"]
        cells.append(f"{existing(inputs) * existing(outputs):.2f}")
        rows.append([layer, PASSES[direction], algorithm.split(":")[0], *cells])
    head = ["layer", "pass", "oneDNN's", "ms", "GFLOP/s", "of the limit", "channels that exist"]
    print_table(head, rows)
    total = sum(spent.values())
    print(f"a step: {total:.1f} ms in convolutions, {layout:.1f} ms in changes of layout")
    print(f"the limit: a matrix product at {limit / 1e9:.0f} GFLOP/s")
    return 0


def existing(channels: int) -> float:
    """Return the share of the computed channels that exist; three colours are not padded."""
    return 1.0 if channels <= 3 else channels / (-(-channels // GROUP) * GROUP)


if __name__ == "__main__":
    if sys.argv[1:] == ["steps"]:
        run_steps()
    else:
        sys.exit(main())
