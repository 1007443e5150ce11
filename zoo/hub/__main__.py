"""`drivezoo hub`: send or fetch a checkpoint with its card."""

from typing import Literal

from rich.console import Console

from zoo.base.command import command
from zoo.base.terminal import command_line, printable
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.cli.closing_lines import print_next, print_written
from zoo.cli.console_progress import loading
from zoo.hub.hub_options import CARD, PUSH, HubOptions, check_keys, is_folder


def push(named: str, options: HubOptions) -> None:
    """Show a checkpoint and its card; write them to a folder, or send them to a repository.

    Raises:
        InputError: the checkpoint cannot be loaded, the folder is not empty, or the repository
            cannot be written to.
    """
    path = find_checkpoint(named)
    assert options.repo is not None
    with loading():
        from zoo.hub.card import shared_files, write_files

    if is_folder(options.repo):
        print_written(write_files(shared_files(path, None, options.license), options.repo))
        line = command_line(["drivezoo", "hub", PUSH, named, "repo=USER/NAME"])
        print_next(line, "show it for a repository")
        return
    from zoo.hub.repository import send, writable_hub

    address = f"{writable_hub() if options.send else 'repository'} {options.repo}"
    files = shared_files(path, options.repo, options.license)
    print("\n".join(map(printable, files[CARD].decode().splitlines())))
    for name, contents in files.items():
        print(f"to {address}: {name}, {len(contents):,} bytes")
    if options.send:
        print_written([send(options.repo, files, options.private)])
        print_next(f"drivezoo hub pull {options.repo}", "fetch it on another machine")
        return
    keys = [f"license={options.license}"] * bool(options.license)
    keys += ["private=true"] * options.private
    print_written([], ["hub", PUSH, named, f"repo={options.repo}", *keys, "send=true"])


def pull(repo: str, options: HubOptions) -> None:
    """Fetch a repository's checkpoint and card into a new folder.

    Raises:
        InputError: the repository cannot be read, holds no checkpoint, or another file than its
            card describes; or the folder is not empty.
    """
    from zoo.hub.repository import fetch

    written = fetch(repo, options.file, options.out, Console(emoji=False))
    print_written(written)
    print_next(
        command_line(["drivezoo", "evaluate", str(written[0]), "track=lake"]), "let it drive"
    )


@command
def hub(action: Literal["push", "pull"], name: str, *, options: HubOptions) -> None:
    """Send or fetch a checkpoint with its card.

    Push shows the card, and sends with send=true to a repository of the Hugging Face Hub,
    user/name, or writes to a folder, repo=./card. It needs `pip install 'drivezoo[hub]'`.

      drivezoo hub push latest repo=./card
      drivezoo hub push latest repo=user/name send=true
      drivezoo hub pull user/name

    Args:
        action: what to do.
        name: push: checkpoint: a .ckpt or .onnx file, a run's folder, latest, or a network that
            comes with drivezoo, such as lenet; pull: repository, user/name.
        options: see `HubOptions`.

    Raises:
        UsageError: an option belongs to the other action.
    """
    check_keys(action, name, options)
    (push if action == PUSH else pull)(name, options)


if __name__ == "__main__":
    hub.run()
