"""What every command of ours shares: overrides in, one line and an exit status out."""

import os
import sys
from collections.abc import Callable

from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from datamodules.errors import InputError
from zoo.config import explain
from zoo.forgiving_output import ForgivingOutput
from zoo.status import StoppedError


def run_command(name: str, command: Callable[[list[str]], None], arguments: list[str]) -> int:
    """Call `command(arguments)`; its user's errors become one line each and the exit status.

    What cannot be printed ends no command: a line at its end names the reason.
    """
    os.environ["NO_ALBUMENTATIONS_UPDATE"] = "1"
    failure: Exception | None = None
    before = sys.stdout
    output = ForgivingOutput(before) if before else None  # None where it was closed: `>&-`
    sys.stdout = output
    try:
        command(arguments)
        if output:
            output.flush()
    except (InputError, StoppedError) as error:
        failure = error
    except (HydraException, OmegaConfBaseException) as error:
        failure = InputError(explain(error, arguments))
    except KeyboardInterrupt:
        failure = StoppedError("stopped")
    except BrokenPipeError:  # whoever read our output has seen enough, as `| head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:  # of a disk or a folder: named, and nothing that a trace explains
        if error.strerror is None:
            raise
        failure = InputError(f"{error.filename or 'a file'}: {error.strerror}")
    finally:
        sys.stdout = before
    if failure is None and output and output.failure:
        failure = InputError(
            f"standard output: {output.failure.strerror}; all was done, but not all of it printed: "
            "write it to a place with room"
        )
    if failure is None:
        return 0
    print(f"{name}: {' '.join(str(failure).split())}", file=sys.stderr)
    return 130 if isinstance(failure, StoppedError) else 1
