"""The commands with a YAML of their own, and the dataclass of each."""

from typing import Any

from zoo.benchmark.__main__ import BenchmarkOptions
from zoo.clean import CleanOptions
from zoo.cli.command_config import read_keys, read_options
from zoo.compare.__main__ import CompareOptions
from zoo.convert import ConvertOptions
from zoo.correct.correct_options import CorrectOptions
from zoo.doubt.__main__ import DoubtOptions
from zoo.drive.drive_settings import DriveSettings, read_settings
from zoo.edit.edit_options import EditOptions
from zoo.evaluate.evaluate_options import EvaluateOptions
from zoo.evaluate.replay_score import ReplayOptions
from zoo.export.__main__ import ExportOptions
from zoo.film import FilmOptions
from zoo.guard.guard_options import GuardOptions
from zoo.hub.hub_options import HubOptions
from zoo.input_search.import_options import ImportOptions
from zoo.leaderboard.__main__ import LeaderboardOptions
from zoo.rerun import RerunOptions
from zoo.results import ResultsOptions
from zoo.saliency.__main__ import SaliencyOptions
from zoo.search.search_options import SearchOptions
from zoo.sweep.__main__ import SweepOptions

KINDS = {
    "clean": CleanOptions,
    "compare": CompareOptions,
    "benchmark": BenchmarkOptions,
    "convert": ConvertOptions,
    "correct": CorrectOptions,
    "doubt": DoubtOptions,
    "drive": DriveSettings,
    "edit": EditOptions,
    "evaluate": EvaluateOptions,
    "export": ExportOptions,
    "film": FilmOptions,
    "guard": GuardOptions,
    "hub": HubOptions,
    "import": ImportOptions,
    "leaderboard": LeaderboardOptions,
    "replay": ReplayOptions,
    "rerun": RerunOptions,
    "results": ResultsOptions,
    "saliency": SaliencyOptions,
    "search": SearchOptions,
    "sweep": SweepOptions,
}


def command_options(name: str) -> Any:
    """Return the default options of a command."""
    if name == "doctor":  # which needs no package that may be missing
        return read_keys(name, [])
    return read_settings([]) if name == "drive" else read_options(name, KINDS[name])
