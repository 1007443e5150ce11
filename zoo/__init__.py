"""Networks, training, driving, scoring, reporting."""

from importlib.util import find_spec
from pathlib import Path

from zoo.base import __version__ as __version__
from zoo.base.child_process import end_with_parent

# A user's file or folder of that name, beside a script or a notebook, is found first.
_found = find_spec("datamodules")
if _found is None or _found.origin != str(Path(__file__).parents[1] / "datamodules/__init__.py"):
    _place = _found and (_found.origin or str(_found.submodule_search_locations))
    raise ImportError(
        f"{_place}: hides drivezoo's own package datamodules; rename it, or start Python elsewhere"
    )

end_with_parent()
