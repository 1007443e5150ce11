"""A training's pace and the device of its batches, which must not change what is learnt."""

import shutil
from dataclasses import replace
from pathlib import Path

import lightning
import pytest
import torch
from lightning.pytorch.loggers import TensorBoardLogger
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from datamodules.batches import GROUP
from datamodules.driving import DrivingData
from tests.recordings import Written
from tests.refusals import refusal
from tests.slow_members import slow
from tests.zoo.command_runs import run_here, succeed
from tests.zoo.trainings import SMALL, data_of, equal, planned, train_here
from zoo.base.compose import compose_config
from zoo.training import plan
from zoo.training.build import load_data
from zoo.training.compiled_loss import compile_step, compiles

MINE = "tests.zoo.training.test_plan"


def train(
    recorded: Written, folder: Path, *overrides: str, **changes: int
) -> tuple[dict[str, torch.Tensor], int]:
    """Train for two epochs; return the weights and the number of batches in a group."""
    keys = ("data.batch_size=16", "trainer.max_epochs=2", "trainer.accelerator=cpu")
    keys += ("augment=[brightness,shift]", *overrides)
    module, data = train_here(recorded, folder, *keys, **changes)
    assert module.train_samples == 2 * len(data.samples)
    return module.state_dict(), data.batches_per_step


def loaded(recorded: Written, *overrides: str) -> tuple[DictConfig, DrivingData]:
    """Return the config of a small training, and its data."""
    small = [*(word for word in SMALL if not word.startswith("callbacks")), *data_of(recorded)]
    config = OmegaConf.create(compose_config([*small, "trainer.accelerator=cpu", *overrides]))
    return config, load_data(config, Console(quiet=True))


@pytest.mark.parametrize("schedule", [*slow("constant"), "cosine"])
def test_batches_that_come_together_are_a_step_each(
    schedule: str, recorded: Written, tmp_path: Path
) -> None:
    overrides = ("model=tiny", "data.crop=[50,0]", f"schedule={schedule}")
    together, count = train(recorded, tmp_path / "a", *overrides)
    alone, _ = train(recorded, tmp_path / "b", *overrides, batches_per_step=1)
    assert count == GROUP
    assert equal(together, alone)


@pytest.mark.parametrize(
    "override",
    ["trainer.gradient_clip_val=1.0", "trainer.accumulate_grad_batches=2", *slow("model=nvidia")],
)
def test_what_lightning_does_by_the_step_keeps_steps_apart(
    override: str, recorded: Written, tmp_path: Path
) -> None:
    model = () if override.startswith("model=") else ("model=tiny", "data.crop=[50,0]")
    _, count = train(recorded, tmp_path / "a", *model, override, "data.samples_per_epoch=null")
    assert count == 1


@pytest.mark.parametrize(
    ("overrides", "count"),
    [
        ((), GROUP),
        (("callbacks=closed_loop",), GROUP),
        (("trainer.group_batches=false",), 1),
        ((f"+logger.mine._target_={MINE}.StepLogger", "+logger.mine.save_dir=."), 1),
        (("callbacks.learning_rate.logging_interval=step",), 1),
        (("+callbacks.last.every_n_train_steps=5",), 1),
        (("+callbacks.last.train_time_interval.hours=1",), 1),
        (("+callbacks.mine._target_=lightning.pytorch.callbacks.Timer",), 1),
        ((f"+callbacks.mine._target_={MINE}.QuietCallback",), GROUP),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) and value else "",
)
def test_what_looks_at_batches_or_steps_keeps_them_apart(
    overrides: tuple[str, ...], count: int, recorded: Written, tmp_path: Path
) -> None:
    config, data = loaded(recorded, *overrides)
    assert planned(config, data, tmp_path)[1].batches_per_step == count


class QuietCallback(lightning.Callback):
    """A user's callback that never looks at batches or steps, and says so."""

    takes_groups = True


class StepLogger(TensorBoardLogger):
    """A user's logger, which may count steps."""


COUNTER = """
import lightning

class Counter(lightning.Callback):
    def on_train_batch_end(self, trainer, module, outputs, batch, number):
        print(f"batch {number} of {len(batch['images'])} at step {trainer.global_step}")
"""


def test_a_users_callback_gets_each_batch_and_step(recorded: Written, tmp_path: Path) -> None:
    (tmp_path / "counter.py").write_text(COUNTER)
    mine = ("parts=counter.py", "+callbacks.mine._target_=counter.Counter")
    small = (*SMALL, *data_of(recorded), "trainer.max_epochs=1", "data.samples_per_epoch=48")
    printed = succeed(run_here(tmp_path, *small, *mine))
    lines = [line for line in printed.splitlines() if line.startswith("batch ")]
    assert lines == [f"batch {number} of 16 at step {number + 1}" for number in range(3)]


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("g++"), reason="no C++ compiler")
def test_compiled_it_learns_the_same_and_repeats_to_the_bit(
    recorded: Written, tmp_path: Path
) -> None:
    # Without dropout, whose draws a compiled step makes otherwise.
    overrides = ("model=tiny", "data.crop=[50,0]", "model.dropout=0.0")
    plain, _ = train(recorded, tmp_path / "a", *overrides, "trainer.compile=false")
    compiled, _ = train(recorded, tmp_path / "b", *overrides, "trainer.compile=true")
    again, _ = train(recorded, tmp_path / "c", *overrides, "trainer.compile=true")
    assert equal(compiled, again)
    assert plain.keys() == compiled.keys(), "a checkpoint of either loads anywhere"
    for name, tensor in plain.items():
        torch.testing.assert_close(compiled[name], tensor, rtol=0.02, atol=2e-4)


