"""Recordings and splits that must exist before a study trains; `PREPARE` is named by its YAML."""

from collections.abc import Callable
from pathlib import Path

from omegaconf import OmegaConf
from rich.console import Console

from benchmarks.carry import record_tracks
from benchmarks.study_grid import Study, run_logged
from zoo.base.compose import compose_config
from zoo.simulator.hand_control import REACTION_S

console = Console(soft_wrap=True)


def recorded(config: object) -> str:
    """Return the folder of the recording of a config; record it if it does not exist.

    Raises:
        InputError: the recording was changed.
    """
    from zoo.training.run_config import with_recording

    return str(with_recording(OmegaConf.create(config), console).data.root)


def student_laps(study: Study) -> dict[str, str]:
    """Record the laps of simulated students that the chosen entries lack."""
    for control in {entry.labels["recording"] for entry in study.chosen()} & REACTION_S.keys():
        folder = Path(study.config["runs"], "recordings", control)
        if not (folder / "driving_log.csv").is_file():
            words = [f"control={control}", f"laps={study.options.laps}", "seed=1", "track=lake"]
            words += [f"speed={study.options.speed}", f"out={folder}"]
            log = folder.parent / f"{control}.txt"
            run_logged(log, ["zoo.commands.simulator", "record", *words], study.options.threads)
    return {}


PREPARE: dict[str, Callable[[Study], dict]] = {
    "bench_v1": lambda study: {"root": recorded(compose_config(["data=bench_v1"]))},
    "student_laps": student_laps,
    "carracing": record_tracks,
}
