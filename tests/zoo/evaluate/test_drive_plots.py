"""Plots of a drive: sizes, marks and axes."""

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from simulator.expert import Expert
from zoo.evaluate.drive_plots import birds_eye
from zoo.worlds.drive_loop import drive
from zoo.worlds.embedded_world import open_embedded
from zoo.worlds.scenario import Scenario


@pytest.mark.parametrize("name", ["lake", "mountain"])
def test_the_birds_eye_view_is_as_wide_and_high_as_its_track(name: str) -> None:
    """Check a high and a wide track: white borders take less than a third of the plot."""
    scenario = Scenario(name, laps=0.05)
    world = open_embedded(scenario, "none")
    simulated, expert = world.simulated, Expert(world.simulated.track)
    driven = drive(lambda *_: (expert(simulated)[0], None), world, scenario)
    figure = birds_eye(simulated.track, driven, name)
    FigureCanvasAgg(figure).draw()
    bounds = figure.axes[0].get_position()
    assert bounds.height > 0.75
    assert bounds.width > 0.65
    assert max(figure.get_size_inches()) < 8