@pytest.mark.parametrize(("precision", "warning"), [("bf16-mixed", True), ("32-true", False)])
def test_bf16_that_the_processor_does_not_know_is_said(
    precision: str, warning: bool, recorded: Written, tmp_path: Path, console: Console, monkeypatch
) -> None:
    monkeypatch.setattr(plan, "multiplies_bf16", lambda: False)
    overrides = ("model=tiny", "data.crop=[50,0]", "trainer.max_epochs=1")
    overrides += ("trainer.accelerator=cpu", f"trainer.precision={precision}")
    train_here(recorded, tmp_path, *overrides, console=console)
    assert ("has no instructions for it" in console.file.getvalue()) is warning


def test_a_plan_finishes_the_constructors(recorded: Written, tmp_path: Path) -> None:
    """The built objects follow the plan; the loaded data do not change."""
    config, given = loaded(recorded)
    before = config.copy()
    module, data, _ = planned(config, given, tmp_path)
    assert (given.batches_per_step, data.batches_per_step) == (1, GROUP)
    assert data.recording is given.recording
    assert not module.skips_front
    assert torch.get_num_threads() == 1
    assert config == before


def test_a_task_of_slurm_has_the_threads_of_its_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", "3")
    for typed, threads in (("", 3), ("5", 5)):
        monkeypatch.setenv("OMP_NUM_THREADS", typed)
        assert plan._threads(plan.TINY_PARAMETERS, 2) == threads


def test_a_plan_prints_as_a_line() -> None:
    cpu = plan.TrainingPlan(torch.device("cpu"))
    assert cpu.line() == "plan: 32-true on cpu, 1 thread"
    more = replace(cpu, processes=2, threads=4, batches_per_step=32, compiled_batch=64)
    for word in ("2 processes", "4 threads", "32 batches per step", "compiled"):
        assert word in more.line()


def test_a_setting_of_compilation_that_is_no_truth_value_is_refused() -> None:
    assert [compiles(setting) for setting in (True, False, "auto")] == [True, False, False]
    assert "trainer.compile=maybe is not true or false" in refusal(compiles, "maybe")


def test_a_step_that_cannot_be_compiled_runs_as_it_was(
    console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> object:
        raise RuntimeError("no such header\nand much more")

    monkeypatch.setattr(torch, "compile", lambda step, **_: broken)
    step = compile_step(lambda number: number + 1, console)
    assert [step(1), step(2)] == [2, 3]
    assert console.file.getvalue() == "torch.compile disabled: no such header and much more\n"


LENET = ("model=lenet", "data.batch_size=32", "data.samples_per_epoch=128", "trainer=cpu")
LENET = (*LENET, "trainer.max_epochs=1")


def test_without_augmentation_it_learns_the_same_to_the_bit(
    recorded: Written, tmp_path: Path
) -> None:
    """Mirroring and balance are the same; batches come in groups, as on a GPU."""
    keys = (*LENET, "augment=[]")
    plain, _ = train_here(recorded, tmp_path, *keys, "data.augment_on=cpu", batches_per_step=1)
    for count in (1, GROUP):
        there, _ = train_here(
            recorded, tmp_path, *keys, "data.augment_on=device", batches_per_step=count
        )
        assert equal(there.state_dict(), plain.state_dict())


@pytest.mark.parametrize("precision", ["32-true", *slow("bf16-mixed")])
def test_with_augmentation_it_learns_as_on_the_cpu(
    precision: str, recorded: Written, tmp_path: Path
) -> None:
    keys = (*LENET, "augment=[brightness,shadow,shift,bend]")
    here, _ = train_here(recorded, tmp_path, *keys, "data.augment_on=cpu")
    on_device = ("data.augment_on=device", f"trainer.precision={precision}")
    there, _ = train_here(recorded, tmp_path, *keys, *on_device)
    assert float(there.mean_loss()) == pytest.approx(float(here.mean_loss()), rel=0.02)


def test_what_only_the_cpu_can_do_is_said_before_training(recorded: Written, here: Path) -> None:
    keys = (*LENET, "augment=[blur]", "data.augment_on=device")
    words = "data.augment_on=device: GaussianBlur has no equiv"
    assert words in refusal(train_here, recorded, here, *keys)
