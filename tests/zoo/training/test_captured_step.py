"""Steps that a GPU replays, and the plain steps where none can."""

from io import StringIO
from pathlib import Path

import pytest
import torch
from rich.console import Console
from torch import nn

from tests.recordings import Written
from tests.zoo.trainings import equal, train_here
from zoo.base.errors import InputError
from zoo.training.captured_step import PLAIN_STEPS, CapturedStep

STEPS = PLAIN_STEPS + 3
LENET = ("model=lenet", "data.batch_size=16", "trainer.max_epochs=2", "augment=[brightness,bend]")
has_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")


def line_fit(optimizer_of, captures: bool, broken: type[Exception] | None = None):
    """Fit a line by steps; return its weights, the optimizer and what was printed."""
    torch.manual_seed(0)
    line, console = nn.Linear(3, 1), Console(file=StringIO(), width=300)
    batches = [{"images": torch.randn(8, 3), "targets": torch.randn(8, 1)} for _ in range(STEPS)]
    optimizer, inputs = optimizer_of(line.parameters()), []

    def step(batch: dict) -> torch.Tensor:
        inputs.append(batch)
        if broken and len(inputs) == 2:
            raise broken("it is broken")
        loss = (line(batch["images"]) - batch["targets"]).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        return loss.detach()

    take = CapturedStep(step, optimizer, 8, console) if captures else step
    for number, batch in enumerate(batches):
        for group in optimizer.param_groups:
            group["lr"] = 0.1 / (1 + number)  # as a schedule
        take(batch)
    return line.state_dict(), optimizer, console.file.getvalue()


@pytest.mark.parametrize(
    "optimizer_of",
    [torch.optim.Adam, lambda weights: torch.optim.SGD(weights, lr=0.1, momentum=0.9)],
    ids=["adam", "sgd"],
)
def test_where_nothing_can_be_captured_plain_steps_learn_the_same_and_a_line_says_so(optimizer_of):
    captured, optimizer, printed = line_fit(optimizer_of, captures=True)
    plain, _, _ = line_fit(optimizer_of, captures=False)
    for name, weight in plain.items():
        torch.testing.assert_close(captured[name], weight, rtol=1e-6, atol=1e-7)
    assert printed.count("not replayed as a CUDA graph") == 1
    group = optimizer.param_groups[0]
    assert type(group["lr"]) is float, "a checkpoint holds plain values"
    assert not group.get("capturable")


def test_an_error_of_the_user_ends_the_training():
    with pytest.raises(InputError, match="it is broken"):
        line_fit(torch.optim.Adam, captures=True, broken=InputError)


def test_a_training_that_cannot_be_captured_is_the_plain_one(
    recorded: Written, tmp_path: Path, console: Console
) -> None:
    words = (*LENET, "trainer.accelerator=cpu", "data.augment_on=device")
    group = {"batches_per_step": 4, "captured_batch": 16}
    captured, data = train_here(recorded, tmp_path / "a", *words, **group, console=console)
    plain, _ = train_here(recorded, tmp_path / "b", *words, batches_per_step=4)
    assert captured.train_samples == plain.train_samples == 2 * len(data.samples)
    assert float(captured.mean_loss()) == pytest.approx(float(plain.mean_loss()), rel=1e-4)
    for name, weight in plain.state_dict().items():
        torch.testing.assert_close(captured.state_dict()[name], weight, rtol=0.01, atol=1e-4)
    assert "not replayed as a CUDA graph" in console.file.getvalue()


@has_gpu
@pytest.mark.parametrize("schedule", ["constant", "cosine"])
def test_replayed_steps_learn_what_plain_ones_do(
    schedule: str, recorded: Written, tmp_path: Path, console: Console
) -> None:
    words = (*LENET, "trainer.accelerator=gpu", "trainer.precision=32-true", f"schedule={schedule}")
    replayed, _ = train_here(recorded, tmp_path / "a", *words, console=console)
    again, _ = train_here(recorded, tmp_path / "b", *words)
    plain, _ = train_here(recorded, tmp_path / "c", *words, "trainer.group_batches=false")
    assert "not replayed" not in console.file.getvalue()
    assert equal(replayed.state_dict(), again.state_dict())
    for name, weight in plain.state_dict().items():
        torch.testing.assert_close(replayed.state_dict()[name], weight, rtol=1e-3, atol=1e-5)
