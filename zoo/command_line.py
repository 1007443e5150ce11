"""What every command of ours shares: overrides in, one line and an exit status out."""

import os
import sys
from collections.abc import Callable

from datamodules.errors import InputError
from zoo.status import StoppedError

# Hydra takes a third of a second to import, in which Ctrl-C would print a trace.


def run_command(name: str, command: Callable[[list[str]], None], arguments: list[str]) -> int:
    """Call `command(arguments)`; its user's errors become one line each and the exit status."""
    os.environ["NO_ALBUMENTATIONS_UPDATE"] = "1"
    failure: Exception | None = None
    try:
        command(arguments)
    except (InputError, StoppedError) as error:
        failure = error
    except KeyboardInterrupt:
        failure = StoppedError("stopped")
    except BrokenPipeError:  # whoever read our output has seen enough, as `| head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except Exception as error:
        failure = _failure(error, arguments)
        if failure is None:
            raise
    if failure is None:
        return 0
    print(f"{name}: {' '.join(str(failure).split())}", file=sys.stderr)
    return 130 if isinstance(failure, StoppedError) else 1


def _failure(error: Exception, arguments: list[str]) -> InputError | None:
    """Return what a user can act on: a config's mistake, a disk or a folder; None for the rest."""
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    from zoo.config import explain

    if isinstance(error, HydraException | OmegaConfBaseException):
        return InputError(explain(error, arguments))
    if isinstance(error, ValueError) and str(error).startswith("Config group override"):
        nulls = " ".join(one for one in arguments if one.endswith("=null"))  # as callbacks=null
        return InputError(f"{nulls}: name a choice; python -m zoo --help lists all")
    if isinstance(error, OSError) and error.strerror is not None:
        return InputError(f"{error.filename or 'a file'}: {error.strerror}")
    return None
