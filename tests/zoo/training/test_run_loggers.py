"""What a run's loggers store, read back from their files."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from lightning.pytorch.loggers import Logger
from omegaconf import OmegaConf
from rich.console import Console
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from zoo.training.run_loggers import final_scores, log_results, naming_arguments

CONFIG = {"model": {"name": "lenet"}, "quick": False, "logger": {"mine": {"key": "secret"}}}
LAKE = {"drives": 3, "drives_without_intervention": 3, "autonomy": [0.9, 0.1]}
LAKE |= {"lap_s": [90.0, None], "recovery_s": None}
METRICS = {"open_loop": {"val": {"mse": 0.5}}, "drive": {"tracks": {"lake": LAKE}}}


def test_tensorboard_has_the_config_the_scores_and_the_report(train, tmp_path: Path) -> None:
    train("trainer.max_epochs=1", "optim.lr=0.002")
    stored = yaml.safe_load((tmp_path / "run" / "hparams.yaml").read_text())
    assert (stored["optim.lr"], stored["model.name"]) == (0.002, "tiny")
    events = EventAccumulator(str(tmp_path / "run"))
    events.Reload()
    assert {"final/val/mse", "val/mse"} <= set(events.Tags()["scalars"])
    assert any("report" in tag for tag in events.Tags()["tensors"])


def test_mlflow_has_the_name_the_config_the_scores_and_the_report(train, tmp_path: Path) -> None:
    mlflow = pytest.importorskip("mlflow")
    train("trainer.max_epochs=1", "logger=mlflow")
    client = mlflow.MlflowClient(f"sqlite:///{tmp_path}/outputs/mlflow.db")
    (run,) = client.search_runs([client.get_experiment_by_name("drivezoo").experiment_id])
    assert (run.info.run_name, run.data.tags["model"]) == ("run", "tiny")
    assert run.data.params["data.batch_size"] == "16"
    assert "final/val/mse" in run.data.metrics
    assert [artifact.path for artifact in client.list_artifacts(run.info.run_id)] == ["report"]
    assert not (tmp_path / "mlruns").exists()


@pytest.mark.usefixtures("here")
def test_a_sweeps_jobs_are_a_group_with_the_names_of_their_folders() -> None:
    config, job = OmegaConf.create(CONFIG), Path("outputs", "sweep", "3")
    alone = naming_arguments("wandb", config, job.absolute())
    assert (alone["name"], alone["group"], alone["tags"]) == ("sweep/3", None, ["lenet"])
    job.mkdir(parents=True)
    job.with_name("sweep.json").write_text("{}")
    assert naming_arguments("wandb", config, job.absolute())["group"] == "sweep"
    assert naming_arguments("mlflow", config, job.absolute())["tags"]["group"] == "sweep"


def test_scores_have_their_deviation_and_a_share() -> None:
    scores = dict(final_scores(METRICS))
    assert scores["final/val/mse"] == 0.5
    assert (scores["final/lake/autonomy"], scores["final/lake/autonomy_std"]) == (0.9, 0.1)
    assert scores["final/lake/share_without_intervention"] == 1
    assert "final/lake/lap_s_std" not in scores
    assert dict(final_scores(METRICS | {"drive": None})) == {"final/val/mse": 0.5}


class Lost(Logger):
    """A logger without its server."""

    name = version = None

    def log_metrics(self, *_: object) -> None:
        raise ConnectionError("no server")

    def log_hyperparams(self, *_: object) -> None:
        """Do nothing."""


def test_a_logger_that_fails_at_the_end_gets_a_line(tmp_path: Path, console: Console) -> None:
    log_results(SimpleNamespace(loggers=[Lost()], global_step=1), {}, METRICS, tmp_path, console)
    (line,) = console.file.getvalue().splitlines()
    assert line.startswith("Lost: ")
    assert "no server" in line
