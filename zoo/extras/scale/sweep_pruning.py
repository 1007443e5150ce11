"""Reporting of a trial's figures to its Optuna study, which can prune the trial."""

import warnings

import optuna
from lightning import Callback, LightningModule, Trainer

from zoo.base.errors import InputError, PrunedError


class Pruning(Callback):
    """A callback that reports a figure to an Optuna study after each epoch.

    It reports nothing for a trial that has ended in the study, as when a run is repeated. After an
    epoch without a drive it reports the last drive's figure.

    Args:
        storage: URL of the study's database.
        study: name of the study.
        trial: number of the trial.
        watched: name of the figure, such as `drive/autonomy`.
        pruner, startup_trials, warmup_epochs: settings of the pruner, see
            `conf/hydra/sweeper/optuna.yaml`; the database does not store them.

    Raises:
        PrunedError: the study prunes the trial after an epoch.
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

    def on_fit_start(self, trainer: Trainer, module: LightningModule) -> None:
        """Load the trial from its study, in the first process."""
        if not trainer.is_global_zero:
            return
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        study = optuna.load_study(study_name=self.study, storage=self.storage, pruner=self.pruner)
        frozen = study.get_trials(deepcopy=False)[self.number]
        if not frozen.state.is_finished():
            self.trial = optuna.Trial(study, frozen._trial_id)

    def on_train_epoch_end(self, trainer: Trainer, module: LightningModule) -> None:
        """Report the figure, and stop all ranks if the study prunes the trial."""
        reason = None
        value = trainer.callback_metrics.get(self.watched)
        if self.trial is not None and value is not None:
            with warnings.catch_warnings():
                # A resumed trial repeats the epoch in which it was interrupted.
                warnings.filterwarnings("ignore", message=".*is already reported.*")
                self.trial.report(float(value), trainer.current_epoch)
            if self.trial.should_prune():
                reason = f"pruned after epoch {trainer.current_epoch + 1}"
                reason += f": {self.watched} {float(value):.4g}, other trials were better"
        reason = trainer.strategy.broadcast(reason)
        if reason:
            raise PrunedError(reason)


def make_pruner(name: str, startup_trials: int, warmup_epochs: int) -> optuna.pruners.BasePruner:
    """Return a pruner by name.

    `median` prunes a trial that is worse than half of the others were after the same epoch;
    `halving` keeps a quarter of the trials at each rung (arXiv:1810.05934); `none` prunes none.

    Raises:
        InputError: no pruner has this name.
    """
    if name == "median":
        return optuna.pruners.MedianPruner(startup_trials, warmup_epochs)
    if name == "halving":
        return optuna.pruners.SuccessiveHalvingPruner(min_resource=warmup_epochs + 1)
    if name == "none":
        return optuna.pruners.NopPruner()
    raise InputError(f"hydra.sweeper.pruner={name}: must be median, halving or none")
