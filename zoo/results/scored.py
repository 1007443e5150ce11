"""What is ranked, found and read: a run, an evaluation, a result of the benchmark or a drive."""

import json
import math
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from zoo.base.command_keys import typed_keys
from zoo.base.errors import InputError
from zoo.driving.drive_log import LOG_NAME, SUMMARY_NAME, read_drive, read_summary
from zoo.driving.drive_record import EMBEDDED, REPLAY
from zoo.driving.metrics import leaderboard_metrics, measure
from zoo.results.result import NAME as RESULT_NAME
from zoo.runs.metrics_file import NAME as METRICS_NAME
from zoo.runs.metrics_file import read_metrics_file
from zoo.runs.run_record import Run, TrainedOn
from zoo.scoring.evaluate_options import EvaluateOptions
from zoo.scoring.evidence import source_of

BENCHMARK = "benchmark"  # source of drives on the roads of a suite
CLEAN = "drives_without_intervention"
LENGTHS = ("laps", "driven_m", "driven_s")  # figures beside the leaderboard's metrics
CURVES = ("train/loss", "val/mse", "drive/autonomy", "drive/cte_mean", "drive/score")
# Folders without runs inside; a recording would be slow to search.
SKIPPED = {"checkpoints", "plots", "drives", "recordings", "cache", "IMG", "report", "evaluation"}


@dataclass(frozen=True)
class Scored:
    """What is ranked: a finished run, an evaluation, a result of the benchmark or a drive.

    Attributes:
        name: name of the experiment, of the model or of the checkpoint.
        tracks: by track, the leaderboard's metrics and `LENGTHS`, each a mean over the drives; of
            levels, `BenchmarkResult.score` in place of the autonomy.
        counts: by track, number of drives without an intervention and of drives, where known.
        source: source of the drives, as in `Drive`, or BENCHMARK; empty without a drive.
        settings: what a run's repeats have in common, such as the config without the training
            seed; empty for what is not a run.
        overrides: overrides that the user typed, by key, without those of Hydra itself; settings of
            an evaluation that are not the usual ones; speed of a drive; code of a benchmark.
        seed: training seed.
        trainings: number of trainings that drove.
        precision: precision of the training; empty where it is unknown.
        code: first digits of the hash of the code that trained it; empty where it is unknown.
        trained_on: recordings of the training.
        wall_s: seconds of training; None for what is not a run.
        curves: by name (`val/mse`, `train/loss`, `drive/autonomy`), values by epoch from 1 on.
        car: other car of a run's recording; None for Udacity's.
    """

    folder: Path
    name: str
    tracks: dict[str, dict[str, float]]
    counts: dict[str, tuple[int, int]]
    source: str
    settings: str = ""
    overrides: dict[str, str] = field(default_factory=dict)
    seed: int | None = None
    trainings: int = 1
    precision: str = ""
    code: str = ""
    trained_on: TrainedOn = field(default_factory=TrainedOn)
    val_mse: float | None = None
    test_mse: float | None = None
    wall_s: float | None = None
    curves: dict[str, dict[int, float]] = field(default_factory=dict, repr=False)
    car: str | None = None

    def mean(self, key: str, tracks: Collection[str] = ()) -> float | None:
        """Return the mean of a figure over tracks, all if none is named; None if one lacks it."""
        driven = [figures for name, figures in self.tracks.items() if not tracks or name in tracks]
        values = [figures[key] for figures in driven if key in figures]
        return float(np.mean(values)) if values and len(values) == len(driven) else None


@dataclass(frozen=True)
class Unranked:
    """A run without figures.

    Attributes:
        why: `running`, `stopped`, `failed`, `pruned`, `older` or `damaged`.
        reason: details, such as the line of the error.
    """

    folder: Path
    why: str
    reason: str = ""


def run_folders(root: Path) -> Iterator[Path]:
    """Yield each run's folder: one with `status.json`, or with `metrics.json` and `.hydra`."""

    def is_run(folder: Path) -> bool:
        has_metrics = (folder / METRICS_NAME).is_file() and (folder / ".hydra").is_dir()
        return has_metrics or (folder / "status.json").is_file()

    return _folders(root, is_run, SKIPPED)


