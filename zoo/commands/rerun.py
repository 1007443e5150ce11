"""`drivezoo rerun`: repeat a run and compare the figures."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from zoo.base.child_process import run_module
from zoo.base.command import command
from zoo.base.compose import escape_interpolation
from zoo.base.errors import InputError, StoppedError, file_errors
from zoo.base.new_folder import command_folder, dated_folder
from zoo.base.parts import typed_parts
from zoo.base.terminal import command_line, print_written
from zoo.base.whole_file import refuse_links_out
from zoo.checkpoints.checkpoint_path import find_run
from zoo.runs.saved_config import TRUST, check_saved_config, split_trust
from zoo.training.host_settings import AUTO, FULL, HALF
from zoo.training.resume import lead_from

# Keys of metrics.json that are compared; times differ by machine.
COMPARED = (
    *("model", "parameters", "epochs", "best_epoch", "train_samples", "open_loop", "baselines"),
    *("side_response", "drive", "closed_loop", "choice", "leak", "data"),
)
Difference = tuple[str, object, object]  # key in metrics.json, and its values then and now
CONFIG = ".hydra/config.yaml"
TIMED = ("latency_ms", "in_training")


@command
def rerun(run: str, *, out: str | None = None, trust: str = "") -> None:
    """Repeat a run and compare the figures.

    Trains a finished run again with the config in its folder, and compares every figure of
    metrics.json to the digit.

    Args:
        run: run's folder, or latest: the newest below outputs.
        out: folder of the repeated run; null: named by date and time.
        trust: further classes and keys that the run's config may name, separated by commas.

    Raises:
        InputError: the run is not finished, its config names a class that is not trusted, its
            recording changed, or `out` is not empty; or figures differ, after they are printed.
        StoppedError: on Ctrl-C; names the command that resumes.
    """
    source = find_run(run)
    if not (source / "metrics.json").is_file() or not (source / CONFIG).is_file():
        raise InputError(f"{source}: has no metrics.json or {CONFIG}; name a finished run")
    from zoo.runs.metrics_file import read_metrics_file

    refuse_links_out(source)
    then = read_metrics_file(source)
    _, trusted = split_trust([f"{TRUST}={trust}"])
    config = _trained_config(source)
    lead_from(place_of(source), config)
    check_saved_config(config, source, trusted)
    is_auto = OmegaConf.select(config, "trainer.precision") == AUTO
    if is_auto and then.get("precision") in (FULL, HALF):
        config.trainer.precision = then["precision"]  # configs of older versions say auto
    folder = Path(out or dated_folder("reruns")).resolve()
    saved, text = folder / CONFIG, OmegaConf.to_yaml(config)
    begun = saved.is_file() and saved.read_text(encoding="utf-8", errors="replace") == text
    begun = begun and not (folder / "metrics.json").exists()
    with command_folder(folder, "reruns", resumed_by=CONFIG if begun else ""):
        if not begun:
            with file_errors(f"out={folder}", "cannot write there ({})"):
                shutil.copytree(source / ".hydra", folder / ".hydra")
                saved.write_text(text, encoding="utf-8")
        try:
            _train(folder, place_of(source), trusted, then.get("threads"))
        except StoppedError:
            keys = [f"out={folder}", *([f"{TRUST}={trust}"] if trust else [])]
            again = f"resume and compare with: {command_line(['drivezoo', 'rerun', source, *keys])}"
            raise StoppedError(f"stopped; {again}") from None
        _report(then, read_metrics_file(folder), folder)


def differences(then: object, now: object, name: str = "") -> tuple[list[Difference], int]:
    """Return the figures that differ between two `metrics.json`, and the number compared.

    >>> differences({"a": 1, "b": {"c": 2}}, {"a": 1, "b": {"c": 3}})
    ([('b.c', 2, 3)], 2)
    """
    if isinstance(then, dict) and isinstance(now, dict):
        keys = [key for key in {**then, **now} if key not in TIMED]
        children = [(str(key), then.get(key), now.get(key)) for key in keys]
    elif isinstance(then, list | tuple) and isinstance(now, list | tuple) and len(then) == len(now):
        children = [(str(index), *pair) for index, pair in enumerate(zip(then, now, strict=True))]
    else:
        return ([] if then == now else [(name, then, now)]), 1
    pairs = [
        differences(before, after, f"{name}.{key}" if name else key)
        for key, before, after in children
    ]
    return [pair for differing, _ in pairs for pair in differing], sum(count for _, count in pairs)


def place_of(run: Path) -> Path:
    """Return the folder where a run was started, at which its relative paths begin."""
    from zoo.runs.run_record import Run

    folder = Run(run).started_in
    return folder if folder is not None and folder.is_dir() else Path.cwd()


def _trained_config(run: Path) -> DictConfig:
    """Return the config in a run's checkpoint, which a later `resume=` did not change."""
    from zoo.runs.run_record import load_config

    config = load_config(run)
    last = run / "checkpoints" / "last.ckpt"
    if last.is_file():
        from zoo.checkpoints.checkpoint import check_card, read_checkpoint_file

        card = read_checkpoint_file(last)["drivezoo"]
        check_card(card, last)
        config = OmegaConf.create(escape_interpolation(card["config"]))
    if OmegaConf.select(config, "callbacks.pruning"):
        del config.callbacks["pruning"]  # belongs to a search that has ended
    return config


def _train(out: Path, place: Path, trusted: Sequence[str], threads: int | None) -> None:
    """Train the run in `out` with the same number of threads, on which sums depend.

    The process runs in `place`, where relative paths begin; it imports nothing from there.
    """
    words = typed_parts() if place == Path.cwd() else []  # printed; their paths begin here
    if trusted:
        words.append(f"{TRUST}={','.join(trusted)}")
    variables = {"OMP_NUM_THREADS": str(threads)} if threads else {}
    if run_module("zoo", f"resume={out}", *words, env=variables, cwd=place):
        raise InputError(f"{out}: the repeated run failed (see above)")


def _report(then: dict, now: dict, out: Path) -> None:
    for package, number in (then.get("versions") or {}).items():
        if (other := now["versions"].get(package)) != number:
            print(f"version of {package}: {number} then, {other} now")
    if then.get("code") and then["code"]["hash"] != now["code"]["hash"]:
        print(f"the code differs: {_code(then['code'])} then, {_code(now['code'])} now")
    for key in ("threads", "precision"):
        if then.get(key) != now.get(key):
            print(f"{key}: {then.get(key)} then, {now.get(key)} now")
    keys = [key for key in COMPARED if key in then]  # of an older version
    before, after = ({key: figures.get(key) for key in keys} for figures in (then, now))
    differing, count = differences(before, after)
    for name, *values in differing:
        print(f"{name}: {values[0]} then, {values[1]} now")
    if not differing:
        print(f"equal: all {count} figures, to the digit")
    print_written([out], [] if differing else ["report", out])
    if differing:
        raise InputError(f"{len(differing)} of {count} figures differ")


def _code(code: dict) -> str:
    commit = f" (commit {code['commit']})" if code.get("commit") else ""
    return f"{code['hash']}{commit}"


if __name__ == "__main__":
    rerun.run()
