"""Make the networks that come trained: `python benchmarks/pretrained.py [only=lenet]`.

It trains each network's recipe with training seed 1 on `data=bench_v1`, and writes
the checkpoint without optimizer into `zoo/checkpoints/packaged`, with a JSON file of what it is.
Then it drives laps of the embedded lake and the suite `quick`, whose roads no training contains,
and writes the table of `docs/pretrained.md`. Finished trainings and drives are not repeated.
`train=false` writes and drives what is trained, `drive=false` only trains, `runs=false` writes the
table alone.
"""

import hashlib
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

from benchmarks.board import entries, recorded_root
from benchmarks.board_page import DATA
from benchmarks.marked_page import markdown_table, write_between
from benchmarks.recipes import BENDS
from benchmarks.results import run_logged, train_logged
from simulator.command_line import read_options
from zoo.base.errors import InputError
from zoo.base.whole_file import json_text, write_whole
from zoo.benchmark.checked_result import read_result
from zoo.checkpoints.checkpoint import build_checkpoint, read_checkpoint_file
from zoo.checkpoints.lean_checkpoint import checkpoint_bytes, lean_contents
from zoo.checkpoints.packaged_networks import FOLDER, packaged_names, read_facts
from zoo.drives.intervals import count_with_interval
from zoo.runs.metrics_file import read_metrics_file

NAMES = ("linear", "tiny41", "tiny63", "lenet", "pilotnet")
RUNS = Path("outputs/pretrained")
PAGE, BEGIN, END = Path("docs/pretrained.md"), "<!-- pretrained -->", "<!-- end of pretrained -->"
SUITE = "quick"


@dataclass(frozen=True)
class PretrainedOptions:
    """Options of the script.

    Args:
        only: names of networks, separated by commas; null: all.
        seeds: number of start seeds on the lake.
        threads: number of OpenMP threads of a training, and of processes that drive.
        train: whether to train what is missing.
        drive: whether to drive.
        runs: whether to train and drive; false writes the table alone.
    """

    only: str | None = None
    seeds: int = 3
    threads: int = 2
    train: bool = True
    drive: bool = True
    runs: bool = True


def recipes() -> dict[str, tuple[str, ...]]:
    """Return the overrides of `drivezoo train`: the board's, and a shorter recipe for LeNet."""
    board = entries()
    lenet = ("experiment=lenet", BENDS, "schedule=cosine", "callbacks.early_stopping=null")
    return {
        "linear": board["linear-ours_21_numbers"],
        "tiny41": board["tiny41-no_bonnet"],
        "tiny63": board["tiny63-no_bonnet"],
        "lenet": (*lenet, "data.samples_per_epoch=8000", "trainer.max_epochs=6"),
        "pilotnet": board["pilotnet-with_bends"],
    }


def train(name: str, root: str, threads: int) -> None:
    """Train a network unless it is trained; raise InputError if that fails."""
    folder = RUNS / name
    words = [*recipes()[name], f"data={DATA}", f"data.root={root}", "score=none", "seed=1"]
    if not (folder / "metrics.json").is_file() and train_logged(folder, words, threads):
        raise InputError(f"{folder}: the training failed; see its log.txt")


def package(name: str) -> None:
    """Write a trained network's checkpoint and its facts.

    Raises:
        InputError: its training has not finished.
    """
    run = RUNS / name
    metrics = read_metrics_file(run)
    path = run / "checkpoints" / "best.ckpt"
    contents = lean_contents(read_checkpoint_file(path))
    # From `data.record`, a further training records what this one was trained on.
    contents["drivezoo"]["config"]["data"]["root"] = None
    checkpoint = build_checkpoint(contents, path)
    data = checkpoint_bytes(contents)
    sha256 = hashlib.sha256(data).hexdigest()
    before = read_facts(name) if name in packaged_names() else {}
    write_whole(FOLDER / f"{name}.ckpt", data)
    words = [*recipes()[name], f"data={DATA}", "score=none", "seed=1"]
    facts = {
        "network": type(checkpoint.network).__name__,
        "parameters": metrics["parameters"],
        "bytes": len(data),
        "sha256": sha256,
        "licence": "MIT",
        "command": shlex.join(["drivezoo", "train", *words]),
        "data": checkpoint.data,
        "code": metrics["code"],
        "versions": metrics["versions"],
        "drives": before.get("drives", {}) if before.get("sha256") == sha256 else {},
    }
    write_whole(FOLDER / f"{name}.json", json_text(facts))


