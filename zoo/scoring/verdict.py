"""The verdict on a network: whether it drives, how certain that is, causes, next commands."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.panel import Panel
from rich.text import Text

from zoo.base.command_keys import changed
from zoo.base.console_script import place_of
from zoo.base.terminal import command_line, print_next
from zoo.driving.intervals import ONE_TRACK, poisson_rate
from zoo.runs.result_table import with_interval
from zoo.scoring.evaluate_options import EvaluateOptions
from zoo.scoring.evidence import Evidence, known_tracks, likely_causes, no_verdict, train_again

DRIVES, ALMOST, FAILS, UNKNOWN = "drives", "almost", "fails", "unknown"
WORDS = {
    FAILS: "does not drive",
    ALMOST: "drove, with interventions,",
    UNKNOWN: "unknown",
    DRIVES: "drove",
}
WORST_FIRST = tuple(WORDS)
UNKNOWN_HEADLINE = "Unknown whether it drives."
COLOURS = {FAILS: "red", ALMOST: "yellow", UNKNOWN: "yellow", DRIVES: "green"}
NEARLY = 0.9  # least autonomy of a network that drove with interventions
ENOUGH = 16  # roads without an intervention: then at least 79 % of such roads have none (95 %)
WHOLE_S = 60.0  # seconds of a replay in which one intervention leaves an autonomy of 90 %
# Keys of a drive that the next command takes, too; its track is named apart.
KEYS = ("speed", "direction", "weather", "frame_rate", "delay_s", "quality", "throttle", "margin")
WHOLE_LAP = 0.95  # laps; a drive may end just before the end of its last lap


@dataclass(frozen=True)
class Verdict:
    """Conclusion from the drives of a network: one for each track, the worst first.

    Attributes:
        level: `drives`, `almost`, `fails` or `unknown`, of the worst track.
        headline: sentence that names the level and the worst track.
        tracks: line with level and figures of each track, the worst first.
        certainty: sentences on what the number of drives can show.
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
    drives: Sequence[Mapping],
    evidence: Evidence,
    tracks: Sequence[str] | None = None,
    world: str = "embedded",
    replayed: str | None = None,
    driven: Mapping[str, object] | None = None,
) -> Verdict:
    """Judge a network by its drives.

    Args:
        drives: figures of each drive: `track`, `autonomy`, `interventions`, `laps`.
        evidence: config, metrics and command of the network, for causes and commands.
        tracks: tracks as the user typed them, such as `my_track.yaml`, whose recorded name is
            `my_track`; None for those of the run's `score`.
        world: world that was driven in.
        replayed: what was replayed, in words; None if `world` says it. A network of another car
            than Udacity's gets no verdict by the embedded world.
        driven: settings of the drives, as `speed`; None for those of the run's `score`.
    """
    from zoo.simulator.track_names import full_name

    world = "replay" if replayed else world
    by_track: dict[str, list[Mapping]] = {}
    for drive in drives:
        by_track.setdefault(str(drive["track"]), []).append(drive)
    if evidence.source is not None and world == "embedded":
        return _without_verdict(by_track, evidence, evidence.source)
    levels = {track: _level(driven, world) for track, driven in by_track.items()}
    names = sorted(
        levels, key=lambda name: (WORST_FIRST.index(levels[name]), _autonomy(by_track[name]))
    )
    level = levels[names[0]] if names else UNKNOWN
    lost = [track for track in names if levels[track] in (FAILS, ALMOST)]
    causes = likely_causes(evidence, [] if world == "replay" else lost) if lost else []
    keys = _changed_keys({key: evidence.at(f"score.{key}") for key in KEYS} | dict(driven or {}))
    weather = [word for word in keys if word.startswith("weather=")] if lost else []
    typed = _typed_tracks(evidence.at("score.track") if tracks is None else tracks)
    worst = typed.get(names[0], names[0]) if names else "lake"
    known, titles = {}, {name: f"the {name}" for name in names}
    if world == "embedded":
        known = known_tracks(evidence)
        titles = {name: full_name(typed.get(name, name)) for name in names}
    return Verdict(
        level,
        _headline(levels, names, by_track, known, titles) if level != UNKNOWN else UNKNOWN_HEADLINE,
        tuple(_track_line(track, levels[track], by_track[track]) for track in names),
        _certainty(by_track, replayed or "replay" if world == "replay" else None),
        (*(f"It was driven in {word}." for word in weather), *(cause.text for cause in causes)),
        tuple(_commands(level, evidence, train_again(evidence, causes), worst, world, keys)),
    )


