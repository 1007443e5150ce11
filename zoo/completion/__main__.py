"""`drivezoo completion bash|zsh|fish`: print a script that completes commands in a shell.

The script holds all words, so that a completion starts no Python. Print it again after an update.

  echo 'eval "$(drivezoo completion bash)"' >> ~/.bashrc
  echo 'eval "$(drivezoo completion zsh)"' >> ~/.zshrc
  drivezoo completion fish > ~/.config/fish/completions/drivezoo.fish
"""

import sys

from zoo.base.errors import UsageError
from zoo.cli.command import Command
from zoo.cli.nearest import hint
from zoo.cli.run_command import run_command

COMMAND = Command(__doc__, {"bash|zsh|fish": "shell"})


def completion(arguments: list[str]) -> None:
    """Print the script of a shell.

    Raises:
        UsageError: there is no script for it.
    """
    (shell,), _ = COMMAND.split(arguments)
    from zoo.completion.shell_scripts import SCRIPTS

    if shell not in SCRIPTS:
        raise UsageError(f"{shell}: no such shell; {hint(shell, SCRIPTS)}")
    from zoo.completion.words import command_words

    print(SCRIPTS[shell](command_words()), end="")


if __name__ == "__main__":
    sys.exit(run_command("zoo.completion", completion, sys.argv[1:]))
