"""`drivezoo list` and `drivezoo results`: what they print."""

import json
import shutil
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from tests.zoo.base.user_parts import write_network
from tests.zoo.command_runs import ROOT, only_line, run, run_here, succeed
from zoo.base.conf_files import choice_files
from zoo.base.console_script import LISTED
from zoo.commands.list import description, list_parts
from zoo.commands.results import run_figures
from zoo.runs.metrics_file import write_metrics_file
from zoo.runs.run_record import Run

FILES = [path for group, _ in LISTED.values() if group for path in choice_files(group).values()]


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_every_choice_has_a_description(path: Path) -> None:
    assert 10 < len(description(path)) < 200


@pytest.mark.slow
def test_a_part_of_the_users_own_is_listed(tmp_path: Path) -> None:
    write_network(tmp_path)
    printed = succeed(run(tmp_path, "models", "parts=my_net.py", module="zoo.commands.list"))
    assert "my_net: Steering from the mean of each column" in printed
    assert "tracks, " not in printed, "only the named kind"


def test_a_wrong_kind_names_the_right_one(tmp_path: Path) -> None:
    line = only_line(run_here(tmp_path, "track", module="zoo.commands.list"))
    assert "did you mean tracks" in line


@pytest.mark.parametrize("kinds", [[], ["tracks", "recipes"], ["metrics"]])
def test_a_list_of_all_ends_with_a_command(kinds: list[str], capsys: pytest.CaptureFixture) -> None:
    list_parts.main(kinds)
    assert ("next: drivezoo new model my_net" in capsys.readouterr().out) == (not kinds)


def test_a_finished_run_is_a_row_with_its_own_figures(run_folder: Path) -> None:
    printed = succeed(run_here(ROOT, str(run_folder), module="zoo.commands.results"))
    header, rule, row = printed.strip().splitlines()
    assert header.count("|") == rule.count("|") == row.count("|")
    metrics = json.loads((run_folder / "metrics.json").read_text())
    recording = Run(run_folder).trained_on.name  # errors on another one are no comparison
    assert row.startswith(f"| nvidia | {recording} | blocks | 252219 |")
    for predictor in (metrics["open_loop"], metrics["baselines"]):
        figures = predictor["test"]
        mse = figures["mse"] if "mse" in figures else figures["always zero"]["mse"]
        assert f"{mse:.4g}" in row


@pytest.mark.parametrize(("most", "name"), [(1, "nvidia, quick"), (10, "nvidia")])
def test_a_quick_run_is_named_so_where_it_was_longer(
    most: int, name: str, run_folder: Path, tmp_path: Path
) -> None:
    shutil.copytree(run_folder, tmp_path / "run")
    config = OmegaConf.load(tmp_path / "run/.hydra/config.yaml")
    config.trainer.max_epochs, config.data.samples_per_epoch = 3, 10
    config.quick, config.quick_samples = True, most
    OmegaConf.save(config, tmp_path / "run/.hydra/config.yaml")
    assert run_figures(Run(tmp_path / "run"))["experiment"] == name


def test_a_folder_without_figures_is_named(tmp_path: Path) -> None:
    assert "metrics.json" in only_line(run_here(ROOT, str(tmp_path), module="zoo.commands.results"))


def test_an_evaluation_names_the_command_that_ranks_it(tmp_path: Path) -> None:
    tracks = {"lake": {"drives": 1, "drives_without_intervention": 1, "autonomy": [1.0, None]}}
    write_metrics_file(tmp_path, {"checkpoint": "ann.ckpt", "drives": [], "tracks": tracks})
    line = only_line(run_here(ROOT, str(tmp_path), module="zoo.commands.results"))
    assert "is an evaluation" in line
    assert "drivezoo leaderboard" in line