def drive_folders(root: Path) -> Iterator[Path]:
    """Yield the folders of evaluations, benchmarks and drives below a folder without runs."""
    if any(run_folders(root)):
        return iter(())
    return _folders(root, lambda folder: bool(_reader(folder)), SKIPPED - {"drives", "evaluation"})


def _folders(root: Path, is_found: Callable[[Path], bool], skipped: set[str]) -> Iterator[Path]:
    if is_found(root):
        yield root
        return
    for path in root.iterdir():
        if path.is_dir() and path.name not in skipped and not path.name.startswith("."):
            yield from _folders(path, is_found, skipped)


def read_scored(
    runs: Iterable[Path], drives: Iterable[Path] = ()
) -> tuple[list[Scored], list[Unranked]]:
    """Return what can be ranked, and the other folders with the reason.

    Args:
        runs: folders of runs.
        drives: folders of drives, evaluations and results of the benchmark.
    """
    jobs: list[tuple[Path, Callable[[Path], Scored | Unranked]]]
    jobs = [(folder, _ranked_run) for folder in runs]
    jobs += [(folder, _reader(folder) or load_evaluation) for folder in drives]
    entries = [_read(folder, load) for folder, load in jobs]
    scored = [entry for entry in entries if isinstance(entry, Scored)]
    return scored, [entry for entry in entries if isinstance(entry, Unranked)]


def _read(folder: Path, load: Callable[[Path], Scored | Unranked]) -> Scored | Unranked:
    try:
        return load(folder)
    except InputError as error:
        return Unranked(folder, "damaged", str(error).removeprefix(str(folder)).lstrip("/\\"))


def _ranked_run(folder: Path) -> Scored | Unranked:
    run = Run(folder)
    # A finished run that is being resumed keeps the figures of its finished epochs.
    has_figures = run.state == "finished" or "finished_epochs" in run.status
    if has_figures and (scored := load_run(folder)) is not None:
        return scored
    is_known = run.state in ("running", "stopped", "failed", "pruned")
    return Unranked(folder, run.state if is_known else "older", str(run.status.get("reason") or ""))


def finished_run(folder: Path) -> Scored | None:
    """Return a finished run; None where it has no figures or they are damaged."""
    try:
        return load_run(folder)
    except InputError:
        return None


def load_run(folder: Path) -> Scored | None:
    """Return a finished run; None where it has no open-loop figures.

    Raises:
        InputError: a file of the run is missing or cannot be read.
    """
    metrics = read_metrics_file(folder)
    if (open_loop := metrics.get("open_loop")) is None:
        return None
    run = Run(folder)
    for name, figures in run.tracks.items():
        for key in ("autonomy", "cte_mean_m"):
            if key not in figures:
                raise InputError(f"metrics.json: drive.tracks.{name}.{key}: is missing")
    return Scored(
        folder=folder,
        name=run.choices["experiment"] or metrics.get("model") or "?",
        settings=_settings(run),
        source=(REPLAY if run.replayed else EMBEDDED) if run.tracks else "",
        **_of_tracks(run.tracks),
        overrides=_typed(run),
        seed=metrics.get("seed"),
        precision=metrics.get("precision") or "",
        code=str((metrics.get("code") or {}).get("hash") or "")[:6],
        trained_on=run.trained_on,
        val_mse=open_loop.get("val", {}).get("mse"),
        test_mse=open_loop.get("test", {}).get("mse"),
        wall_s=float(metrics.get("wall_s") or 0),
        curves=run.curves(CURVES),
        car=source_of(metrics.get("data")),
    )


def load_drive(folder: Path) -> Scored:
    """Return a drive.

    Figures missing from `drive.json`, as after an interrupted drive, are computed from the log.

    Raises:
        InputError: a file of the drive cannot be read.
    """
    path = folder / SUMMARY_NAME
    summary = read_summary(path) if path.is_file() else {}
    if any(name not in summary for name in _shown()):
        summary = measure(read_drive(folder)) | summary
    figures = {
        name: float(summary[name])
        for name in _shown()
        if summary.get(name) is not None and math.isfinite(summary[name])
    }
    track = summary.get("track") or ", ".join(summary.get("recording") or []) or "unknown track"
    return Scored(
        folder=folder,
        name=str(summary.get("checkpoint") or "-"),
        tracks={track: figures},
        counts={track: (int(not figures.get("interventions")), 1)} if "autonomy" in figures else {},
        source=summary.get("drive") or "",
        overrides={"set_mph": f"{speed:g}"} if (speed := summary.get("set_mph")) else {},
    )


