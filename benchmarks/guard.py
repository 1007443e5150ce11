"""Measure frames per second with a guard: `python benchmarks/guard.py CKPT [samples]`.

For each score that the checkpoint can have, a line has the medians of 200 frames, interleaved, in
one thread: milliseconds of processor time of the policy alone and with the guard, and frames per
second with the guard. Processor time is close to wall time on an idle machine.
"""

import sys
import time

import numpy as np
import torch

from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.checkpoints.policy import load_policy
from zoo.monitor.guard_file import Guard
from zoo.monitor.guarded_policy import GuardedPolicy
from zoo.monitor.scores import METHODS, fit_score
from zoo.monitor.signals import ENSEMBLE, IMAGE_SIZE, MAP_SIZE

FRAMES, WARM = 200, 10
SHAPES = {"image": (*IMAGE_SIZE[::-1], 3), "map": (*MAP_SIZE[::-1], 1)}


def main(checkpoint: str, samples: str = "16") -> None:
    torch.set_num_threads(1)
    policy = load_policy(find_checkpoint(checkpoint))
    rng = np.random.default_rng(0)
    for name, method in METHODS.items():
        if method.signal == ENSEMBLE:
            continue
        nominal = rng.integers(0, 255, (64, *SHAPES.get(method.signal, ())), np.uint8)
        guard = Guard(fit_score(name, nominal, epochs=1), 1e9, 15, 6.0, int(samples), "")
        try:
            guarded = GuardedPolicy(policy, guard)
        except InputError as error:
            print(f"{name}: {error}")
            continue
        took: dict[str, list[float]] = {"alone": [], "guarded": []}
        for frame in rng.integers(0, 255, (WARM + FRAMES, 160, 320, 3), np.uint8):
            for key, drive in (("alone", policy), ("guarded", guarded)):
                began = time.process_time()
                drive(frame, 9.0)
                took[key].append(1000 * (time.process_time() - began))
        alone, both = (float(np.median(one[WARM:])) for one in took.values())
        print(f"{name}: {alone:.1f} ms alone, {both:.1f} ms with it: {1000 / both:.0f} frames/s")


if __name__ == "__main__":
    main(*sys.argv[1:])
