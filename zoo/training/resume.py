"""`drivezoo train resume=FOLDER`: resume a stopped run, or train a finished run further.

A resumed run ends as a run that was started with its config. So it obeys only keys that change
nothing of what its finished epochs were trained with; any other is refused.
"""

from collections.abc import Iterator
from pathlib import Path

from omegaconf import DictConfig

from zoo.base.command_keys import typed_keys
from zoo.base.compose import escape_interpolation, hydra_overrides, plain_dict
from zoo.base.console_progress import loading
from zoo.base.errors import InputError, UsageError
from zoo.base.terminal import command_line, counted, printable
from zoo.base.whole_file import refuse_links_out
from zoo.checkpoints.checkpoint_path import trained_paths
from zoo.runs.saved_config import check_saved_config, overridden, split_trust
from zoo.training.obeyed_keys import PATIENCE, STOPPING, unobeyed

LIMITS = ("max_steps", "max_time")  # keys of `trainer` that end a training inside an epoch


def resume(folder: Path, overrides: list[str]) -> None:
    """Resume a run with its own config, plus overrides such as `trainer.max_epochs=60`.

    A finished run is left as it is, unless the overrides ask for more epochs or steps. The folder
    may come from another person: `trust=my.Loss` among the overrides allows what
    `check_saved_config` refuses.

    Raises:
        InputError: the folder holds no run, the config names something that is not allowed, or
            there is no checkpoint to resume from; see also `run_experiment`.
        UsageError: an override is wrong, or cannot be obeyed.
        StoppedError: on Ctrl-C.
    """
    overrides, trusted = split_trust(overrides)
    from zoo.checkpoints.checkpoint import read_checkpoint_file
    from zoo.runs.metrics_file import read_metrics_file
    from zoo.runs.run_record import Run, load_config
    from zoo.runs.status import read_status_file
    from zoo.training.interruptions import has_stopped_early

    refuse_links_out(folder)
    run = Run.open(folder)
    saved = load_config(folder)
    lead_from(run.started_in, saved)
    config, keys = overridden(saved, overrides)
    check_saved_config(config, folder / ".hydra" / "config.yaml", trusted, keys)
    if (last := folder / "checkpoints" / "last.ckpt").is_file():
        for key, (then, now) in unobeyed(_settled(saved), _settled(config)).items():
            raise UsageError(
                f"{' '.join(overrides)}: {key} was {then} in the finished epochs, and cannot be "
                f"{now} in the next ones; start a new run with model.weights={last}"
            )
    if read_status_file(folder).get("status") == "finished":
        metrics = read_metrics_file(folder)
        epochs = metrics.get("epochs") or 0
        moved = [k for k in LIMITS if saved.trainer.get(k) not in (None, config.trainer.get(k))]
        if not overrides or (_max_epochs(config) <= epochs and not moved):
            print(*map(printable, _finished_lines(folder, saved, metrics, overrides)), sep="\n")
            return
        if not last.is_file():
            raise InputError(
                f"{last}: missing, so the run cannot be resumed; start a new run with "
                f"model.weights={last.with_name('best.ckpt')}"
            )
        if has_stopped_early(read_checkpoint_file(last), _patience(config)):
            raise UsageError(
                f"{' '.join(overrides)}: early stopping ended the run after {epochs} epochs, and "
                f"would again; add {PATIENCE}=NUMBER, above {_patience(config)}, or {STOPPING}=null"
            )
    with loading():
        from zoo.training.run import run_experiment

    typed = _by_key(run.overrides) | _by_key(hydra_overrides(overrides)) if overrides else {}
    run_experiment(config, folder.resolve(), resume=True, typed=[*typed.values()])


def _by_key(overrides: list[str]) -> dict[str, str]:
    return {override.partition("=")[0].lstrip("+~"): override for override in overrides}


def _settled(config: DictConfig) -> dict[str, str]:
    """Return the values of a config by dotted key, as users type them, with what `quick` sets."""
    from zoo.training.run_config import with_quick

    return dict(typed_keys(plain_dict(with_quick(config))))


def lead_from(begin: Path | None, config: DictConfig) -> None:
    """Change the relative paths of a run's recording, which begin in another folder."""
    paths = trained_paths(plain_dict(config.data, resolve=False), begin)
    config.data.update(escape_interpolation(paths))


def _finished_lines(
    folder: Path, config: DictConfig, metrics: dict, overrides: list[str]
) -> Iterator[str]:
    """Yield the lines on a finished run: its files, and how to train it further."""
    epochs, most = metrics.get("epochs") or 0, _max_epochs(config)
    best, last = (folder / "checkpoints" / f"{name}.ckpt" for name in ("best", "last"))
    ignored = f" ({' '.join(overrides)}: no more epochs)" if overrides else ""
    early = f" of {most}" if epochs < most else ""
    yield f"{folder}: finished after {counted(epochs, 'epoch')}{early}; nothing to do{ignored}"
    if best.is_file():
        yield f"best checkpoint (after epoch {metrics.get('best_epoch')}): {best}"
    if (page := folder / "report" / "index.html").is_file():
        yield f"report: {page}"
    if last.is_file() and (keys := _further(config, epochs)):
        yield f"train further: {command_line(['drivezoo', 'train', f'resume={folder}', *keys])}"
    if best.is_file():
        yield f"or start a new run from its weights: model.weights={best}"


def _further(config: DictConfig, epochs: int) -> list[str]:
    """Return the overrides that train a finished run further; empty where none would be obeyed."""
    if epochs < _max_epochs(config):
        limits = [key for key in LIMITS if key in config.trainer]
        return [f"{STOPPING}=null"] if _patience(config) is not None and not limits else []
    keys = [f"trainer.max_epochs={2 * max(epochs, 1)}"]
    if config.quick:
        samples = _settled(config)["data.samples_per_epoch"]
        keys += ["quick=false", f"data.samples_per_epoch={samples}"]
    return [] if unobeyed(_settled(config), _settled(overridden(config, keys)[0])) else keys


def _patience(config: DictConfig) -> int | None:
    """Return for how many epochs early stopping waits; None without it."""
    settings = (config.callbacks or {}).get("early_stopping")
    return settings.get("patience", 3) if settings else None  # 3 is Lightning's default


def _max_epochs(config: DictConfig) -> float:
    """Return how many epochs a config asks for; infinity for a value that is no number."""
    from zoo.training.run_config import with_quick

    most = with_quick(config).trainer.max_epochs
    return most if isinstance(most, int | float) else float("inf")
