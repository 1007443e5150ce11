"""A run in its loggers: name, group, tags and config at the start; scores and report at the end.

Lightning itself passes them the figures of each epoch.
"""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import lightning
from lightning.pytorch import loggers
from omegaconf import DictConfig
from rich.console import Console

from zoo.base.terminal import print_line
from zoo.checkpoints.checkpoint_path import short_name

SWEEP = "sweep.json"  # a sweep's record, in the folder of its jobs
FINAL = "final"  # first part of the scores' names


def naming_arguments(logger: str, config: DictConfig, folder: Path) -> dict[str, object]:
    """Return the arguments of a logger's constructor that name a run.

    A sweep's jobs are a group, which has the name of the sweep's folder.

    Args:
        logger: key of the logger in the config.
        config: experiment's config.
        folder: run's folder.
    """
    name = _name(folder)
    group = _name(folder.parent) if (folder.parent / SWEEP).is_file() else None
    tags = [config.model.name, *(["quick"] if config.quick else [])]
    if logger == "wandb":
        # Not in the run's folder: W&B links from there to its cache, and a run with links out of
        # its folder is refused by `resume=` and the report.
        return {"save_dir": "outputs", "name": name, "group": group, "tags": tags}
    if logger == "mlflow":
        named = {"model": config.model.name, "quick": str(config.quick).lower()}
        return {"run_name": name, "tags": named | ({"group": group} if group else {})}
    return {"save_dir": str(folder)} if logger == "tensorboard" else {}


def log_config(trainer: lightning.Trainer, config: Mapping) -> None:
    """Log a run's config as hyperparameters, by the keys that a user types."""
    for logger in trainer.loggers:
        logger.log_hyperparams(dict(_typed_keys(config)))


def log_results(
    trainer: lightning.Trainer, config: Mapping, metrics: dict, folder: Path, console: Console
) -> None:
    """Log a run's scores and its report, and close its loggers.

    A logger that fails, as without its server, gets a line: the training is complete.
    """
    scores = dict(final_scores(metrics))
    for logger in trainer.loggers:
        if isinstance(logger, loggers.CSVLogger):  # metrics.json holds the scores
            continue
        try:
            _log_result(logger, config, scores, folder / "report", trainer.global_step)
        except Exception as error:  # any error of a library or a server
            reason = " ".join(str(error).split()) or type(error).__name__
            print_line(
                console,
                f"{type(logger).__name__}: has no scores of this run: {reason}",
            )


def final_scores(metrics: dict) -> Iterator[tuple[str, float]]:
    """Yield the name and value of each score in `metrics.json`.

    A figure of several drives has its standard deviation as `..._std`.
    """
    for part, figures in metrics["open_loop"].items():
        yield from ((f"{FINAL}/{part}/{key}", float(value)) for key, value in figures.items())
    for track, figures in ((metrics["drive"] or {}).get("tracks") or {}).items():
        prefix = f"{FINAL}/{track}"
        for key, value in figures.items():
            mean, deviation = value if isinstance(value, tuple | list) else (value, None)
            if mean is not None:
                yield f"{prefix}/{key}", float(mean)
            if deviation is not None:
                yield f"{prefix}/{key}_std", float(deviation)
        kept, drives = figures.get("drives_without_intervention"), figures["drives"]
        if kept is not None:
            yield f"{prefix}/share_without_intervention", kept / drives


def _log_result(
    logger: loggers.Logger, config: Mapping, scores: dict[str, float], report: Path, step: int
) -> None:
    page = report / "report.md"
    if isinstance(logger, loggers.TensorBoardLogger):
        logger.log_hyperparams(dict(_typed_keys(config)), scores)
        if page.is_file():
            logger.experiment.add_text("report", page.read_text(encoding="utf-8"))
        logger.finalize("success")
        return
    logger.log_metrics(scores, step)
    if isinstance(logger, loggers.MLFlowLogger) and report.is_dir():
        logger.experiment.log_artifacts(logger.run_id, str(report), "report")
    if isinstance(logger, loggers.WandbLogger):
        run = logger.experiment
        if report.is_dir():
            import wandb

            artifact = wandb.Artifact(f"report-{run.id}", "report")
            artifact.add_dir(str(report))
            run.log_artifact(artifact)
        run.finish()  # else the next run of this process would be added to it


def _name(folder: Path) -> str:
    return short_name(folder).removeprefix(f"outputs{os.sep}")


def _typed_keys(config: Mapping, prefix: str = "") -> Iterator[tuple[str, object]]:
    for key, value in config.items():
        if isinstance(value, Mapping):
            if (prefix, key) != ("", "logger"):  # addresses and names of the loggers themselves
                yield from _typed_keys(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", str(value) if isinstance(value, list | tuple) else value
