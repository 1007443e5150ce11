"""`drivezoo simulator record|drive|client|serve [key=value...]`: record, drive, or obey."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from zoo.base.command import Command, command, is_help
from zoo.base.console_script import commands_below
from zoo.base.errors import UsageError, hint
from zoo.base.run_command import exit_after
from zoo.simulator.command_options import ClientOptions, DriveOptions, RecordOptions

# Slow imports come late: --help and typos answer at once.


@command(name="simulator record", parts=False)
def record(*, options: RecordOptions) -> Path:
    """Record laps of a simulated driver in the original simulator's format.

    Args:
        options: see `RecordOptions`.
    """
    from zoo.simulator.record import print_last_lines, record_laps

    folder = record_laps(options)
    print_last_lines(folder)
    return folder


@command(name="simulator drive", parts=False)
def drive(*, options: DriveOptions) -> Path | None:
    """Drive on a page, with keyboard, mouse or gamepad; R starts and stops recording.

    Args:
        options: see `DriveOptions`.

    Returns:
        The recording's folder; None if nothing was recorded.
    """
    from zoo.simulator import hand_drive as driving
    from zoo.simulator.record import print_last_lines

    recorded = driving.drive(options)
    if recorded is None:
        return None
    print_last_lines(*recorded)
    return recorded[0]


@command(name="simulator client", parts=False, outputs=True)
def client(*, options: ClientOptions) -> None:
    """Connect to a driver as the original simulator's autonomous mode does.

    The client sends the same bytes as the original client of 2016, with one difference: while no
    driver accepts it, it tries to connect twice a second, not thousands of times.

    Args:
        options: see `ClientOptions`.
    """
    from rich.console import Console

    from zoo.simulator.client import run_client

    run_client(options, Console())


COMMANDS: dict[str, Command[Any]] = {"record": record, "drive": drive, "client": client}


def all_commands() -> dict[str, Command[Any]]:
    """Return the commands below `simulator`, those of extras and other packages last."""
    return COMMANDS | commands_below("simulator") | COMMANDS  # ours replace others of their names


def simulator(arguments: Sequence[str]) -> None:
    """Record laps, drive on a page, connect to a driver, or serve a world."""
    name, *rest = arguments or ["--help"]
    commands = COMMANDS if name in COMMANDS else all_commands()
    if name in commands:
        commands[name].main(rest)
    elif is_help([name]) or name == "help":
        print("usage: drivezoo simulator COMMAND [key=value...]\n")
        for shown, entry in commands.items():
            print(f"  {shown:<8}{entry.purpose}")
        print("\nhelp on a command: drivezoo simulator COMMAND --help")
    else:
        raise UsageError(f"{name}: no such command; {hint(name, commands)}")


if __name__ == "__main__":
    exit_after("drivezoo simulator", simulator)
