"""`drivezoo train resume=FOLDER`: resume a stopped run, or train a finished run further."""

from collections.abc import Iterator
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from zoo.base.errors import InputError
from zoo.base.parts import typed_parts
from zoo.base.terminal import command_line
from zoo.base.whole_file import refuse_links_out
from zoo.checkpoints.checkpoint_path import trained_paths
from zoo.cli.compose import escape_interpolation
from zoo.cli.console_progress import loading
from zoo.runs.saved_config import check_saved_config, overridden, split_trust


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
    from zoo.runs.metrics_file import read_metrics_file
    from zoo.runs.run import Run, load_config
    from zoo.runs.status import read_status_file

    refuse_links_out(folder)
    saved = load_config(folder)
    lead_from(Run(folder).started_in, saved)
    config, typed = overridden(saved, overrides)
    check_saved_config(config, saved_path, trusted, typed)
    if read_status_file(folder).get("status") == "finished":
        metrics = read_metrics_file(folder)
        epochs, last = metrics.get("epochs") or 0, folder / "checkpoints" / "last.ckpt"
        if not overrides or _max_epochs(config) <= epochs:
            print("\n".join(_finished_lines(folder, saved, metrics, overrides)))
            return
        if not last.is_file():
            raise InputError(
                f"{last}: missing, so the run cannot be resumed; start a new run with "
                f"model.weights={last.with_name('best.ckpt')}"
            )
    with loading():
        from zoo.training.run import run_experiment

    run_experiment(config, folder.resolve(), resume=True, keep_config=bool(overrides))


def lead_from(begin: Path | None, config: DictConfig) -> None:
    """Change the relative paths of a run's recording, which begin in another folder."""
    paths = trained_paths(OmegaConf.to_container(config.data), begin)
    config.data.update(escape_interpolation(paths))


def _finished_lines(
    folder: Path, config: DictConfig, metrics: dict, overrides: list[str]
) -> Iterator[str]:
    """Yield the lines on a finished run: its files, and how to train it further."""
    epochs, most = metrics.get("epochs") or 0, _max_epochs(config)
    best, last = (folder / "checkpoints" / f"{name}.ckpt" for name in ("best", "last"))
    page = folder / "report" / "index.html"
    ignored = f" ({' '.join(overrides)}: no more epochs)" if overrides else ""
    early = f" of {most}, stopped early" if epochs < most else ""
    yield f"{folder}: finished after {epochs} epochs{early}; nothing to do{ignored}"
    if best.is_file():
        yield f"best checkpoint (after epoch {metrics.get('best_epoch')}): {best}"
    if page.is_file():
        yield f"report: {page}"
    if last.is_file():
        more = ["callbacks.early_stopping=null"] * bool(early)
        more += ["quick=false"] * bool(config.quick and not early)
        more += [f"trainer.max_epochs={2 * max(epochs, 1)}"] * (not early)
        command = ["drivezoo", "train", f"resume={folder}", *more, *typed_parts()]
        yield f"train further: {command_line(command)}"
    if best.is_file():
        yield f"or start a new run from its weights: model.weights={best}"


def _max_epochs(config: DictConfig) -> float:
    """Return how many epochs a config asks for; infinity for a value that is no number."""
    from zoo.training.run_config import with_quick

    most = with_quick(config).trainer.max_epochs
    return most if isinstance(most, int | float) else float("inf")
