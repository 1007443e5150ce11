"""Networks, training, driving, scoring, reporting."""

from importlib.util import find_spec
from pathlib import Path

from zoo.base import __version__ as __version__
from zoo.base.child_process import end_with_parent

# A user's file or folder of that name, beside a script or a notebook, is found first.
_found, _own = find_spec("datamodules"), Path(__file__).parents[1] / "datamodules/__init__.py"
if _found is not None and _found.origin and Path(_found.origin) != _own:
    raise ImportError(
        f"{_found.origin}: hides drivezoo's own package datamodules; rename it, or start Python "
        "elsewhere"
    )

end_with_parent()
