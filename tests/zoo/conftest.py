"""One training run, which many tests read."""

from pathlib import Path

import pytest

from tests.recordings import Written
from tests.zoo.command_runs import run, succeed


@pytest.fixture(scope="session")
def run_folder(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train `nvidia` for two epochs with the command, and return the run's folder."""
    cwd = tmp_path_factory.mktemp("work")
    data = (f"data.root={recorded.folder}", "data.block_s=0.5", "data.gap_s=0.1")
    keys = ("model=nvidia", "data.batch_size=16", "trainer.max_epochs=2", "score.laps=0.02")
    printed = succeed(run(cwd, *data, *keys, "hydra.run.dir=run", timeout=300))
    (cwd / "run" / "stdout.txt").write_text(printed)
    return cwd / "run"


@pytest.fixture(scope="session")
def checkpoint(run_folder: Path) -> str:
    """Return the path of the run's best checkpoint."""
    return str(run_folder / "checkpoints" / "best.ckpt")
