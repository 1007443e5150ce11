"""Driving while training: it changes nothing, costs what it may, and can be monitored."""

import csv
from pathlib import Path

import lightning
import numpy as np
import pytest
import torch
from omegaconf import OmegaConf
from rich.console import Console

from tests.recordings import Written
from tests.zoo.command_runs import only_line, run, run_here, succeed
from tests.zoo.models.test_models_command import build
from tests.zoo.trainings import data_of, equal, metrics, module_of
from tests.zoo.written_checkpoints import write_constant
from zoo.base.compose import compose_config
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.training.build import build_trainer, load_data
from zoo.training.closed_loop import ClosedLoop

SHORT = ("callbacks.closed_loop.starts=2", "callbacks.closed_loop.metres=10")


def small(recorded: Written, *overrides: str) -> list[str]:
    data = (*data_of(recorded), "data.block_s=0.5", "data.gap_s=0.1", "data.batch_size=16")
    return [*data, "trainer=cpu", "trainer.max_epochs=2", "logger=csv", "score=none", *overrides]


def fit(
    recorded: Written, folder: Path, console: Console, *overrides: str
) -> tuple[lightning.Trainer, dict[str, torch.Tensor]]:
    """Train; return the trainer and the weights."""
    config = OmegaConf.create(compose_config(small(recorded, *overrides)))
    data = load_data(config, console)
    module = module_of(config, data.view)
    trainer = build_trainer(config, folder, has_validation=True)
    trainer.fit(module, datamodule=data)
    return trainer, module.state_dict()


def driver_of(trainer: lightning.Trainer) -> ClosedLoop:
    return next(call for call in trainer.callbacks if isinstance(call, ClosedLoop))


def logged(folder: Path, name: str) -> dict[int, float]:
    """Return the figures by epoch, from 0."""
    with (folder / "metrics.csv").open(newline="") as file:
        return {int(row["epoch"]): float(row[name]) for row in csv.DictReader(file) if row[name]}


@pytest.mark.slow
def test_training_goes_on_as_if_nobody_had_driven(
    recorded: Written, tmp_path: Path, console: Console
) -> None:
    overrides = ("model=nvidia", "callbacks=closed_loop", *SHORT)
    monitor = ("callbacks.best.monitor=drive/cte_mean", "callbacks.best.mode=min")
    driven, weights = fit(
        recorded, tmp_path / "a", console, *overrides, *monitor, "callbacks.closed_loop.share=null"
    )
    _, plain = fit(recorded, tmp_path / "b", console, "model=nvidia")

    assert equal(weights, plain)
    errors = logged(tmp_path / "a", "drive/cte_mean")
    assert list(errors) == list(logged(tmp_path / "a", "drive/autonomy")) == [0, 1]
    assert set(logged(tmp_path / "a", "drive/interventions").values()) == {0.0}
    best = float(driven.checkpoint_callback.best_model_score)
    assert best == pytest.approx(min(errors.values()), rel=1e-5)
    assert driver_of(driven).cost["drives"] == 2


def test_a_drive_leaves_mode_gradients_and_chance_as_they_were() -> None:
    network, view = build("nvidia")
    height, width, channels = view.shape
    network.train()(torch.zeros(2, channels, height, width, dtype=torch.uint8)).sum().backward()
    gradients = [weight.grad.clone() for weight in network.parameters()]
    chance, numbers = torch.get_rng_state(), np.random.get_state()[1].copy()  # noqa: NPY002
    threads = torch.get_num_threads()
    callback = ClosedLoop(starts=1, metres=5)
    callback._open()

    figures = [callback.drive(network, view, {}) for _ in range(2)]

    assert figures[0] == figures[1]
    assert set(figures[0]) == {"autonomy", "interventions", "cte_mean", "cte_max", "score"}
    assert all(module.training for module in network.modules())
    assert torch.equal(chance, torch.get_rng_state())
    assert (numbers == np.random.get_state()[1]).all()  # noqa: NPY002
    assert torch.get_num_threads() == threads
    for weight, before in zip(network.parameters(), gradients, strict=True):
        assert torch.equal(weight.grad, before)
    callback.world.close()


def test_its_share_of_the_work_is_kept_by_leaving_epochs_out() -> None:
    callback = ClosedLoop(every_n_epochs=2, share=0.2)
    assert callback._due(1, 0), "the first in any case: a checkpoint may monitor it"
    callback.frames = callback.last_frames = 1_000
    callback.figures = {"drive/score": 1.0}
    for images, epoch, due in ((79_999, 2, False), (80_000, 3, False), (80_000, 4, True)):
        assert callback._due(epoch, images) == due
    resumed = ClosedLoop(every_n_epochs=2, share=0.2)
    resumed.load_state_dict(callback.state_dict())
    assert not resumed._due(2, 79_999)
    callback.share = None
    assert callback._due(2, 0)


