"""The top of a report: the verdict, a summary and the main figures."""

from zoo.evaluate.drives_table import with_deviation
from zoo.report.blocks import Block, Box, Missing, Text, Tiles
from zoo.report.reported_run import ReportedRun
from zoo.verdict.evidence import evidence_of_run
from zoo.verdict.judgement import judge


def title(run: ReportedRun) -> str:
    """Return the report's title: the experiment's name, or the model's."""
    name = run.choices.get("experiment") or run.config["model"]["name"]
    return f"{name}, quick" if run.config.get("quick") else str(name)


def headline(run: ReportedRun) -> list[Block]:
    """Return the verdict, a summary, and the figures of driving and of the open loop."""
    blocks = [] if run.ended_early else [_verdict(run)]
    trained_on = ", ".join(run.trained_on.roots) or "an unknown recording"
    name = run.config["model"]["name"]
    blocks.append(Text(f"{name} steers a car from camera images. Trained on: {trained_on}."))
    if run.ended_early:
        blocks.append(Missing(run.ended_early))
    tiles = main_figures(run)
    return [*blocks, Tiles(tiles)] if tiles else blocks


def _verdict(run: ReportedRun) -> Block:
    evidence = evidence_of_run(run.folder, run.config, run.metrics)
    verdict = judge([drive.summary for drive in run.drives], evidence, replayed=run.replayed)
    lines = [*verdict.tracks, verdict.certainty]
    lines += ["Likely causes:"] if verdict.causes else []
    return Box(verdict.level, verdict.headline, lines, verdict.causes, verdict.commands)


def main_figures(run: ReportedRun) -> list[tuple[str, str, str]]:
    """Return name, value and details of the figures: first those of driving."""
    first, second = [], []
    for track, figures in run.tracks.items():
        drives, clean = figures.get("drives"), figures.get("drives_without_intervention")
        laps, driven_s = figures.get("laps"), figures.get("driven_s")
        how_far = f"{laps[0]:.2f} laps" if laps else f"{driven_s[0]:.0f} s" if driven_s else "?"
        details = f"interventions: {figures['interventions'][0]:.3g} in {how_far}"
        if drives and clean is not None:
            details += f" (means); drives without intervention: {clean} of {drives}"
        autonomy = with_deviation(figures["autonomy"], "{:.1%}", drives)
        first.append((f"Autonomy, {track}", autonomy, details))
        error = f"{figures['cte_mean_m'][0]:.2f} m"
        most = f"{figures['cte_max_m'][0]:.2f} m"
        second.append((f"Cross-track error, {track}", error, f"on average; maximum: {most}"))
    found = run.metrics.get("open_loop") or {}
    if part := next((one for one in ("test", "val") if one in found), None):
        zero = run.metrics["baselines"][part]["always zero"]
        for label, key, form in (("MSE", "mse", ".4f"), ("balanced MAE", "balanced_mae", ".3f")):
            value = f"{found[part][key]:{form}}"
            second.append((f"{part.title()} {label}", value, f"always zero: {zero[key]:{form}}"))
    return first + second
