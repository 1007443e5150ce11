"""The user's own training step, as `docs/extending.md` shows it."""

import json
import re
import sys
from pathlib import Path

import pytest
import torch

from tests.recordings import Written
from tests.zoo.base.user_parts import NETWORK, write_network
from tests.zoo.command_runs import ROOT, only_line, run, succeed
from tests.zoo.trainings import SMALL, data_of
from zoo.checkpoints.checkpoint import load_checkpoint

NAMES = r"my_training\.py|conf/module/my_training\.yaml|conf/callbacks/ema\.yaml"
BLOCK = re.compile(rf"```(?:python|yaml)\n# (?P<path>{NAMES})\n(?P<text>.*?)```", re.S)
NAMED = "parts=[my_net.py,my_training.py]"
CHOSEN = ("model=my_net", "module=my_training", "callbacks=ema")
# In training a second column, for the speed.
AUXILIARY = NETWORK.replace("shape[2], 1", "shape[2], 2").replace(
    "return self.head((images / 255).mean(2).flatten(1))",
    "outputs = self.head((images / 255).mean(2).flatten(1))\n"
    "        return outputs if self.training else outputs[:, :1]",
)


@pytest.fixture(scope="module")
def trained(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train with the manual's part, and return the folder of the files and the run."""
    folder = tmp_path_factory.mktemp("own_training")
    write_network(folder, AUXILIARY)
    blocks = list(BLOCK.finditer((ROOT / "docs" / "extending.md").read_text()))
    assert len(blocks) == 3
    for block in blocks:
        path = folder / block["path"]
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_text(block["text"])
    usual = [word for word in SMALL if not word.startswith(("model=", "callbacks="))]
    keys = ("module.rise=4", "callbacks.ema.decay=0.9", "trainer.max_epochs=2", "hydra.run.dir=run")
    plots = ("fed_batch", "steering_histogram", "predicted_against_true")
    keys += tuple(f"callbacks.{name}=null" for name in plots)
    succeed(run(folder, NAMED, *CHOSEN, *usual, *data_of(recorded), *keys))
    return folder


def test_the_optimizer_the_schedule_and_the_average_are_in_the_checkpoint(trained: Path) -> None:
    saved = torch.load(trained / "run" / "checkpoints" / "last.ckpt", weights_only=True)
    (group,) = saved["optimizer_states"][0]["param_groups"]
    assert group["weight_decay"] == 0.01
    steps = saved["global_step"]
    assert saved["lr_schedulers"][0]["last_epoch"] == steps > 4, "a step for each batch"
    assert group["lr"] == pytest.approx(0.001 * (1 - steps / (steps + 1)))
    average, current = saved["state_dict"], saved["current_model_state"]
    assert any(not torch.equal(average[name], current[name]) for name in average)


def test_the_network_learns_the_auxiliary_column_and_drives_without_it(
    trained: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DRIVEZOO_PARTS", str(trained / "my_net.py"))
    monkeypatch.syspath_prepend(trained)
    network = load_checkpoint(trained / "run").network
    assert network(torch.zeros(2, 1, 16, 32)).shape == (2, 1)
    assert network.train()(torch.zeros(2, 1, 16, 32)).shape == (2, 2)
    sys.modules.pop("my_net", None)  # other tests have a file of that name


def test_a_resumed_run_needs_the_part(trained: Path) -> None:
    line = only_line(run(trained, "parts=my_net.py", "resume=run", "trainer.max_epochs=3"))
    assert "module._target_='my_training.MyTraining'" in line
    assert "parts=" in line
    succeed(run(trained, NAMED, "resume=run", "trainer.max_epochs=3"))
    assert json.loads((trained / "run" / "metrics.json").read_text())["epochs"] == 3


def test_a_class_that_is_no_module_is_refused(trained: Path, recorded: Written) -> None:
    chosen = ("model=my_net", "module=my_training", "module._target_=my_net.MyNet")
    line = only_line(run(trained, NAMED, *chosen, f"data.root={recorded.folder}", "score=none"))
    assert "module: " in line
