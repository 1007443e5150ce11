"""Plots of a drive: sizes, marks and axes."""

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from simulator.expert import Expert
from simulator.world import open_world
from zoo.evaluate.drive_plots import birds_eye
from zoo.evaluate.many_drives import Setup, drive_setup


@pytest.mark.parametrize("name", ["lake", "mountain"])
def test_the_birds_eye_view_is_as_wide_and_high_as_its_track(name: str) -> None:
    """Check a high and a wide track: white borders take less than a third of the plot."""
    world = open_world(name, renderer="none")
    expert = Expert(world.track)
    drive = drive_setup(lambda *_: (expert(world)[0], None), world, Setup(name, laps=0.05))
    figure = birds_eye(world.track, drive, name)
    FigureCanvasAgg(figure).draw()
    bounds = figure.axes[0].get_position()
    assert bounds.height > 0.75
    assert bounds.width > 0.65
    assert max(figure.get_size_inches()) < 8
