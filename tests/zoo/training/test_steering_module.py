"""The LightningModule's optimizer: what decays, and what learns at which rate."""

from pathlib import Path

import pytest
from omegaconf import OmegaConf

from tests.recordings import Written
from tests.zoo.trainings import module_of, train_here
from zoo.base.errors import InputError
from zoo.cli.compose import compose_config
from zoo.training.build import build_data


def groups(recorded: Written, *overrides: str) -> list[dict]:
    root = f"data.root={recorded.folder}"
    config = OmegaConf.create(compose_config([root, "model.weights=null", *overrides]))
    module = module_of(config, build_data(config).view)
    return module.configure_optimizers()["optimizer"].param_groups


def test_l2_decays_weights_and_not_biases(recorded: Written) -> None:
    """Keras' l2(0.001) adds 0.001 w^2 to the loss, whose gradient is torch's decay of 0.002."""
    weights, biases = groups(recorded, "optim.l2=0.001")
    assert {parameter.ndim for parameter in biases["params"]} == {1}
    assert min(parameter.ndim for parameter in weights["params"]) > 1
    assert weights["weight_decay"] == pytest.approx(0.002)
    assert biases["weight_decay"] == 0


def test_a_backbone_learns_at_a_rate_of_its_own(recorded: Written) -> None:
    found = groups(recorded, "model=vgg", "optim.lr=0.001", "optim.backbone_lr=0.0001")
    counts = {0.001: 0, 0.0001: 0}
    for group in found:
        counts[group["lr"]] += len(group["params"])
    assert counts == {0.0001: 2 * 3, 0.001: 2 * 2}, "three convolutions learn, and the head"


def test_frozen_blocks_are_left_to_no_optimizer(recorded: Written) -> None:
    found = groups(recorded, "model=vgg", "model.trainable_blocks=0")
    assert sum(len(group["params"]) for group in found) == 4


def test_a_rate_that_is_none_is_refused(recorded: Written) -> None:
    with pytest.raises(InputError, match=r"optim\.lr=0 is not a number above 0"):
        groups(recorded, "optim.lr=0")


def test_weights_that_overflow_in_an_epochs_last_step_stop_the_training(
    recorded: Written, tmp_path: Path
) -> None:
    """The epoch's losses are finite: they come from the weights before the last step."""
    one_step = ("model=lenet", "data.batch_size=16", "data.samples_per_epoch=16")
    with pytest.raises(InputError, match=r"weights are not finite in epoch 1.*optim\.lr"):
        train_here(recorded, tmp_path, *one_step, "optim.lr=1e39", "trainer.max_epochs=1")


def test_a_network_that_predicts_its_spread_trains_by_its_mean(
    recorded: Written, tmp_path: Path
) -> None:
    keys = ("model=nvidia_gaussian", "loss=gaussian", "model.width=0.1", "data.batch_size=16")
    module, _ = train_here(recorded, tmp_path, *keys, "trainer.max_epochs=1")
    predicted, true = module.validation
    assert predicted.shape == true.shape
    assert module.network.predicts_spread


@pytest.mark.parametrize(
    ("keys", "remedy"),
    [
        (["model=nvidia_gaussian"], r"loss=gaussian$"),
        (["loss=gaussian"], r"model=nvidia_gaussian, or loss=mse$"),
    ],
)
def test_loss_and_network_must_agree_on_the_spread(
    keys: list[str], remedy: str, recorded: Written
) -> None:
    with pytest.raises(InputError, match=f"^loss: .*{remedy}"):
        groups(recorded, *keys)
