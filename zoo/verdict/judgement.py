"""The verdict on a network: whether it drives, how certain that is, causes, next commands."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.panel import Panel
from rich.text import Text

from zoo.cli.closing_lines import print_next
from zoo.drives.intervals import count_with_interval
from zoo.verdict.causes import Cause, likely_causes
from zoo.verdict.evidence import Evidence

DRIVES, ALMOST, FAILS, UNKNOWN = "drives", "almost", "fails", "unknown"
HEADLINES = {
    DRIVES: "It drives.",
    ALMOST: "It nearly drives.",
    FAILS: "It does not drive.",
    UNKNOWN: "Unknown whether it drives.",
}
COLOURS = {DRIVES: "green", ALMOST: "yellow", FAILS: "red", UNKNOWN: "yellow"}
NEARLY = 0.9  # least autonomy of a network that nearly drives
WHOLE_LAP = 0.95  # laps; a drive may end just before the end of its last lap


@dataclass(frozen=True)
class Verdict:
    """Conclusion from the drives of a network.

    Attributes:
        level: `drives`, `almost`, `fails` or `unknown`.
        headline: sentence that names the level.
        tracks: line of figures for each track.
        certainty: sentence with the number of drives and its confidence interval.
        causes: likely reasons, the likeliest first; empty for a network that drives.
        commands: pairs of a purpose and the next command to type.
    """

    level: str
    headline: str
    tracks: tuple[str, ...]
    certainty: str
    causes: tuple[str, ...]
    commands: tuple[tuple[str, str], ...]

    def plain(self) -> dict:
        """Return plain containers, for `metrics.json`."""
        return {key: list(v) if isinstance(v, tuple) else v for key, v in vars(self).items()}


def judge(
    drives: Sequence[Mapping], evidence: Evidence, tracks: Sequence[str] | None = None
) -> Verdict:
    """Judge a network by its drives.

    Args:
        drives: figures of each drive: `track`, `autonomy`, `interventions`, `laps`.
        evidence: config, metrics and command of the network, for causes and commands.
        tracks: tracks as the user typed them, such as `my_track.yaml`, whose recorded name is
            `my_track`; None for those of the run's `score`.
    """
    by_track: dict[str, list[Mapping]] = {}
    for one in drives:
        by_track.setdefault(str(one["track"]), []).append(one)
    level = _level(by_track)
    lost = [name for name, own in by_track.items() if any(one["interventions"] for one in own)]
    causes = [] if level in (DRIVES, UNKNOWN) else likely_causes(evidence, lost)
    typed = _typed_tracks(evidence.at("score.track") if tracks is None else tracks)
    shown = [typed.get(one, one) for one in lost or by_track]
    return Verdict(
        level,
        HEADLINES[level],
        tuple(_track_line(track, own) for track, own in by_track.items()),
        _certainty(drives),
        tuple(cause.text for cause in causes),
        tuple(_commands(level, evidence, causes, shown)),
    )


def print_verdict(verdict: Verdict, console: Console) -> None:
    """Print a coloured box, and below it the commands, unbroken also in a narrow terminal."""
    lines = [*verdict.tracks, verdict.certainty]
    if verdict.causes:
        lines += ["", "Likely cause:" if len(verdict.causes) == 1 else "Likely causes:"]
        lines += [f"- {cause}" for cause in verdict.causes]
    box = Text("\n".join(line for line in lines if line or verdict.causes))
    colour = COLOURS[verdict.level]
    title = Text(verdict.headline, style=f"bold {colour}")
    width = min(console.width, 100)
    panel = Panel(box, title=title, title_align="left", border_style=colour, width=width)
    console.print(panel, soft_wrap=False)
    for purpose, command in verdict.commands:
        print_next(command, purpose, console)


def _typed_tracks(tracks: object) -> dict[str, str]:
    """Return each track as the user typed it, by its recorded name.

    >>> _typed_tracks("lake,roads/own.yaml")
    {'lake': 'lake', 'own': 'roads/own.yaml'}
    """
    from simulator.track_names import recorded_name, short_name

    typed = tracks.split(",") if isinstance(tracks, str) else tracks
    names = typed if isinstance(typed, Sequence) else ()
    return {recorded_name(short_name(one)): one for one in names if isinstance(one, str)}


def _level(by_track: Mapping[str, Sequence[Mapping]]) -> str:
    if not by_track:
        return UNKNOWN
    drives = [one for own in by_track.values() for one in own]
    if all(one["interventions"] == 0 for one in drives):
        whole = all(sum(one["laps"] or 0 for one in own) >= WHOLE_LAP for own in by_track.values())
        return DRIVES if whole else UNKNOWN
    if any(all(one["interventions"] == 0 for one in own) for own in by_track.values()):
        return ALMOST
    mean = sum(one["autonomy"] or 0 for one in drives) / len(drives)
    return ALMOST if mean >= NEARLY else FAILS


def _track_line(track: str, drives: Sequence[Mapping]) -> str:
    laps = sum(one["laps"] or 0 for one in drives)
    count = sum(int(one["interventions"]) for one in drives)
    driven = f"{laps:.2f} laps" + (f" in {len(drives)} drives" if len(drives) > 1 else "")
    if count == 0:
        return f"{track}: no intervention in {driven}"
    mean = sum(one["autonomy"] or 0 for one in drives) / len(drives)
    return (
        f"{track}: autonomy {mean:.1%}, {count} intervention{'' if count == 1 else 's'} in {driven}"
    )


def _certainty(drives: Sequence[Mapping]) -> str:
    if not drives:
        return "It was not driven: open-loop figures do not show whether a car stays on the road."
    clean = sum(one["interventions"] == 0 for one in drives)
    starts = len({one.get("seed") for one in drives})
    seeds = f"{starts} start seed{'' if starts == 1 else 's'}, one training"
    return f"Drives without an intervention: {count_with_interval(clean, len(drives))}; {seeds}."


def _commands(
    level: str, evidence: Evidence, causes: Sequence[Cause], tracks: Sequence[str]
) -> list[tuple[str, str]]:
    """Return pairs of a purpose and a command; the first is the one to try first."""
    fails = level in (ALMOST, FAILS)
    found = [("train again", cause.command) for cause in causes if cause.command][:1]
    if level == FAILS and (first_try := evidence.first_try()):
        found.append(("or train by a recipe that worked on other recordings", first_try))
    if evidence.checkpoint is None:
        return found
    path, track = shlex.quote(evidence.checkpoint), shlex.quote(tracks[0] if tracks else "lake")
    if fails:
        correct = f"drivezoo correct {path} track={track}"
        return [*found, ("or let the expert correct it", correct)]
    purpose = "drive it" if level == UNKNOWN else "drive it from more starts"
    found.append((purpose, f"drivezoo evaluate {path} track={track} seeds=5"))
    if level == DRIVES:
        found.append(("watch it drive", f"drivezoo drive {path} drive.sim={track}"))
    return found
