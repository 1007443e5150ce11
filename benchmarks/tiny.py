"""Measure the overhead of training with a network of 41 parameters: `python benchmarks/tiny.py`.

It compares a whole fit of `drivezoo train`, with validation, checkpoints, logs and progress, with a
bare loop of as many steps over the same batches in memory.
"""

import time
from pathlib import Path

import torch
from rich.console import Console

from benchmarks.material import OUT, config_for, linked_recording
from benchmarks.timing import Row, median_ratio, medians, run_part, take_turns
from datamodules.driving import DrivingData

SAMPLES, BATCH, EPOCHS = 24_000, 128, 30
BARE = 3  # the bare loop runs only every third epoch, because all epochs are alike


def measure(short: bool) -> list[Row]:
    """Measure the time of a fit relative to the bare loop, and to six seconds."""
    epochs, rounds = (1, 1) if short else (EPOCHS, 2)
    config = config_for(
        linked_recording(200 if short else 3_000),
        "experiment=tiny41",
        f"data.samples_per_epoch={SAMPLES}",
        f"trainer.max_epochs={epochs}",
        "trainer.accelerator=cpu",
    )
    from zoo.training.build import build_data, build_module, build_network
    from zoo.training.plan import TrainingPlan

    console, plan = Console(quiet=True), TrainingPlan(torch.device("cpu"))
    torch.set_num_threads(1)
    data = build_data(config)
    data.load(console)
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

    found = take_turns({"zoo s": lambda: fit(config, data), "bare loop s": bare}, rounds)
    ours, theirs = found.values()
    what = f"tiny, 41 parameters, {epochs} epochs of {SAMPLES:,} samples"
    seconds = medians({"zoo s": ours})
    return [
        Row(what, "a bare loop", median_ratio(ours, theirs), 2.0, False, medians(found)),
        Row(what, "6 s", seconds["zoo s"] / 6, 1.0, False, seconds),
    ]


def fit(config: object, data: DrivingData) -> float:
    """Return the seconds of the fit alone; other parts measure loading and start-up."""
    from zoo.training.build import build_feed, build_module, build_network, build_trainer
    from zoo.training.host_settings import set_up_process
    from zoo.training.plan import make_plan

    folder = Path(OUT / "run")
    folder.mkdir(parents=True, exist_ok=True)
    console = Console(quiet=True)
    network = build_network(config, data.view, console)
    trainer = build_trainer(config, folder, has_validation=True)
    trainer.callbacks = [
        one for one in trainer.callbacks if "training_images" not in type(one).__module__
    ]
    plan = make_plan(config, data, network, trainer, console)
    module = build_module(config, network, plan, {}, console)
    set_up_process(plan.threads)
    data = build_feed(data, plan, console)
    began = time.perf_counter()
    trainer.fit(module, datamodule=data)
    return time.perf_counter() - began


if __name__ == "__main__":
    run_part(measure)
