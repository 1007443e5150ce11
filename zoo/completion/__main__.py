"""`drivezoo completion`: print a script that completes commands in a shell."""

from typing import Literal

from zoo.base.command import command


@command
def completion(shell: Literal["bash", "zsh", "fish"]) -> None:
    """Print a script that completes commands in a shell.

    The script holds all words, so that a completion starts no Python. Print it again after an
    update.

      echo 'eval "$(drivezoo completion bash)"' >> ~/.bashrc
      echo 'eval "$(drivezoo completion zsh)"' >> ~/.zshrc
      drivezoo completion fish > ~/.config/fish/completions/drivezoo.fish

    Args:
        shell: shell.
    """
    from zoo.completion.shell_scripts import SCRIPTS, command_words

    print(SCRIPTS[shell](command_words()), end="")


if __name__ == "__main__":
    completion.run()
