"""`drivezoo simulator record|drive|client [key=value...]`: record, drive, or obey."""

import difflib
import importlib
import sys
from collections.abc import Sequence
from dataclasses import is_dataclass
from types import ModuleType

from simulator.command_line import options_help, run_command
from zoo.base.errors import UsageError

# Modules are imported only when needed: --help and typos answer without the slow imports.
COMMANDS = {
    "record": "record laps that a simulated driver drives",
    "drive": "drive in a window, with keyboard, mouse or gamepad",
    "client": "connect to a driver as the original simulator does",
}
HELP = ("-h", "--help", "help")


def simulator(arguments: Sequence[str]) -> None:
    """Run the command that the first argument names with the other arguments."""
    name, *rest = arguments or ["--help"]
    if name in HELP:
        print("usage: drivezoo simulator COMMAND [key=value...]\n")
        for command, meaning in COMMANDS.items():
            print(f"  {command:<8}{meaning}")
        print("\nhelp on a command: drivezoo simulator COMMAND --help")
        return
    if name not in COMMANDS:
        near = difflib.get_close_matches(name, COMMANDS, n=1)
        hint = f"did you mean {near[0]}?" if near else f"available: {', '.join(COMMANDS)}"
        raise UsageError(f"{name}: no such command; {hint}")
    if any(one in HELP for one in rest):
        options = importlib.import_module(f"simulator.{name}_options")
        print(f"usage: drivezoo simulator {name} [key=value...]\n\n{help_text(options)}")
    else:
        importlib.import_module(f"simulator.{name}").main(rest)


def help_text(module: ModuleType) -> str:
    """Return the purpose and options of a command, from the `...Options` dataclass of a module."""
    return options_help(
        next(
            one
            for name, one in vars(module).items()
            if name.endswith("Options") and is_dataclass(one)
        )
    )


if __name__ == "__main__":
    sys.exit(run_command(simulator, sys.argv[1:]))
