"""The table and the plots of drives."""

import io

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from rich.console import Console

from zoo.driving import drive_loop
from zoo.driving.drives_table import mean_and_spread, print_drives
from zoo.driving.embedded_world import open_embedded
from zoo.driving.scenario import Scenario
from zoo.scoring.drive_plots import birds_eye, degradation_curves, figures_by_track
from zoo.scoring.robustness import sweep_table
from zoo.simulator.expert import Expert


def drive(autonomy: float | None = 1.0, interventions: int = 0, **figures: object) -> dict:
    return {
        "track": "lake",
        "seed": 0,
        "autonomy": autonomy,
        "interventions": interventions,
        "driven_m": 1000.0,
        "m_per_intervention": 1000.0 / interventions if interventions else None,
        **figures,
    }


def printed(tracks: dict, width: int = 120) -> str:
    console = Console(file=io.StringIO(), width=width)
    print_drives(tracks, console)
    return console.file.getvalue()


def row(text: str, label: str) -> str:
    (line,) = [line for line in text.splitlines() if line.startswith(f"│ {label} ")]
    return line.split("│")[2].strip()


def test_the_spread_is_the_sample_deviation_and_the_table_counts_drives() -> None:
    figures = mean_and_spread([drive(0.9, 1), drive(1.0), drive(0.8, 2)])

    assert figures["autonomy"] == (pytest.approx(0.9), pytest.approx(0.1))
    assert (figures["drives"], figures["drives_without_intervention"]) == (3, 1)

    text = printed({"lake": figures})
    assert row(text, "drives (start seeds)") == "3"
    assert row(text, "drives without intervention") == "1 of 3"


def test_one_drive_has_no_spread_nor_has_a_figure_that_some_drives_lack() -> None:
    figures = mean_and_spread([drive(0.9, 1)])
    assert figures["autonomy"] == (0.9, None)
    assert "±" not in printed({"lake": figures})

    drives = [drive(lap_s=None), drive(lap_s=80.0), drive(lap_s=90.0)]
    assert mean_and_spread(drives)["lap_s"] == (85.0, None)
    for pair in ([drive(lap_s=80.0), drive()], [drive(), drive(lap_s=80.0)]):
        assert mean_and_spread(pair)["lap_s"] == (80.0, None), "the other drive has no lap"


def test_an_unknown_figure_leaves_a_gap_in_plots_and_sweeps() -> None:
    swept = {"speed": {15.0: drive(None, cte_mean_m=None)}}
    assert figures_by_track([*swept["speed"].values()]).axes
    axes = degradation_curves(swept, {"speed": 15.0}, "lake").axes
    assert ["not measured" in axis.get_ylabel() for axis in axes] == [True, True]
    table = sweep_table(swept, Scenario())
    assert (table.columns[0].header, *table.columns[1].cells) == ("lake", "15*\n-\n-")
    assert next(table.columns[0].cells).startswith("speed, mph\n")


def test_metres_per_intervention_are_of_all_drives_together() -> None:
    drives = [drive(), drive(interventions=4)]
    assert mean_and_spread(drives)["m_per_intervention"] == (500.0, None)
    assert mean_and_spread(drives[:1])["m_per_intervention"] is None


def test_a_tracks_name_is_no_markup() -> None:
    text = printed({"lake [bold]x": mean_and_spread([drive()]), "[/red]": {}})

    assert "lake [bold]x" in text
    assert "[/red]" in text


@pytest.mark.parametrize("name", ["lake", "mountain"])
def test_the_birds_eye_view_is_as_wide_and_high_as_its_track(name: str) -> None:
    """Check a high and a wide track: white borders take less than a third of the plot."""
    scenario = Scenario(name, laps=0.05)
    world = open_embedded(scenario, "none")
    simulated, expert = world.simulated, Expert(world.simulated.track)
    driven = drive_loop.drive(lambda *_: (expert(simulated)[0], None), world, scenario)
    figure = birds_eye(simulated.track, driven.xy, driven, name)
    FigureCanvasAgg(figure).draw()
    bounds = figure.axes[0].get_position()
    assert bounds.height > 0.75
    assert bounds.width > 0.65
    assert max(figure.get_size_inches()) < 8
