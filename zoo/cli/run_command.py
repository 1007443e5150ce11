"""Run of a command of zoo: parts of the user's own, and Hydra's errors in one line."""

import os
from collections.abc import Callable

from zoo.base import run_command as base
from zoo.base.errors import UsageError
from zoo.base.terminal import guard_rich
from zoo.cli.parts import part_failure, take_parts
from zoo.cli.version import FLAGS, version_line


def run_command(name: str, command: Callable[[list[str]], None], arguments: list[str]) -> int:
    """Run a command as `zoo.base.run_command` does, with `parts=` and `--version`."""

    def run(given: list[str]) -> None:
        os.environ["NO_ALBUMENTATIONS_UPDATE"] = "1"
        guard_rich()
        given = take_parts(given)
        if set(given).isdisjoint(FLAGS):
            command(given)
        else:
            print(version_line())

    return base.run_command(name, run, arguments, expected_failure)


def expected_failure(error: BaseException, arguments: list[str]) -> Exception | None:
    """Return an error of one line for input that the user can fix, or a stop; else None."""
    failure = part_failure(error) if not base.was_stopped(error) else None
    failure = failure or base.expected_failure(error, arguments)
    if failure is not None:
        return failure
    # Hydra is imported late: its import takes a third of a second, in which Ctrl-C would print a
    # traceback.
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    from zoo.cli.compose import explain

    if isinstance(error, HydraException | OmegaConfBaseException):
        return UsageError(explain(error, arguments))
    if isinstance(error, ValueError) and str(error).startswith("Config group override"):
        nulls = " ".join(one for one in arguments if one.endswith("=null"))  # as callbacks=null
        return UsageError(f"{nulls}: name a choice; drivezoo train --help lists all")
    return None
