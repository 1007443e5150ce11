"""The networks that come trained: their checkpoints, facts and drives."""

import hashlib
import shlex

from benchmarks.board_rows import Row
from benchmarks.study_grid import Entry, Study, run_logged
from zoo.base.whole_file import json_text, write_whole
from zoo.runs.metrics_file import read_metrics_file


def pretrained_rows(study: Study, entry: Entry) -> list[Row]:
    """Write the checkpoint and the facts of a network, and drive it; the facts are its rows.

    Raises:
        InputError: the drives failed.
    """
    from zoo.benchmark.checked_result import read_result
    from zoo.checkpoints.checkpoint import build_checkpoint, read_checkpoint_file
    from zoo.checkpoints.checkpoint_path import PACKAGED, packaged_names
    from zoo.checkpoints.new_checkpoint import checkpoint_bytes, lean_contents

    for run in entry.finished:
        metrics, path = read_metrics_file(run), run / "checkpoints" / "best.ckpt"
        contents = lean_contents(read_checkpoint_file(path))
        # From `data.record`, a further training records what this one was trained on.
        contents["drivezoo"]["config"]["data"]["root"] = None
        checkpoint, data = build_checkpoint(contents, path), checkpoint_bytes(contents)
        packaged = PACKAGED / f"{entry.name}.ckpt"
        write_whole(packaged, data)
        sha256, laps = hashlib.sha256(data).hexdigest(), study.config["laps"]
        folder, workers = entry.folder / sha256[:8], f"workers={study.options.threads}"
        evaluate = ["zoo.evaluate", str(packaged), "track=lake", f"seeds={laps}"]
        benchmark = ["zoo.benchmark", str(packaged), "suite=quick", f"entry={entry.name}"]
        for name, words in (("lake", evaluate), ("quick", benchmark)):
            if not list((folder / name).glob("*.json")):
                run_logged(folder / f"{name}.txt", [*words, workers, f"out={folder / name}"], 1)
        figures = read_metrics_file(folder / "lake")["tracks"]["lake"]
        result = read_result(folder / "quick")
        facts = {
            "network": type(checkpoint.network).__name__,
            "parameters": metrics["parameters"],
            "bytes": len(data),
            "sha256": sha256,
            "licence": "MIT",
            "command": shlex.join(["drivezoo", "train", *study.command(entry)]),
            "data": checkpoint.data,
            "code": metrics["code"],
            "versions": metrics["versions"],
            "drives": {
                "lake": {
                    "command": f"drivezoo evaluate {entry.name} track=lake seeds={laps}",
                    "drives": figures["drives"],
                    "kept": figures["drives_without_intervention"],
                    "autonomy": figures["autonomy"][0],
                    "cte_mean_m": figures["cte_mean_m"][0],
                },
                "unseen": {
                    "command": f"drivezoo benchmark {entry.name} suite=quick",
                    "drives": len(result.drives),
                    "kept": sum(not drive.figures["interventions"] for drive in result.drives),
                    "headline": result.headline.model_dump(),
                    "digest": result.digest,
                },
            },
        }
        write_whole(PACKAGED / f"{entry.name}.json", json_text(facts))
        packaged_names.cache_clear()
    return []
