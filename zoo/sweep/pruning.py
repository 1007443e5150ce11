"""Tells a study how a trial is doing, and ends it where others did better."""

import warnings

import lightning
import optuna

from datamodules.errors import InputError
from zoo.cli.stop_errors import PrunedError


class Pruning(lightning.Callback):
    """Reports a figure after each epoch to an Optuna study, wherever its trial is trained.

    A trial that the study holds for over, as where a run is repeated, is left alone. An epoch in
    which nothing was driven reports the last drive's figure.

    Args:
        storage, study: where the study is.
        trial: its number.
        watched: the figure's name, such as `drive/autonomy`.
        pruner, startup_trials, warmup_epochs: see `make_pruner`; a study does not keep them.

    Raises:
        PrunedError: after an epoch in which the study gives the trial up.
    """

    def __init__(
        self,
        storage: str,
        study: str,
        trial: int,
        watched: str,
        pruner: str,
        startup_trials: int,
        warmup_epochs: int,
    ) -> None:
        self.storage, self.study, self.number, self.watched = storage, study, trial, watched
        self.pruner = make_pruner(pruner, startup_trials, warmup_epochs)
        self.trial: optuna.Trial | None = None

    def on_fit_start(self, trainer: lightning.Trainer, module: lightning.LightningModule) -> None:
        if not trainer.is_global_zero:
            return
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        study = optuna.load_study(study_name=self.study, storage=self.storage, pruner=self.pruner)
        frozen = study.get_trials(deepcopy=False)[self.number]
        if not frozen.state.is_finished():
            self.trial = optuna.Trial(study, frozen._trial_id)

    def on_train_epoch_end(
        self, trainer: lightning.Trainer, module: lightning.LightningModule
    ) -> None:
        said = None
        value = trainer.callback_metrics.get(self.watched)
        if self.trial is not None and value is not None:
            with warnings.catch_warnings():
                # A trial that goes on repeats the epoch in which it was cut off.
                warnings.filterwarnings("ignore", message=".*is already reported.*")
                self.trial.report(float(value), trainer.current_epoch)
            if self.trial.should_prune():
                said = f"given up after epoch {trainer.current_epoch + 1}"
                said += f": {self.watched} {float(value):.4g}, others were better"
        said = trainer.strategy.broadcast(said)
        if said:
            raise PrunedError(said)


def make_pruner(name: str, startup_trials: int, warmup_epochs: int) -> optuna.pruners.BasePruner:
    """`median` gives a trial up that is worse than half of the others were after the same epoch;
    `halving` leaves a quarter at each rung (arXiv:1810.05934); `none` gives none up.

    Raises:
        InputError: another name.
    """
    if name == "median":
        return optuna.pruners.MedianPruner(startup_trials, warmup_epochs)
    if name == "halving":
        return optuna.pruners.SuccessiveHalvingPruner(min_resource=warmup_epochs + 1)
    if name == "none":
        return optuna.pruners.NopPruner()
    raise InputError(f"hydra.sweeper.pruner={name}: there are median, halving, none")
