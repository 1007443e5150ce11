"""Errors of a function in one line, as its command prints them."""

import os
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from zoo.cli.run_command import expected_failure

Given = ParamSpec("Given")
Returned = TypeVar("Returned")


def one_line_errors(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Let a function raise the error of one line that its command prints.

    An error that is a bug in drivezoo keeps its type and its traceback.
    """

    @wraps(function)
    def call(*args: Given.args, **kwargs: Given.kwargs) -> Returned:
        os.environ["NO_ALBUMENTATIONS_UPDATE"] = "1"
        try:
            return function(*args, **kwargs)
        except Exception as error:
            failure = expected_failure(error, [f"{key}={one}" for key, one in kwargs.items()])
            if failure is None:
                raise
        raise failure.with_traceback(None)

    return call
