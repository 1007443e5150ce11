"""Options of `drivezoo hub`, and the names of repositories."""

import re
from dataclasses import dataclass
from pathlib import Path

from zoo.base.errors import UsageError

PUSH, PULL = "push", "pull"
HUB = "hub"  # kind of folder
CARD = "README.md"
_OWN = {PUSH: ("repo", "send", "license", "private"), PULL: ("file", "out")}
_PART = r"[A-Za-z0-9](?:[\w.-]{0,94}[A-Za-z0-9])?"
_REPOSITORY = re.compile(rf"{_PART}/{_PART}", re.ASCII)
_LICENSE = re.compile(r"[a-z0-9][a-z0-9.-]{0,40}")


@dataclass(frozen=True, kw_only=True)
class HubOptions:
    """Keys of a push or a pull.

    Args:
        repo: push: repository to send to, user/name; or a folder, such as ./card, to write the
            files to instead.
        send: push: true: send the files; false: only show what would be sent.
        license: push: licence of the weights, as the Hub abbreviates it, such as mit; null: the
            card names none.
        private: push: true: a repository that the command creates is visible to you alone.
        file: pull: name of the checkpoint in the repository; null: its only one.
        out: pull: output folder; null: named by the repository, below outputs/hub.
    """

    repo: str | None = None
    send: bool = False
    license: str | None = None
    private: bool = False
    file: str | None = None
    out: str | None = None


def is_folder(repo: str) -> bool:
    """Return whether a text names a folder, not a repository.

    >>> is_folder("./card"), is_folder("ann/lenet")
    (True, False)
    """
    return repo.startswith((".", "/", "~")) or repo.endswith("/") or "\\" in repo


def check_keys(action: str, name: str, options: HubOptions) -> None:
    """Raise UsageError for an option of the other action, or a wrong name of a repository."""
    other = PULL if action == PUSH else PUSH
    for key in _OWN[other]:
        if getattr(options, key) not in (None, False):
            raise UsageError(f"{key}: belongs to {other}; leave it out of {action}")
    if action == PULL:
        check_repository(name, "")
        return
    if options.repo is None:
        raise UsageError("repo: name a repository, repo=user/name, or a folder, repo=./card")
    if not is_folder(options.repo):
        check_repository(options.repo, "repo=")
        if Path(options.repo).is_dir():
            raise UsageError(
                f"repo={options.repo}: is also a folder here; write repo=./{options.repo} for the "
                "folder, or type the command elsewhere"
            )
    if options.license is not None and not _LICENSE.fullmatch(options.license):
        raise UsageError(f"license={options.license}: write an abbreviation, such as mit")


def check_repository(name: str, key: str) -> None:
    """Raise UsageError for a name that no repository of the Hub can have."""
    if not _REPOSITORY.fullmatch(name) or ".." in name or "--" in name:
        raise UsageError(
            f"{key}{name}: is no repository; write user/name, with letters, digits, -, _ and ."
        )
