"""The top of a report: the verdict, a summary and the main figures."""

from zoo.evaluate.drives_table import with_deviation
from zoo.report.blocks import Block, Box, Missing, MissingError, Text, Tile, Tiles
from zoo.report.reported_run import ReportedRun
from zoo.verdict.evidence import evidence_of_run
from zoo.verdict.judgement import ALMOST, DRIVES, FAILS, UNKNOWN, judge

KINDS = {DRIVES: "good", ALMOST: "warn", FAILS: "bad", UNKNOWN: "warn"}


def title(run: ReportedRun) -> str:
    """Return the report's title: the experiment's name, or the model's."""
    name = run.choices.get("experiment") or run.config["model"]["name"]
    return f"{name}, quick" if run.config.get("quick") else str(name)


def headline_blocks(run: ReportedRun) -> list[Block]:
    """Return the verdict, a summary, and the figures of driving and of the open loop."""
    blocks: list[Block] = [*_verdict(run), Text(_what(run))]
    if run.ended_early:
        blocks.append(Missing(run.ended_early))
    tiles = [*_driving(run), *_open_loop(run)]
    return blocks + ([Tiles(tiles)] if tiles else [])


def _verdict(run: ReportedRun) -> list[Block]:
    """Return a box with the verdict; nothing for a run that has not finished."""
    if not run.metrics or run.ended_early:
        return []
    evidence = evidence_of_run(run.folder, run.config, run.metrics)
    verdict = judge([one.summary for one in run.drives], evidence)
    lines = [*verdict.tracks, verdict.certainty]
    lines += ["Likely causes:"] if verdict.causes else []
    return [
        Box(
            KINDS[verdict.level],
            verdict.headline,
            lines,
            list(verdict.causes),
            list(verdict.commands),
        )
    ]


def _what(run: ReportedRun) -> str:
    metrics, root = run.metrics, run.config["data"].get("root")
    size = f" with {metrics['parameters']:,} parameters" if metrics else ""
    summary = f"A network that steers a car from camera images: {run.config['model']['name']}{size}"
    try:
        root = root or list(run.recording.names)
    except MissingError:
        root = "an unknown recording"
    summary += ", trained on " if metrics else ", to be trained on "
    summary += f"{root if isinstance(root, str) else ', '.join(root)}"
    if metrics:
        rows, epochs = metrics["data"]["split"]["train"], metrics["epochs"]
        summary += f" ({rows:,} training rows, {epochs} epoch{'' if epochs == 1 else 's'})"
    return f"{summary}."


def _driving(run: ReportedRun) -> list[Tile]:
    scored = run.metrics.get("drive") or {}
    speed = f" at {scored['speed_mph']:g} mph" if scored.get("speed_mph") else ""
    first, second = [], []
    for track, figures in run.tracks.items():
        count = figures.get("drives")
        lost, laps = figures["interventions"][0], figures["laps"][0]
        note = "per drive: " if (count or 1) > 1 else ""
        note += f"{lost:.3g} interventions in {laps:.2f} laps{speed}"
        if figures.get("drives_without_intervention") is not None:
            kept = figures["drives_without_intervention"]
            note += f"; drives without intervention: {kept} of {count}"
        autonomy = with_deviation(figures["autonomy"], "{:.1%}", count)
        first.append(Tile(f"Autonomy, {track}", autonomy, note))
        second.append(
            Tile(
                f"Cross-track error, {track}",
                f"{figures['cte_mean_m'][0]:.2f} m",
                f"on average; {run.farthest_m(track):.2f} m at most",
            )
        )
    return first + second


def _open_loop(run: ReportedRun) -> list[Tile]:
    found = run.metrics.get("open_loop") or {}
    part = next((one for one in ("test", "val") if one in found), None)
    if part is None:
        return []
    zero = run.metrics["baselines"][part]["always zero"]
    name = {"test": "Test", "val": "Validation"}[part]
    return [
        Tile(f"{name} MSE", f"{found[part]['mse']:.4f}", f"always zero: {zero['mse']:.4f}"),
        Tile(
            f"{name} MAE, balanced",
            f"{found[part]['balanced_mae']:.3f}",
            f"always zero: {zero['balanced_mae']:.3f}",
        ),
    ]
