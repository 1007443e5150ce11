"""`drivezoo train resume=FOLDER`: resume a stopped run, or train a finished run further."""

import re
from pathlib import Path

from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig, OmegaConf

from zoo.base.errors import InputError
from zoo.base.parts import typed_parts
from zoo.base.terminal import command_line
from zoo.base.whole_file import refuse_links_out
from zoo.cli.compose import config_groups, quote_paths
from zoo.cli.console_progress import loading
from zoo.runs.saved_config import Keys, check_saved_config, leaf_keys, split_trust


def resume(folder: Path, overrides: list[str]) -> None:
    """Resume a run with its own config, plus overrides such as `trainer.max_epochs=60`.

    A finished run is left as it is, unless the overrides ask for more epochs. The folder may
    come from another person: `trust=my.Loss` among the overrides allows what `check_saved_config`
    refuses.

    Raises:
        InputError: the folder holds no run, an override is wrong, the config names something that
            is not allowed, or there is no checkpoint to resume from; see also `run_experiment`.
        StoppedError: on Ctrl-C.
    """
    saved_path = folder / ".hydra" / "config.yaml"
    if not saved_path.is_file():
        raise InputError(
            f"{folder}: is no run's folder (no .hydra/config.yaml); name the folder of a run"
        )
    overrides, trusted = split_trust(overrides)
    chosen = [text for text in overrides if text.split("=")[0].lstrip("+~") in config_groups()]
    if chosen:
        raise InputError(
            f"{chosen[0]}: a resumed run keeps its config groups; set single values, such as "
            "trainer.max_epochs=60, or start a new run"
        )
    from zoo.runs.metrics_file import read_metrics_file
    from zoo.runs.run import load_config
    from zoo.runs.status import read_status_file

    refuse_links_out(folder)
    saved = load_config(folder)
    config, typed = _overridden(saved, overrides)
    check_saved_config(config, saved_path, trusted, typed)
    if read_status_file(folder).get("status") == "finished":
        finished = FinishedRun(folder, saved, read_metrics_file(folder))
        if not finished.is_less_than(config):
            print("\n".join(finished.lines(overrides)))
            return
        if not finished.last.is_file():
            raise InputError(
                f"{finished.last}: missing, so the run cannot be resumed; start a new run with "
                f"model.weights={finished.best}"
            )
    with loading():
        from zoo.training.run import run_experiment

    run_experiment(config, folder.resolve(), resume=True, keep_config=bool(overrides))


def _overridden(saved: DictConfig, overrides: list[str]) -> tuple[DictConfig, set[Keys]]:
    """Return a copy of a config with overrides as Hydra reads them, and the keys that they set."""
    config, typed = saved.copy(), set()
    OmegaConf.set_struct(config, True)
    for change in OverridesParser.create().parse_overrides(quote_paths(overrides)):
        if change.is_delete():
            value = None
        elif change.is_sweep_override():
            raise InputError(f"{change.input_line}: is a sweep; give one value to resume a run")
        else:
            value = change.value()
        OmegaConf.update(
            config, change.key_or_group, value, force_add=change.is_add() or change.is_force_add()
        )
        typed |= leaf_keys(value, tuple(re.split(r"[.\[\]]+", change.key_or_group)))
    return config, typed


class FinishedRun:
    """A finished run: its files, and how to train it further."""

    def __init__(self, folder: Path, config: DictConfig, metrics: dict) -> None:
        self.folder, self.config, self.metrics = folder, config, metrics
        self.epochs = self.metrics.get("epochs") or 0
        self.best = folder / "checkpoints" / "best.ckpt"
        self.last = folder / "checkpoints" / "last.ckpt"

    @property
    def stopped_early(self) -> bool:
        """Return whether early stopping ended it before its last epoch."""
        return _stops_early(self.config) and self.epochs < _max_epochs(self.config)

    def is_less_than(self, config: DictConfig) -> bool:
        """Return whether a config asks for more epochs than this run's config or training."""
        if self.stopped_early and not _stops_early(config):
            return True
        return _max_epochs(config) > max(_max_epochs(self.config), self.epochs)

    def lines(self, overrides: list[str]) -> list[str]:
        """Return the lines to print: the run's files, and how to train further."""
        early = f" of {_max_epochs(self.config)}, stopped early" if self.stopped_early else ""
        lines = [f"{self.folder}: finished after {self.epochs} epochs{early}; nothing to do"]
        if overrides:
            lines[0] += f" ({' '.join(overrides)}: no more epochs)"
        best_epoch = self.metrics.get("best_epoch")
        after = f" (after epoch {best_epoch})" if best_epoch else ""
        page = self.folder / "report" / "index.html"
        lines += [f"best checkpoint{after}: {self.best}"] if self.best.is_file() else []
        lines += [f"report: {page}"] if page.is_file() else []
        if self.last.is_file():
            command = ["drivezoo", "train", f"resume={self.folder}", *self._more()]
            command += typed_parts()
            lines.append(f"train further: {command_line(command)}")
        if self.best.is_file():
            lines.append(f"or start a new run from its weights: model.weights={self.best}")
        return lines

    def _more(self) -> list[str]:
        most = self.config.trainer.max_epochs
        if self.stopped_early:
            return ["callbacks.early_stopping=null"]
        if self.config.quick:
            return ["quick=false"] + ([] if most > self.epochs else [_epochs(2 * self.epochs)])
        return [_epochs(2 * max(self.epochs, 1))]


def _epochs(count: int) -> str:
    return f"trainer.max_epochs={count}"


def _stops_early(config: DictConfig) -> bool:
    return bool((config.get("callbacks") or {}).get("early_stopping"))


def _max_epochs(config: DictConfig) -> float:
    """Return how many epochs a config asks for; infinity for a value that is no number."""
    from zoo.training.run_config import with_quick

    most = with_quick(config).trainer.max_epochs
    return most if isinstance(most, int | float) else float("inf")
