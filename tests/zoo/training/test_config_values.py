"""Values of a config, checked before anything is recorded or read."""

from pathlib import Path

import pytest
from omegaconf import OmegaConf

from tests.refusals import refusal
from tests.zoo.command_runs import only_line, run_here
from tests.zoo.compositions import composed
from zoo.scoring.track_scores import run_options
from zoo.training.config_values import check_arguments, check_config
from zoo.training.run_config import settle_windows, with_quick


def check(config: dict) -> None:
    created = OmegaConf.create(config)
    run_options(created.get("score"))
    check_config(with_quick(settle_windows(created)))


POSE = {"_target_": "datamodules.bend.Pose", "aside_m": -1}
NEAR_POSE = POSE | {"aside_m": 1, "pursuit_m": 0}
NOISE = {"_target_": "albumentations.GaussNoise", "std_range": [2, 3]}


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("quick", "maybe", "quick=maybe"),
        ("data.crop", 40, "data.crop=40"),
        ("data.cameras", -1, "data.cameras=-1 is not a list of center, left, right"),
        (
            "data.cameras",
            [["left"]],
            "data.cameras=[['left']] is not a list of center, left, right",
        ),
        ("data.cameras", ["left", "left"], "is not a list of center, left, right, each once"),
        ("model.colour", ["grey"], "model.colour=['grey'] is not one of rgb, "),
        ("model.resize", {"area": 1}, "model.resize={'area': 1} is not one of area, "),
        ("seed", "one", "seed=one: must be a whole number"),
        ("seed", -1, "seed=-1: must be a whole number"),
        ("seed", 20260131140509, "seed=20260131140509: must be a whole number in 0..1e+12"),
        ("seed", 1.5, "seed=1.5: must be a whole number"),
        ("model.name", 2024, "model.name=2024: must be text"),
        ("logger.tensorboard", True, "logger.tensorboard=true: takes keys"),
        ("logger.tensorboard.name", 3, "logger.tensorboard.name=3: must be text"),
        ("callbacks.early_stopping.monitor", ["val/mse"], "monitor=[val/mse]: must be text"),
        ("trainer.profiler", True, "trainer.profiler=true: must be text"),
        ("data.augment.brightness", 1, "data.augment.brightness=1: takes keys"),
        ("optim.lr", 0, "optim.lr=0: must be a number above 0"),
        ("optim.lr", "fast", "optim.lr=fast: must be a number"),
        ("optim.lr", float("nan"), "optim.lr=nan: must be a finite number"),
        ("optim.lr", float("inf"), "optim.lr=inf: must be a finite number"),
        ("optim.l2", -0.001, "optim.l2=-0.001: must be a number of 0 or more"),
        ("optim.backbone_lr", -1, "optim.backbone_lr=-1: must be a number of 0 or more"),
        ("optim.eps", "'1'", "optim.eps='1': must be a number"),
        ("schedule.step_size", 0, "schedule.step_size=0: must be a whole number of 1 or more"),
        ("trainer.check_val_every_n_epoch", 0, "trainer.check_val_every_n_epoch=0: must be"),
        ("schedule.gamma", -1, "schedule.gamma=-1: must be a number above 0"),
        ("schedule.factor", -0.5, "schedule.factor=-0.5: must be a number above 0"),
        ("schedule.mode", "max", "schedule.mode=max: must be min, "),
        ("schedule.patience", -3, "schedule.patience=-3: must be a whole number of 0 or more"),
        ("callbacks.early_stopping.patience", -3, "patience=-3: must be a whole number of 0 or"),
        ("callbacks.early_stopping.min_delta", -1, "min_delta=-1: must be a number of 0 or more"),
        ("trainer.limit_train_batches", 0, "limit_train_batches=0: must be a number above 0"),
        ("trainer.gradient_clip_val", -1, "gradient_clip_val=-1: must be a number of 0 or more"),
        ("optim.momentum", 2, "optim.momentum=2: must be a number in 0..1"),
        ("data.split_seed", -1, "split_seed=-1: must be a whole number of 0 or more"),
        ("callbacks.fed_batch.count", 0, "count=0: must be a whole number of 1 or more"),
        ("callbacks.predicted_against_true.every_n_epochs", 0, "must be a whole number of 1 or"),
        ("trainer.val_check_interval", 0, "val_check_interval=0: must be a number above 0"),
        ("trainer.min_epochs", 31, "trainer.min_epochs=31: must be a whole number in 0..30"),
        ("schedule.T_max", 0, "schedule.T_max=0: must be a whole number of 1 or more"),
        ("trainer.use_distributed_sampler", True, "use_distributed_sampler=true: must be False"),
        ("trainer.barebones", True, "trainer.barebones=true: must be False"),
        ("data.flip", 2, "data.flip=2: must be a number in 0..1, or both"),
        ("callbacks.best.every_n_epochs", 1.5, "every_n_epochs=1.5: must be a whole number"),
        ("callbacks.best.filename", "other", "callbacks.best.filename=other: must be best"),
        ("callbacks.last.filename", "other", "callbacks.last.filename=other: must be last"),
        ("callbacks.last.save_weights_only", True, "save_weights_only=true: must be False"),
        ("callbacks.best.save_top_k", 3, "callbacks.best.save_top_k=3: must be 1"),
        ("data.augment.brightness.p", 2, "data.augment.brightness.p=2: must be a number in 0..1"),
        ("data.augment.brightness.scale", [-1, 1], "must be [a number of 0 or more, a number of 0"),
        ("data.augment.pose", POSE, "pose.aside_m=-1: must be a number of 0 or more"),
        ("data.augment.pose", NEAR_POSE, "pose.pursuit_m=0: must be a number of 1 or more"),
        ("data.augment.noise", NOISE, "data: std_range Value error, All values in (2.0, 3.0) must"),
        ("trainer.precision", "fp16", "trainer.precision=fp16: must be "),
        ("trainer.max_epochs", -1, "trainer.max_epochs=-1: must be a whole number of 0 or more"),
        ("data.ofset", 1, "data.ofset: no such key; did you mean data.offset"),
        ("optim.momentun", 1, "optim.momentun: no such key"),
        ("model.dropuot", 1, "model.dropuot: no such key; did you mean model.dropout"),
        ("trainer.foo", 1, "trainer.foo: no such key"),
        ("callbacks.best.modus", "min", "did you mean callbacks.best.mode"),
        ("callbacks.none.x", 1, "callbacks.none: has keys, but no _target_"),
        ("loss._target_", "torch.nn.NoLoss", "NoLoss"),
        ("loss._target_", "torch.nn", "torch.nn"),
        ("loss._target_", "torch.nn:MSELoss", "torch.nn:MSELoss"),
        ("loss._target_", "..", ".."),
    ],
)
def test_a_wrong_value_or_key_is_named(key: str, value: object, words: str) -> None:
    config = OmegaConf.create(composed("data.root=laps"))
    OmegaConf.update(config, key, value, force_add=True)
    assert words in refusal(check, OmegaConf.to_container(config))


def test_a_whole_number_may_be_typed_as_1e1() -> None:
    config = OmegaConf.create(composed("data.root=laps"))
    config.trainer.max_epochs = 1e1
    check_config(config)
    assert repr(config.trainer.max_epochs) == "10", "Lightning takes no float"


@pytest.mark.parametrize("key", ["seed=one", "+optim.foo=1", "callbacks.best.save_top_k=2"])
def test_a_wrong_value_is_named_before_the_lake_is_recorded(key: str, tmp_path: Path) -> None:
    assert key.lstrip("+").partition("=")[0] in only_line(run_here(tmp_path, key), 2)
    assert not (tmp_path / "outputs" / "recordings").exists()


def test_annotations_that_only_type_checkers_resolve_are_left_out() -> None:
    def function(rate: "Unknown", count: "int") -> None:  # noqa: F821
        pass

    check_arguments("loss", function, {"rate": True, "count": 1})
    assert "count=true" in refusal(check_arguments, "loss", function, {"count": True})