def print_verdict(verdict: Verdict, console: Console) -> None:
    """Print a coloured box, and below it the commands, unbroken also in a narrow terminal."""
    lines = [*verdict.tracks, verdict.certainty]
    if verdict.causes:
        lines += ["", "Likely causes:", *(f"- {cause}" for cause in verdict.causes)]
    colour = COLOURS[verdict.level]
    title = Text(verdict.headline, style=f"bold {colour}")
    box, width = Text("\n".join(lines)), min(console.width, 100)
    fits = title.cell_len <= width - 6  # rich cuts a longer title
    panel = Panel(
        box if fits else Text("\n\n").join([title, box]),
        title=title if fits else None,
        title_align="left",
        border_style=colour,
        width=width,
    )
    console.print(panel, soft_wrap=False)
    for purpose, command in verdict.commands:
        print_next(command, purpose, console)


def _typed_tracks(tracks: object) -> dict[str, str]:
    """Return each track as the user typed it, by its recorded name.

    >>> _typed_tracks("lake,roads/own.yaml")
    {'lake': 'lake', 'own': 'roads/own.yaml'}
    """
    from zoo.simulator.track_names import recorded_name, short_name

    typed = tracks.split(",") if isinstance(tracks, str) else tracks
    names = typed if isinstance(typed, Sequence) else ()
    return {recorded_name(short_name(name)): name for name in names if isinstance(name, str)}


def _changed_keys(settings: Mapping[str, object]) -> list[str]:
    """Return settings of `KEYS` that are not the usual ones, as a user types them."""
    known = {key: settings[key] for key in KEYS if settings[key] is not None}
    return changed(EvaluateOptions(**known))  # type: ignore[arg-type]


def _headline(
    levels: Mapping[str, str],
    names: Sequence[str],
    by_track: Mapping[str, Sequence[Mapping]],
    known: Mapping[str, str],
    titles: Mapping[str, str],
) -> str:
    """Return the level in a sentence: what was driven, and on which tracks it says least.

    Args:
        levels: level of each track.
        names: tracks, the worst first.
        by_track: drives of each track.
        known: what a track was used for before, see `known_tracks`.
        titles: name of each track in a sentence.
    """
    level = levels[names[0]]
    if level != DRIVES:
        alike = [titles[name] for name in names if levels[name] == level]
        listed = alike[:3] + ["others"] * (len(alike) > 3)
        return f"It {WORDS[level]} {(' or ' if level == FAILS else ' and ').join(listed)}."
    new = len([name for name in names if name not in known])
    if new >= ENOUGH:
        return f"It drives: {new} of {new} roads that it was neither trained nor chosen on."
    laps = sum(drive.get("laps") or 0 for driven in by_track.values() for drive in driven)
    tracks = [
        titles[name] + (f", the track that it was {known[name]} on" if name in known else "")
        for name in sorted(names, key=lambda name: name in known)
    ]
    count = f"{laps:.3g} of {laps:.3g} laps of " if laps else ""
    return f"It drove {count}{' and '.join(tracks)}."


def _level(drives: Sequence[Mapping], world: str) -> str:
    """Return the level of one track's drives, or of a replay."""
    if any(drive.get("autonomy") is None for drive in drives):
        return UNKNOWN  # nothing was driven
    if not any(drive["interventions"] for drive in drives):
        if world == "replay":
            return DRIVES if _replayed_s(drives) >= WHOLE_S else UNKNOWN
        return DRIVES if sum(drive["laps"] or 0 for drive in drives) >= WHOLE_LAP else UNKNOWN
    return ALMOST if _autonomy(drives) >= NEARLY else FAILS


def _autonomy(drives: Sequence[Mapping]) -> float:
    return sum(drive.get("autonomy") or 0 for drive in drives) / len(drives)


def _replayed_s(drives: Sequence[Mapping]) -> float:
    """Return the seconds of drives that are replays, which alone know no laps."""
    return sum(drive.get("driven_s") or 0.0 for drive in drives if drive.get("laps") is None)


