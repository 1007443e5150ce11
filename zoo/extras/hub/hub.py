"""`drivezoo hub`: send or fetch a checkpoint with its card."""

import re
from pathlib import Path
from typing import Literal

from rich.console import Console

from zoo.base.command import command
from zoo.base.console_progress import loading
from zoo.base.errors import UsageError
from zoo.base.terminal import command_line, print_next, print_written, printable
from zoo.checkpoints.checkpoint_path import find_checkpoint

_PART = r"[A-Za-z0-9](?:[\w.-]{0,94}[A-Za-z0-9])?"
_REPOSITORY = re.compile(rf"{_PART}/{_PART}", re.ASCII)
_LICENSE = re.compile(r"[a-z0-9][a-z0-9.-]{0,40}")


@command
def hub(
    action: Literal["push", "pull"],
    name: str,
    *,
    repo: str | None = None,
    send: bool = False,
    license: str | None = None,
    private: bool = False,
    file: str | None = None,
    out: str | None = None,
) -> None:
    """Send or fetch a checkpoint with its card.

    Push shows the card, and sends with send=true to a repository of the Hugging Face Hub,
    user/name, or writes to a folder, repo=./card. It needs `pip install "drivezoo[hub]"`.

      drivezoo hub push latest repo=./card
      drivezoo hub push latest repo=user/name send=true
      drivezoo hub pull user/name

    Args:
        action: what to do.
        name: push: checkpoint: a .ckpt file, a run's folder, latest, or a network that comes with
            drivezoo, such as lenet; pull: repository, user/name.
        repo: push: repository to send to, user/name; or a folder, such as ./card, to write the
            files to instead.
        send: push: true: send the files; false: only show what would be sent.
        license: push: licence of the weights, as the Hub abbreviates it, such as mit; null: the
            card names none.
        private: push: true: a repository that the command creates is visible to you alone.
        file: pull: name of the checkpoint in the repository; null: its only one.
        out: pull: output folder; null: named by the repository, below outputs/hub.

    Raises:
        UsageError: a key belongs to the other action, or a name is no repository's.
        InputError: the checkpoint cannot be loaded, or the repository cannot be read or written
            to; a folder is not empty; or a file is not the one that its card describes.
    """
    is_pull = action == "pull"
    others = {"repo": repo, "send": send, "license": license, "private": private}
    for key, value in (others if is_pull else {"file": file, "out": out}).items():
        if value:
            raise UsageError(f"{key}: belongs to {'push' if is_pull else 'pull'}; leave it out")
    if is_pull:
        _check_repository(name)
        _pull(name, file, out)
        return
    if repo is None:
        raise UsageError("repo: name a repository, repo=user/name, or a folder, repo=./card")
    if send and _is_folder(repo):
        raise UsageError(f"send: nothing is sent to the folder {repo}; write repo=user/name")
    if license is not None and not _LICENSE.fullmatch(license):
        raise UsageError(f"license={license}: write an abbreviation, such as mit")
    if not _is_folder(repo):
        _check_repository(repo)
        if Path(repo).is_dir():
            raise UsageError(f"repo={repo}: is also a folder; write repo=./{repo}, or move it")
    _push(name, repo, license, private, send)


def _push(named: str, repo: str, license_name: str | None, private: bool, send: bool) -> None:
    """Show a checkpoint and its card; write them to a folder, or send them to a repository."""
    path = find_checkpoint(named)
    if path.suffix == ".onnx":
        raise UsageError(f"{named}: is an export; name the checkpoint that it was exported from")
    with loading():
        from zoo.extras.hub.card import CARD, shared_files, write_files

    keys = [f"license={license_name}"] * bool(license_name) + ["private=true"] * private
    if _is_folder(repo):
        print_written(write_files(shared_files(path, None, license_name), repo))
        line = command_line(["drivezoo", "hub", "push", named, "repo=USER/NAME", *keys])
        print_next(line, "show it for a repository")
        return
    from zoo.extras.hub import repository

    address = f"{repository.writable_hub() if send else 'repository'} {repo}"
    files = shared_files(path, repo, license_name)
    print("\n".join(map(printable, files[CARD].decode().splitlines())))
    for name, contents in files.items():
        print(f"to {address}: {name}, {len(contents):,} bytes")
    if send:
        print_written([repository.send(repo, files, private)])
        print_next(f"drivezoo hub pull {repo}", "fetch it on another machine")
        return
    print_written([], ["hub", "push", named, f"repo={repo}", *keys, "send=true"])


def _pull(repo: str, file: str | None, out: str | None) -> None:
    """Fetch a repository's checkpoint and card into a new folder."""
    from zoo.checkpoints.checkpoint import read_checkpoint_file
    from zoo.extras.hub.repository import fetch
    from zoo.scoring.evidence import next_drive

    written = fetch(repo, file, out, Console(emoji=False))
    data = read_checkpoint_file(written[0])["drivezoo"]["data"]
    print_written(written, next_drive(written[0], data, ["evaluate", written[0], "track=lake"]))


def _is_folder(repo: str) -> bool:
    """Return whether a text names a folder, not a repository.

    >>> _is_folder("./card"), _is_folder("ann/lenet")
    (True, False)
    """
    return repo.startswith((".", "/", "~")) or repo.endswith("/") or "\\" in repo


def _check_repository(name: str) -> None:
    """Raise UsageError for a name that no repository of the Hub can have."""
    if not _REPOSITORY.fullmatch(name) or ".." in name or "--" in name:
        raise UsageError(
            f"{name}: is no repository; write user/name, with letters, digits, -, _ and ."
        )


if __name__ == "__main__":
    hub.run()
