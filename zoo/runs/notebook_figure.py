"""A figure that a notebook shows."""

import io

from matplotlib.figure import Figure


class NotebookFigure(Figure):
    """A figure that is an image as the last value of a notebook's cell, also without pyplot."""

    def _repr_png_(self) -> bytes:
        """Return the figure as PNG, which notebooks look for."""
        file = io.BytesIO()
        self.savefig(file, format="png")
        return file.getvalue()
