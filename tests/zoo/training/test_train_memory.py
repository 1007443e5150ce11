"""Every network with memory trains on a recording's windows, and its checkpoint drives."""

from pathlib import Path

import numpy as np
import pytest

from tests.recordings import Written
from tests.slow_members import slow_but
from tests.zoo.command_runs import run_here, succeed
from tests.zoo.models.test_memory import NAMES
from tests.zoo.trainings import data_of
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.runs.metrics_file import read_metrics_file
from zoo.scoring.checked_export import export_checkpoint

SMALL = {
    "pilotnet_stack": ["model.sequence=2", "model.stride=2"],
    "cnn_gru": ["model.sequence=3", "model.neurons=4"],
    "ncp": ["model.sequence=3"],
    "action_chunk": ["model.ahead=2"],
}


# The other three differ in their network alone; `test_memory` and `test_export_command` have all.
QUICK = ("action_chunk",)


@pytest.mark.parametrize("name", slow_but(QUICK, NAMES))
def test_it_trains_and_drives(name: str, recorded: Written, tmp_path: Path, console) -> None:
    network = (f"experiment={name}", "model.width=0.25", *SMALL[name])
    data = (*data_of(recorded), "data.block_s=1", "data.gap_s=0.1", "data.batch_size=16")
    keys = ("data.samples_per_epoch=32", "callbacks=checkpoints", "trainer.max_epochs=1")
    score = ("score.laps=0.01", "score.film=false")
    succeed(run_here(tmp_path, *network, *data, *keys, *score, "hydra.run.dir=run"))
    metrics = read_metrics_file(tmp_path / "run")
    assert metrics["drive"]["drives"], "not driven"
    assert np.isfinite(metrics["open_loop"]["val"]["mse"])
    policy = load_policy(tmp_path / "run")
    assert policy.data["rows_per_s"] > 0
    files = str(tmp_path / "model.onnx"), str(recorded.folder)
    exported = load_policy(export_checkpoint(str(tmp_path / "run"), *files, console))
    frames = np.random.default_rng(0).integers(0, 256, (5, 160, 320, 3), np.uint8)
    policy.reset()
    for frame in frames:
        assert exported(frame, 9.0).steering == pytest.approx(policy(frame, 9.0).steering, abs=1e-4)
