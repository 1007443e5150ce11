"""Errors of a function in one line, as its command prints them."""

import os
import warnings
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from zoo.base.parts import name_parts
from zoo.base.run_command import expected_failure

Given = ParamSpec("Given")
Returned = TypeVar("Returned")


def one_line_errors(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Let a function raise the error of one line that its command prints, and take `parts=`.

    An error that is a bug in drivezoo keeps its type and its traceback. `parts` names the user's
    own modules, as on the command line: a name, or a list of names.
    """

    @wraps(function)
    def call(*args: Given.args, **kwargs: Given.kwargs) -> Returned:
        os.environ["NO_ALBUMENTATIONS_UPDATE"] = "1"
        # A notebook needs no ipywidgets: drivezoo shows no bar of tqdm's, which Lightning imports.
        warnings.filterwarnings("ignore", message="IProgress not found")
        parts: Any = kwargs.pop("parts", None) or []
        names = [parts] if isinstance(parts, str | Path) else parts
        try:
            name_parts([str(one) for one in names])
            return function(*args, **kwargs)
        except Exception as error:
            failure = expected_failure(error)
            if failure is None:
                raise
        raise failure.with_traceback(None)

    return call
