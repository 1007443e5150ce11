"""Training on batches that are made on the device that trains; here that is a CPU."""

from pathlib import Path

import pytest
import torch

from datamodules.batches import GROUP
from tests.recordings import Written
from tests.zoo.trainings import train_here
from zoo.base.errors import InputError

ALL = "augment=[brightness,shadow,shift,bend]"


@pytest.fixture(autouse=True)
def threads() -> None:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def train(
    recorded: Written, folder: Path, *overrides: str, together: int = 1
) -> tuple[dict[str, torch.Tensor], float]:
    """Train for an epoch; return the weights and the mean loss."""
    module, _ = train_here(
        recorded,
        folder,
        "data.batch_size=32",
        "model=lenet",
        "trainer=cpu",
        "trainer.max_epochs=1",
        *overrides,
        together=together,
    )
    return module.state_dict(), float(module.mean_loss())


def test_without_augmentation_it_learns_the_same_to_the_bit(
    recorded: Written, tmp_path: Path
) -> None:
    """Mirroring and balance are the same; batches come in groups, as on a GPU."""
    plain, _ = train(recorded, tmp_path, "augment=[]", "data.augment_on=cpu")
    for together in (1, GROUP):
        there, _ = train(
            recorded, tmp_path, "augment=[]", "data.augment_on=device", together=together
        )
        assert all(torch.equal(there[name], tensor) for name, tensor in plain.items())


@pytest.mark.parametrize(
    "precision", ["32-true", pytest.param("bf16-mixed", marks=pytest.mark.slow)]
)
def test_with_augmentation_it_learns_as_on_the_cpu(
    precision: str, recorded: Written, tmp_path: Path
) -> None:
    _, here = train(recorded, tmp_path, ALL, "data.augment_on=cpu")
    _, there = train(
        recorded, tmp_path, ALL, "data.augment_on=device", f"trainer.precision={precision}"
    )
    assert there == pytest.approx(here, rel=0.02)


def test_what_only_the_cpu_can_do_is_said_before_training(
    recorded: Written, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"data\.augment_on=device: GaussianBlur has no equiv"):
        train(recorded, tmp_path, "augment=[blur]", "data.augment_on=device")
