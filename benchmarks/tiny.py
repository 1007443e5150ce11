"""Measure the overhead of training with a network of 41 parameters: `make bench ONLY=tiny`.

It compares a whole fit of `drivezoo train`, with validation, checkpoints, logs and progress, with a
bare loop of as many steps over the same batches in memory.
"""

import time

import torch
from rich.console import Console

from benchmarks.material import OUT, config_for, linked_recording, loaded_data, ready_to_fit
from benchmarks.measuring import Row, compared, seconds_of, take_turns
from datamodules.driving import DrivingData

SAMPLES, BATCH, EPOCHS = 24_000, 128, 30
PLOTS = ("fed_batch", "steering_histogram", "predicted_against_true")
BARE = 3  # the bare loop runs only every third epoch, because all epochs are alike


def measure(short: bool) -> list[Row]:
    """Measure the time of a fit relative to the bare loop."""
    epochs, rounds = (1, 1) if short else (EPOCHS, 2)
    config = config_for(
        linked_recording(200 if short else 3_000),
        "experiment=tiny41",
        f"data.samples_per_epoch={SAMPLES}",
        f"trainer.max_epochs={epochs}",
        "trainer.accelerator=cpu",
        *(f"callbacks.{name}=null" for name in PLOTS),
    )
    from zoo.training.build import build_module, build_network
    from zoo.training.plan import TrainingPlan

    console, plan = Console(quiet=True), TrainingPlan(torch.device("cpu"))
    torch.set_num_threads(1)
    data = loaded_data(config)
    batches = list(data.train_dataloader())

    def bare() -> float:
        network = build_network(config, data.view, console).train()
        module = build_module(config, network, plan, {}, console)
        optimizer = module.optimizer(list(network.parameters()))
        began = time.perf_counter()
        for _ in range(max(1, epochs // BARE)):
            for batch in batches:
                loss = module.loss(network(batch["images"]), batch["targets"][:, :1])
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
        return (time.perf_counter() - began) * epochs / max(1, epochs // BARE)

    times = take_turns({"zoo s": lambda: fit(config, data), "bare loop s": bare}, rounds)
    what = f"tiny, 41 parameters, {epochs} epochs of {SAMPLES:,} samples"
    return [compared(times, what, "a bare loop", ("zoo s", "bare loop s"), 2.0, False)]


def fit(config: object, data: DrivingData) -> float:
    """Return the seconds of the fit alone; other parts measure loading and start-up."""
    trainer, module, data = ready_to_fit(config, data, OUT / "run")
    return seconds_of(lambda: trainer.fit(module, datamodule=data))
