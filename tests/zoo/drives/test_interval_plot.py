"""The plot of figures with their 95 % intervals."""

import io
import warnings

import pytest

from zoo.drives.bootstrap import Estimate
from zoo.runs.plots import interval_plot


@pytest.mark.parametrize(
    "figures",
    [{}, {"like": Estimate(0.5, 0.2, 0.8)}, {"like": Estimate(1.0, 1.0, 1.0)}],
    ids=["no row", "one row", "an interval of one point"],
)
def test_a_plot_of_few_rows_warns_of_nothing(figures: dict[str, Estimate]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plot = interval_plot(figures, "autonomy (%)", 0.0)
        plot.savefig(io.BytesIO())
    (axis,) = plot.axes
    assert [one.get_text() for one in axis.get_yticklabels()] == list(figures)
    assert axis.get_ylim() == (0.5, -0.5)