def drive(name: str, options: PretrainedOptions) -> None:
    """Drive a packaged network unless it was driven, and add the figures to its facts.

    Raises:
        InputError: the drives failed.
    """
    facts = read_facts(name)
    folder = RUNS / f"{name}-{facts['sha256'][:8]}"
    checkpoint = str(FOLDER / f"{name}.ckpt")
    lake, suite = folder / f"lake-{options.seeds}", folder / SUITE
    workers = f"workers={options.threads}"
    laps = [checkpoint, "track=lake", f"seeds={options.seeds}", f"out={lake}", workers]
    roads = [checkpoint, f"suite={SUITE}", f"entry={name}", f"out={suite}", workers]
    jobs = {
        lake / "metrics.json": ["zoo.evaluate", *laps],
        suite / "result.json": ["zoo.benchmark", *roads],
    }
    for result, words in jobs.items():
        log = folder / f"{result.parent.name}.txt"
        if not result.is_file() and run_logged(log, words, 1):
            raise InputError(f"{result.parent}: the drives failed; see {log}")
    figures = read_metrics_file(lake)["tracks"]["lake"]
    result = read_result(suite)
    facts["drives"] = {
        "lake": {
            "command": f"drivezoo evaluate {name} track=lake seeds={options.seeds}",
            "drives": figures["drives"],
            "kept": figures["drives_without_intervention"],
            "autonomy": figures["autonomy"][0],
            "cte_mean_m": figures["cte_mean_m"][0],
        },
        "unseen": {
            "command": f"drivezoo benchmark {name} suite={SUITE}",
            "drives": len(result.drives),
            "kept": sum(not one.figures["interventions"] for one in result.drives),
            "headline": result.headline.model_dump(),
            "digest": result.digest,
        },
    }
    write_whole(FOLDER / f"{name}.json", json_text(facts))
    print(f"{name}: driven", flush=True)


def write_page() -> None:
    """Write the table of the packaged networks."""
    head = ["network", "parameters", "file", "laps of the lake without intervention"]
    head += ["lake: autonomy", "lake: mean error, m", "unseen roads without intervention (95 %)"]
    head += ["unseen: autonomy (95 %)"]
    rows = []
    for name in sorted(packaged_names(), key=lambda one: read_facts(one)["parameters"]):
        facts = read_facts(name)
        size = f"{facts['bytes'] / 1000:,.0f} kB"
        rows.append([f"`{name}`", f"{facts['parameters']:,}", size, *_driven(facts["drives"])])
    write_between(PAGE, BEGIN, END, markdown_table(head, rows))
    print(PAGE)


def _driven(drives: dict) -> list[str]:
    if not drives:
        return ["not measured yet"] * 5
    lake, unseen = drives["lake"], drives["unseen"]
    value, low, high = (100 * unseen["headline"][key] for key in ("value", "low", "high"))
    return [
        f"{lake['kept']} of {lake['drives']}",
        f"{lake['autonomy']:.1%}",
        f"{lake['cte_mean_m']:.2f}",
        count_with_interval(unseen["kept"], unseen["drives"]),
        f"{value:.1f} % ({low:.1f} to {high:.1f})",
    ]


def main(arguments: list[str]) -> None:
    """Train, package and drive, then write the table.

    Raises:
        InputError: an option is wrong, or a training or a drive failed.
    """
    options = read_options(PretrainedOptions, arguments)
    names = options.only.split(",") if options.only else list(NAMES)
    if unknown := set(names) - set(NAMES):
        raise InputError(f"only={options.only}: no network {min(unknown)}: {', '.join(NAMES)}")
    if options.runs and options.train:
        root = recorded_root()
        for name in names:
            train(name, root, options.threads)
    if options.runs:
        for name in names:
            package(name)
        packaged_names.cache_clear()
        for name in names if options.drive else ():
            drive(name, options)
    packaged_names.cache_clear()
    write_page()


if __name__ == "__main__":
    from zoo.cli.run_command import run_command

    sys.exit(run_command("pretrained", main, sys.argv[1:]))