def load_evaluation(folder: Path) -> Scored:
    """Return the means over an evaluation's drives.

    Raises:
        InputError: `metrics.json` cannot be read, or is not that of an evaluation.
    """
    metrics = read_metrics_file(folder)
    tracks = {name: figures for name, figures in (metrics.get("tracks") or {}).items() if figures}
    if not tracks:
        raise InputError(f"{folder / METRICS_NAME}: tracks: is missing; name an evaluation")
    usual = dict(typed_keys(vars(EvaluateOptions())))
    return Scored(
        folder=folder,
        name=str(metrics.get("checkpoint") or "-"),
        overrides=dict(sorted((metrics.get("settings") or {}).items() - usual.items())),
        source=f"{metrics.get('world') or EMBEDDED} {metrics.get('quality') or ''}".strip(),
        **_of_tracks(tracks),
    )


def load_benchmark(folder: Path) -> Scored:
    """Return the figures of an entry of the benchmark.

    Its figures are those of all roads but the laps. The suite with the digest of its roads, and
    what is usual in it, stands for the track.

    Raises:
        InputError: `result.json` cannot be read.
    """
    from zoo.results.checked_result import read_result
    from zoo.results.suite import OVERALL
    from zoo.results.summary import drives_of

    result = read_result(folder)
    records = drives_of(result.drives, OVERALL) or result.drives
    drives = [record.figures | {"without_intervention": record.is_clean} for record in records]
    figures = {
        name: sum(float(drive[name] or 0) for drive in drives) / len(drives)
        for name in (result.score, "cte_mean_m", "interventions", "driven_s")
    }
    suite = " ".join(map(str, [result.suite, result.roads[:6], *result.usual.values()]))
    return Scored(
        folder=folder,
        name=result.entry,
        tracks={suite: figures},
        counts={suite: (sum(record.is_clean for record in records), len(drives))},
        source=BENCHMARK,
        overrides={"code": str(result.code.get("hash"))[:6]},
        trainings=sum(driver.sha256 is not None for driver in result.checkpoints),
    )


# By the file that a folder has; the first counts.
READERS = {LOG_NAME: load_drive, RESULT_NAME: load_benchmark, METRICS_NAME: load_evaluation}


def _reader(folder: Path) -> Callable[[Path], Scored] | None:
    return next((read for name, read in READERS.items() if (folder / name).is_file()), None)


def _shown() -> list[str]:
    """Return the names of the figures of a track that are read."""
    return [*(metric.name for metric in leaderboard_metrics()), *LENGTHS]


def _of_tracks(tracks: dict[str, dict]) -> dict:
    """Return the fields of `Scored` that follow from the figures of tracks, without deviations."""
    means = {
        name: {key: float(figures[key][0]) for key in _shown() if figures.get(key)}
        for name, figures in tracks.items()
    }
    pairs = {name: (figures.get(CLEAN), figures.get("drives")) for name, figures in tracks.items()}
    return {
        "tracks": means,
        "counts": {name: pair for name, pair in pairs.items() if None not in pair},
    }


def _settings(run: Run) -> str:
    """Return config and recordings as text, equal for repeats of a run."""
    config = {key: value for key, value in run.config.items() if key != "seed"}
    # A search adds this callback to each trial; it holds the trial's number.
    # The fingerprint identifies a recording, wherever its folder was moved to.
    for section, ignored in (("callbacks", "pruning"), ("data", "root")):
        if isinstance(inner := config.get(section), dict):
            config[section] = {key: value for key, value in inner.items() if key != ignored}
    return json.dumps([config, run.trained_on.fingerprint or run.trained_on.roots], sort_keys=True)


def _typed(run: Run) -> dict[str, str]:
    """Return the typed overrides by key."""
    pairs = [override.lstrip("+~").partition("=") for override in run.overrides]
    return {
        # Hydra takes these words in capitals, too.
        key: value.lower() if value.lower() in ("true", "false", "null") else value
        for key, _, value in pairs
        if not key.startswith(("hydra", "callbacks.pr"))
    }
