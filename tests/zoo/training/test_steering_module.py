"""The LightningModule: its optimizer, loss and predictions of windows, and open-loop figures."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf
from torch import nn

from tests.recordings import Written
from tests.zoo.models.test_memory import NAMES, memory_of, windows
from tests.zoo.models.test_models_command import build
from tests.zoo.trainings import module_of, train_here
from zoo.base.compose import compose_config
from zoo.base.errors import InputError
from zoo.models.losses import SteeringWeightedMSE
from zoo.models.make_network import view_of
from zoo.models.network_facts import facts_of
from zoo.training.batch_outputs import predictor, true_outputs
from zoo.training.build import build_data
from zoo.training.open_loop import baseline_metrics, open_loop_metrics, side_response
from zoo.training.steering_module import SteeringModule


def optimizers_of(recorded: Written, *overrides: str) -> dict:
    root = f"data.root={recorded.folder}"
    config = OmegaConf.create(compose_config([root, "model.weights=null", *overrides]))
    return module_of(config, build_data(config).view).configure_optimizers()


def groups(recorded: Written, *overrides: str) -> list[dict]:
    return optimizers_of(recorded, *overrides)["optimizer"].param_groups


def test_l2_decays_weights_and_not_biases(recorded: Written) -> None:
    """Keras' l2(0.001) adds 0.001 w^2 to the loss, whose gradient is torch's decay of 0.002."""
    weights, biases = groups(recorded, "optim.l2=0.001")
    assert {parameter.ndim for parameter in biases["params"]} == {1}
    assert min(parameter.ndim for parameter in weights["params"]) > 1
    assert weights["weight_decay"] == pytest.approx(0.002)
    assert biases["weight_decay"] == 0


def test_a_constant_schedule_keeps_its_factor_in_every_epoch(recorded: Written) -> None:
    optimizers = optimizers_of(recorded, "optim.lr=0.1", "schedule.factor=0.5")
    for _ in range(8):
        assert {group["lr"] for group in optimizers["optimizer"].param_groups} == {0.05}
        optimizers["optimizer"].step()
        optimizers["lr_scheduler"]["scheduler"].step()


def test_a_backbone_learns_at_a_rate_of_its_own(recorded: Written) -> None:
    counts = {0.002: 0, 0.0002: 0}
    keys = ("optim.lr=0.001", "optim.backbone_lr=0.0001", "optim.lr_batch=16")  # data has 64
    for group in groups(recorded, "model=vgg", *keys):
        counts[group["lr"]] += len(group["params"])
    assert counts == {0.0002: 2 * 3, 0.002: 2 * 2}, "three convolutions learn, and the head"
    with pytest.raises(InputError, match=r"optim\.backbone_lr=0.0001: .* no pretrained part"):
        groups(recorded, "model=tiny", *keys)


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
    keys = (*keys, "data.samples_per_epoch=32")
    module, _ = train_here(recorded, tmp_path, *keys, "trainer.max_epochs=1")
    predicted, true = module.validation
    assert predicted.shape == true.shape
    assert facts_of(module.network).predicts_spread


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


@pytest.mark.parametrize("name", ["nvidia_speed", "cnn_gru"])
def test_a_batch_is_evaluated_in_pieces(name: str) -> None:
    network, view = build(name)
    windowed = (network.sequence,) if hasattr(network, "sequence") else ()
    shape = (70 // (windowed or (1,))[0], *windowed, 3, *view.shape[:2])
    seen, plain = [], network.forward
    network.forward = lambda *given: seen.append(len(given[0])) or plain(*given)
    batch = {
        "images": torch.randint(0, 256, shape, dtype=torch.uint8),
        "speed": torch.linspace(0, 30, shape[0]),
    }
    with torch.inference_mode():
        predicted = module_around(network).eval()(batch)
        whole = predictor(network)(batch)
        module_around(network).train()(batch)
    assert seen.pop() == shape[0], "a training has whole batches"
    assert seen == ([4, 4, shape[0]] if windowed else [32, 32, 6, 70])
    whole = network.newest(whole) if windowed else whole
    assert torch.allclose(predicted, whole, atol=1e-6)


ROWS = {
    "pilotnet_stack": [3],
    "cnn_gru": [0, 1, 2, 3],
    "ncp": [0, 1, 2, 3],
    "action_chunk": [3, 4, 5],
}


def network_of(name: str) -> nn.Module:
    ahead = ["model.ahead=2"] if name == "action_chunk" else []
    return memory_of(name, "model.sequence=4", *ahead)


def module_around(network: nn.Module, loss: nn.Module | None = None) -> SteeringModule:
    return SteeringModule(network, loss or nn.MSELoss(), optimizer=torch.optim.Adam)


def batch_of(network: nn.Module) -> dict[str, torch.Tensor]:
    rows = network.sequence + network.ahead
    steering = torch.arange(2 * rows).float().reshape(2, rows) / 20
    targets = torch.stack([steering, -torch.ones(2, rows)], 2)
    return {"images": windows(network), "speed": torch.zeros(2), "targets": targets}


@pytest.mark.parametrize("name", NAMES)
def test_each_prediction_is_compared_with_the_row_that_it_is_for(name: str) -> None:
    network = network_of(name)
    batch = batch_of(network)
    predicted = network(batch["images"])
    true = true_outputs(network)(batch)
    assert predicted.flatten(0, 1).shape == true.shape == (2 * len(ROWS[name]), 1)
    assert true[:, 0].tolist() == batch["targets"][:, ROWS[name], 0].flatten().tolist()
    module_around(network.train(), SteeringWeightedMSE())._loss(batch).backward()
    for weight in network.parameters():
        assert weight.grad is not None, "every weight learns"
        assert weight.grad.isfinite().all()


@pytest.mark.parametrize("columns", [lambda true: true[:, 0], lambda true: true.repeat(1, 2)])
def test_targets_that_a_loss_would_broadcast_are_refused(columns: Callable) -> None:
    class Module(SteeringModule):
        def targets_of(self, batch: dict) -> torch.Tensor:
            return columns(super().targets_of(batch))

    network = network_of(NAMES[0])
    module = Module(network, nn.MSELoss(), optimizer=torch.optim.Adam)
    with pytest.raises(InputError, match=r"^targets_of: \[\d+(, 2)?\] for outputs of \[\d+, 1\]$"):
        module._loss(batch_of(network))


@pytest.mark.parametrize("value", [None, 0.5, torch.ones(2), torch.tensor(0.5)])
def test_a_loss_or_an_optimizer_of_the_user_that_is_none_is_named(value: object) -> None:
    network = network_of(NAMES[0])
    loss = type("Mine", (nn.Module,), {"forward": lambda *_: value})()
    optimizer = torch.optim.LBFGS if value is None else lambda _: value
    module = SteeringModule(network, loss, optimizer=optimizer)
    with pytest.raises(InputError, match=r"^loss: Mine must return a mean with"):
        module._loss(batch_of(network))
    with pytest.raises(InputError, match=r"^optim: \w+ cannot train; name one of torch"):
        module.configure_optimizers()


@pytest.mark.parametrize("name", NAMES)
def test_windows_of_one_frame_are_plain_batches(name: str) -> None:
    """A datamodule without windows has images [N, C, H, W] and targets [N, 2]."""
    network = memory_of(name, "model.sequence=1", *["model.ahead=0"] * (name == "action_chunk"))
    images, targets = windows(network)[:, 0], torch.tensor([[0.5, 0.0], [0.25, 0.0]])
    module = module_around(network)
    with torch.inference_mode():
        predicted = module({"images": images})
        loss = module._loss({"images": images, "targets": targets})
    assert predicted.shape == (2, 1)
    assert loss.item() == pytest.approx(float((predicted - targets[:, :1]).square().mean()))


def test_figures_by_hand() -> None:
    metrics = open_loop_metrics(np.full(4, 0.1), np.array([0.0, 0.0, 0.0, 0.5]))
    assert metrics["mse"] == pytest.approx((3 * 0.01 + 0.16) / 4)
    assert metrics["mae"] == pytest.approx((3 * 0.1 + 0.4) / 4)
    assert metrics["balanced_mae"] == pytest.approx((0.1 + 0.4) / 2)
    assert metrics["bias"] == pytest.approx((0.3 - 0.4) / 4)
    full_lock = open_loop_metrics(np.zeros(3), np.array([-1.0, 0.0, 1.0]))
    assert full_lock["balanced_mae"] == pytest.approx(2 / 3), "a bin on either side"
    baselines = baseline_metrics(np.array([-0.2, 0.6]), train_mean=0.2)
    assert baselines["always zero"]["mae"] == pytest.approx(0.4)
    assert baselines["mean"]["bias"] == pytest.approx(0.0)


def test_the_side_response_is_half_of_what_the_left_camera_adds() -> None:
    assert side_response(np.array([0.3, 0.5]), np.array([-0.3, 0.1])) == pytest.approx(0.25)
    assert side_response(np.array([]), np.array([])) is None


@pytest.mark.parametrize(
    ("optim", "lr_batch", "batch_size", "rate"),
    [
        ("adam", "null", 1024, 0.001),
        ("adam", 64, 1024, 0.004),
        ("adam", 64, 64, 0.001),
        ("adam", 1024, 64, 0.00025),
        ("sgd", 64, 128, 0.02),
    ],
)
def test_the_learning_rate_follows_the_batch_that_it_is_for(
    optim: str, lr_batch: int | str, batch_size: int, rate: float, recorded: Written
) -> None:
    keys = (f"optim={optim}", f"optim.lr_batch={lr_batch}", f"data.batch_size={batch_size}")
    (group,) = groups(recorded, "model=tiny", *keys)
    assert group["lr"] == pytest.approx(rate)


def test_a_users_files_need_none_of_drivezoos_own_keys() -> None:
    config = OmegaConf.create(compose_config(["model=tiny"]))
    for key in ("l2", "lr_batch", "backbone_lr"):
        del config.optim[key]
    del config.model.weights
    module = module_of(config, view_of(config.model, config.data.crop))
    assert (module.l2, module.backbone_lr) == (0.0, None)