def _track_line(track: str, level: str, drives: Sequence[Mapping]) -> str:
    laps, replayed_s = sum(drive.get("laps") or 0 for drive in drives), _replayed_s(drives)
    lost = sum(int(drive["interventions"]) for drive in drives)
    autonomy = f"autonomy {_autonomy(drives):.1%}, " if lost and level != UNKNOWN else ""
    how_far = f"{replayed_s:.0f} s" if replayed_s else f"{laps:.2f} laps"
    words = WORDS[level].removesuffix(",")
    return f"{track}: {words}, {autonomy}interventions: {lost} in {how_far}"


def _without_verdict(
    by_track: Mapping[str, Sequence[Mapping]], evidence: Evidence, source: str
) -> Verdict:
    """Return the figures of a network of another car, and why they are no verdict on it."""
    lines = tuple(_track_line(track, UNKNOWN, driven) for track, driven in by_track.items())
    reason = evidence.metrics.get("not_replayed")
    certainty = f"{no_verdict(source)}." + (f" Its held-out drives: {reason}." if reason else "")
    command = ("score it on a recording of its own car", _replay_command(evidence))
    if not evidence.has_rig:  # no replay without it
        command = ("describe its camera and car", "drivezoo new rig my_car")
    return Verdict(UNKNOWN, UNKNOWN_HEADLINE, lines, certainty, (), (command,))


def _replay_command(evidence: Evidence) -> str:
    root, speed = evidence.root, evidence.at("score.replay_speed")
    facts = evidence.metrics.get("data")
    if not speed and isinstance(facts, Mapping) and facts.get("speed_mph") == 0:
        speed = 9  # to be adapted: the recording has none, and a replay needs one
    words = ["drivezoo", "replay", evidence.checkpoint or "CKPT"]
    words += [root if isinstance(root, str) else "FOLDER", *([f"speed={speed}"] if speed else [])]
    return command_line(words)


def _certainty(by_track: Mapping[str, Sequence[Mapping]], replayed: str | None) -> str:
    drives = [drive for driven in by_track.values() for drive in driven]
    if drives and replayed:
        lost = sum(int(drive["interventions"]) for drive in drives)
        a_minute = with_interval(poisson_rate(lost, _replayed_s(drives) / 60), "{:.1f}")
        return (
            f"Judged: {replayed}. Interventions a minute: {a_minute} (95 %, if their places do not "
            "repeat; trainings: 1)."
        )
    if not drives:
        return "It was not driven: open-loop figures do not show whether a car stays on the road."
    if all(drive.get("autonomy") is None for drive in drives):
        return "Its autonomy is not measured: no cross-track error, or it did not move."
    clean = sum(drive["interventions"] == 0 for drive in drives)
    return (
        f"Drives without an intervention: {clean} of {len(drives)} (tracks: {len(by_track)}, start "
        f"seeds: {len({drive.get('seed') for drive in drives})}, trainings: 1). {ONE_TRACK}"
    )


def _commands(
    level: str, evidence: Evidence, again: str | None, track: str, world: str, keys: list[str]
) -> list[tuple[str, str]]:
    """Return pairs of a purpose and a command; the first is the one to try first."""
    steps = [("train again", again)] if again else []
    if evidence.checkpoint is None:
        return steps
    if world == "replay":  # of any car: nothing here drives it on a track
        return [*steps, ("replay a whole recording of its car", _replay_command(evidence))]
    on_track = [evidence.checkpoint, f"track={track}", *keys]
    speed = [word for word in keys if word.startswith("speed=")]
    watch = ("watch it drive", ["drive", evidence.checkpoint, f"sim={track}", *speed])
    if world != "embedded":  # the only world that `correct` and `drive` have
        following = [("drive it three times", ["evaluate", *on_track, f"world={world}", "seeds=3"])]
    elif level in (ALMOST, FAILS):
        correct = (f"{'or ' if steps else ''}let the expert correct it", ["correct", *on_track])
        # The command `correct` is an extra's.
        following = [correct if evidence.can_train and place_of("correct") else watch]
    elif level == UNKNOWN:
        following = [("drive it", ["evaluate", *on_track])]
    else:
        others = ["benchmark", evidence.checkpoint, "suite=quick"]
        following = [("drive it on other roads", others), watch]
    return [*steps, *((why, command_line(["drivezoo", *words])) for why, words in following)]