def test_a_resumed_run_monitors_the_last_drive_until_the_next(
    recorded: Written, tmp_path: Path
) -> None:
    keys = small(recorded, "model=tiny", "data.crop=[50,0]", "callbacks=closed_loop")
    keys += [f"callbacks.closed_loop.{key}" for key in ("starts=1", "metres=5", "quality=simple")]
    keys += ["callbacks.best.monitor=drive/cte_mean"]
    succeed(run_here(tmp_path, *keys, "trainer.max_epochs=1", "hydra.run.dir=run"))
    last = tmp_path / "run" / "checkpoints" / "last.ckpt"
    (figure,) = logged(tmp_path / "run", "drive/cte_mean").values()

    def best(contents: dict) -> float:
        states = contents["callbacks"]
        monitors = [state for key, state in states.items() if "drive/cte_mean" in key]
        return float(monitors[0]["best_model_score"])

    succeed(run_here(tmp_path, "resume=run", "trainer.max_epochs=2"))
    assert list(logged(tmp_path / "run", "drive/cte_mean")) == [0], "it drove again"
    assert metrics(tmp_path / "run")["closed_loop"]["in_training"]["drives"] == 1, "before, too"
    contents = torch.load(last, weights_only=True)
    assert best(contents) == pytest.approx(figure)
    contents["callbacks"]["ClosedLoop"].pop("figures")  # as a version before wrote it
    torch.save(contents, last)
    succeed(run_here(tmp_path, "resume=run", "trainer.max_epochs=3"))
    assert list(logged(tmp_path / "run", "drive/cte_mean")) == [0, 2]


@pytest.mark.parametrize("setting", [{"starts": 0}, {"metres": 0}, {"share": -1}])
def test_a_setting_that_cannot_be_is_named(setting: dict) -> None:
    with pytest.raises(InputError, match=rf"callbacks\.closed_loop\.{next(iter(setting))}="):
        ClosedLoop(**setting)


def test_where_no_renderer_opens_it_says_so_once_and_trains(
    recorded: Written, tmp_path: Path, console: Console, monkeypatch, capsys
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise InputError("renderer=auto: none opens here")

    monkeypatch.setattr("zoo.driving.embedded_world.open_embedded", refuse)
    tiny = ("model=tiny", "data.crop=[50,0]", "callbacks=closed_loop")
    tiny += ("callbacks.fed_batch=null", "callbacks.steering_histogram=null")
    trainer, _ = fit(recorded, tmp_path / "a", console, *tiny)
    assert trainer.current_epoch == 2
    printed = capsys.readouterr().out
    assert printed.count("closed loop: not driven: renderer=auto: none opens here") == 1
    with pytest.raises(InputError, match="monitors drive/cte_mean, but renderer=auto: none opens"):
        fit(recorded, tmp_path / "b", console, *tiny, "callbacks.best.monitor=drive/cte_mean")


@pytest.mark.parametrize(
    ("key", "problem"),
    [
        ("callbacks.early_stopping.patience=3", "but nothing drives; add callbacks=closed_loop"),
        ("callbacks=closed_loop", "of which the max is best; set its mode=max too"),
    ],
)
def test_nothing_that_drives_is_monitored_without_a_driver_or_in_the_wrong_direction(
    key: str, problem: str, recorded: Written, tmp_path: Path
) -> None:
    keys = (*small(recorded), key, "callbacks.early_stopping.monitor=drive/autonomy")
    line = only_line(run_here(tmp_path, *keys))
    assert f"EarlyStopping monitors drive/autonomy, {problem}" in line


def test_on_an_open_road_every_drive_has_its_length(tmp_path: Path) -> None:
    path = tmp_path / "road.yaml"
    path.write_text("closed: false\nsegments: [{straight: 50}]\n")
    callback = ClosedLoop(track=str(path), starts=3, metres=20, quality="simple")
    callback._open()
    begun, step = [], callback.world.simulated.step

    def step_and_note(*command: float) -> None:
        step(*command)
        if callback.world.simulated.frames == 1:
            begun.append(callback.world.simulated.place.distance)

    callback.world.simulated.step = step_and_note
    straight = load_checkpoint(write_constant(tmp_path / "straight.ckpt", steering=0.0))
    assert callback.drive(straight.network, straight.view, {})["interventions"] == 0
    assert begun == pytest.approx([0, 10, 20], abs=1)
    callback.world.close()


@pytest.mark.slow
def test_two_processes_share_one_drive_and_metrics_json_holds_the_best(
    recorded: Written, tmp_path: Path
) -> None:
    keys = small(recorded, "model=tiny", "data.crop=[50,0]", "trainer=ddp_cpu")
    keys += ["callbacks=closed_loop", *SHORT]
    keys += [f"callbacks.{name}.monitor=drive/cte_mean" for name in ("early_stopping", "best")]
    result = run(tmp_path, *keys, "hydra.run.dir=run")
    printed, figures = succeed(result), metrics(tmp_path / "run")
    driven, errors = figures["closed_loop"], logged(tmp_path / "run", "drive/cte_mean")
    assert (driven["track"], driven["metres"]) == ("lake", 20)
    assert driven["cte_mean"] == pytest.approx(min(errors.values()), rel=1e-5)
    assert figures["best_epoch"] == min(errors, key=errors.get) + 1
    assert driven["in_training"]["drives"] == len(errors)
    assert printed.count("closed loop: ") == 1, "one process speaks"
    assert "PossibleUserWarning" not in result.stderr
