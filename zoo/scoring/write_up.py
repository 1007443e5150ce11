"""Write a run's report as HTML and Markdown from the same sections, and its first section."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from zoo.base.errors import InputError, file_errors
from zoo.base.whole_file import refuse_links_out, write_whole
from zoo.driving.drives_table import figure_text
from zoo.runs.metrics_file import NAME
from zoo.runs.page import last_folders
from zoo.runs.run_record import HYDRA
from zoo.scoring import blocks, data_section, drive_section, training_section
from zoo.scoring.evidence import evidence_of_run
from zoo.scoring.reported_run import ReportedDrives, ReportedEvaluation, ReportedRun
from zoo.scoring.verdict import Verdict, judge

FOLDER, PAGE, MARKDOWN = "report", "index.html", "report.md"
Part = Callable[[Any], list[blocks.Block]]


def headline(run: ReportedRun) -> list[blocks.Block]:
    """Return the verdict, a summary, and the figures of driving and of the open loop."""
    shown = [] if run.ended_early else [_verdict(run)]
    trained_on = ", ".join(map(last_folders, run.trained_on.roots)) or "an unknown recording"
    name = run.config["model"]["name"]
    shown.append(blocks.Text(f"{name} steers a car from camera images. Trained on: {trained_on}."))
    if run.ended_early:
        shown.append(blocks.Missing(run.ended_early))
    tiles = main_figures(run)
    return [*shown, blocks.Tiles(tiles)] if tiles else shown


def evaluated(run: ReportedEvaluation) -> list[blocks.Block]:
    """Return the verdict of an evaluation, and its figures."""
    return [_box(Verdict(**(run.metrics.get("verdict") or {}))), blocks.Tiles(main_figures(run))]


def perturbed(run: ReportedEvaluation) -> list[blocks.Block]:
    """Return the curves of an evaluation's perturbations; nothing without any."""
    if not run.metrics.get("perturbed"):
        return []
    caption = "Autonomy and mean cross-track error over each quantity, changed alone."
    image = blocks.Image.read(run.folder / "robustness.png", caption)
    return [blocks.Heading("Perturbations"), blocks.Images([image])]


def _verdict(run: ReportedRun) -> blocks.Block:
    evidence = evidence_of_run(run.folder, run.config, run.metrics)
    return _box(judge([drive.summary for drive in run.drives], evidence, replayed=run.replayed))


def _box(verdict: Verdict) -> blocks.Block:
    lines = [*verdict.tracks, verdict.certainty]
    lines += ["Likely causes:"] if verdict.causes else []
    return blocks.Box(verdict.level, verdict.headline, lines, verdict.causes, verdict.commands)


def main_figures(run: ReportedDrives) -> list[tuple[str, str, str]]:
    """Return name, value and details of the figures: first those of driving."""
    first, second = [], []
    for track, figures in run.tracks.items():
        drives, clean = figures.get("drives"), figures.get("drives_without_intervention")
        laps, driven_s = figures.get("laps"), figures.get("driven_s")
        how_far = f"{laps[0]:.2f} laps" if laps else f"{driven_s[0]:.0f} s" if driven_s else "?"
        details = f"interventions: {figures['interventions'][0]:.3g} in {how_far}"
        if drives and clean is not None:
            details += f" (means); drives without intervention: {clean} of {drives}"
        autonomy = figure_text(figures, "autonomy", "{:.1%}", drives)
        first.append((f"Autonomy, {track}", autonomy, details))
        keys = "cte_mean_m", "cte_max_m"
        error, most = (figure_text(figures, key, "{:.2f} m", drives) for key in keys)
        second.append((f"Cross-track error, {track}", error, f"on average; maximum: {most}"))
    figures = {} if first else run.metrics.get("open_loop") or {}  # driving is what counts
    if part := next((name for name in ("test", "val") if name in figures), None):
        zero = run.metrics["baselines"][part]["always zero"]
        for label, key, form in (("MSE", "mse", ".4f"), ("balanced MAE", "balanced_mae", ".3f")):
            value = f"{figures[part][key]:{form}}"
            second.append((f"{part.title()} {label}", value, f"always zero: {zero[key]:{form}}"))
    return first + second


DRIVING = drive_section.scores, drive_section.infractions, drive_section.tracks
OF_EVALUATION: dict[str, Sequence[Part]] = {
    "Headline": (evaluated,),
    "Driving": (*DRIVING, perturbed),
}
SECTIONS: dict[str, Sequence[Part]] = {
    "Headline": (headline,),
    # With the film, which readers look for.
    "Driving": DRIVING,
    "Data": (
        data_section.recordings,
        data_section.split,
        data_section.balance,
        data_section.cameras,
        data_section.flipped,
        data_section.recovery,
        data_section.fed,
    ),
    "Network": (training_section.layers_table,),
    "Training": (training_section.duration, training_section.curves),
    "Open loop": (training_section.open_loop, training_section.scatter),
    "Settings": (training_section.command, training_section.settings),
    "Model card": (training_section.use, training_section.limits),
}
FOLDED = "Network", "Settings"  # long tables, which fill a phone


def write_report(folder: Path) -> Path:
    """Write the report of a run, finished or not, or of an evaluation; return the page's path.

    A missing part is replaced by a line with the reason.

    Raises:
        InputError: the folder is neither, a link in it leads out of it, or the report cannot be
            written.
    """
    folder = Path(folder)
    is_evaluation = (folder / NAME).is_file() and not (folder / HYDRA).is_dir()
    run = ReportedEvaluation(folder) if is_evaluation else ReportedRun.open(folder)
    report, parts_of = folder / FOLDER, OF_EVALUATION if is_evaluation else SECTIONS
    refuse_links_out(run.folder)
    sections = [
        blocks.Section(name, _blocks(run, parts), name in FOLDED)
        for name, parts in parts_of.items()
    ]
    versions, when = run.metrics.get("versions") or {}, run.status.get("time") or ""
    footer = f"drivezoo {versions.get('drivezoo') or ''} {when[:10]}"
    with file_errors(report, "cannot be written ({})"):
        report.mkdir(exist_ok=True)
        for section in sections:
            for image in blocks.images_of(section.blocks):
                write_whole(report / image.name, image.data)
        write_whole(report / MARKDOWN, blocks.to_markdown(run.title, sections))
        return write_whole(report / PAGE, blocks.to_html(run.title, sections, footer))


def _blocks(run: ReportedDrives, parts: Sequence[Part]) -> list[blocks.Block]:
    """Return the blocks of a section; a part that cannot be created becomes a line, once."""
    shown: list[blocks.Block] = []
    for part in parts:
        try:
            shown += part(run)
        except (InputError, OSError) as error:
            line = blocks.Missing(str(error))
            shown += [] if line in shown else [line]
        # A run of another version may hold anything; a report must not stop a training.
        except Exception as error:
            reason = " ".join([f"{type(error).__name__}:", *str(error).splitlines()[:1]])
            shown.append(blocks.Missing(f"This part could not be written ({reason})."))
    return shown
