"""Send files to a repository of the Hugging Face Hub, and fetch them, with bounds on each."""

import hashlib
import os
import re
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from zoo.base.console_progress import progress_bar
from zoo.base.errors import InputError, UsageError, optional_import
from zoo.base.new_folder import refuse_existing, whole_folder
from zoo.checkpoints.checkpoint import (
    MOST_BYTES,
    build_checkpoint,
    check_card,
    read_checkpoint_file,
)
from zoo.extras.hub.card import CARD, described_hash

if TYPE_CHECKING:
    from huggingface_hub import HfApi

MOST_CARD_BYTES = 1_000_000
MOST_FILES = 10_000
WAIT_S = 60.0  # for an answer, or for its next bytes
_NAME = re.compile(r"[A-Za-z0-9_][\w.-]{0,200}\.ckpt", re.ASCII)


def writable_hub() -> str:
    """Return the Hub's address; raise InputError without an access token."""
    endpoint = _api().endpoint
    from huggingface_hub import get_token

    if not get_token():
        raise InputError(
            f"{endpoint}: there is no access token; create one that may write at "
            f"{endpoint}/settings/tokens, and type: hf auth login (or set HF_TOKEN)"
        )
    return endpoint


def send(repo: str, files: Mapping[str, bytes], private: bool) -> str:
    """Send files to a repository as one commit; return its address.

    A repository that does not exist is created. Its other files stay.

    Args:
        repo: repository, `user/name`.
        files: contents by name.
        private: whether a repository that is created is visible to the user alone.

    Raises:
        InputError: the repository cannot be written to.
    """
    api = _api()
    from huggingface_hub import CommitOperationAdd

    added = [CommitOperationAdd(name, contents) for name, contents in files.items()]
    with _one_line_errors(repo, api.endpoint):
        api.create_repo(repo, private=private, exist_ok=True)
        api.create_commit(repo, added, commit_message=f"Add {next(iter(files))} and its card")
    return f"{api.endpoint}/{repo}"


def fetch(repo: str, file: str | None, out: str | None, console: Console) -> list[Path]:
    """Fetch a repository's checkpoint and its card into a new folder; return their paths.

    The checkpoint is checked as any other one. No file is left if it cannot be used.

    Args:
        repo: repository, `user/name`.
        file: name of the checkpoint; None for the only one.
        out: folder; None for one named by the repository.
        console: console for progress.

    Raises:
        InputError: the repository cannot be read, or has not that one checkpoint; the checkpoint
            is larger than announced, another one than the card describes, or damaged; or the
            folder exists.
    """
    api = _api()
    with _one_line_errors(repo, api.endpoint):
        files = api.model_info(repo, files_metadata=True, timeout=WAIT_S).siblings or []
        sizes = {str(file.rfilename): file.size for file in files[:MOST_FILES]}
        hashes = {str(file.rfilename): file.lfs.sha256 for file in files[:MOST_FILES] if file.lfs}
    name = _chosen(repo, file, sizes)
    size = sizes[name]
    if not isinstance(size, int) or not 0 < size <= MOST_BYTES:
        raise InputError(f"{repo}: {name} has {size} bytes, not 1..{MOST_BYTES:,}; it is not read")
    folder = Path(out or f"outputs/hub/{repo}").expanduser()
    refuse_existing(folder)
    with whole_folder(folder) as part:
        with progress_bar(f"fetching {name}", console) as progress:
            digest = _download(api, repo, name, size, part / name, progress)
        if CARD in sizes:
            _download(api, repo, CARD, MOST_CARD_BYTES, part / CARD)
        card = (part / CARD).read_bytes() if CARD in sizes else b""
        _check_hash(repo, name, digest, hashes.get(name), card)
        _check(part / name, f"{repo}: {name}")
    return [folder / member for member in (name, CARD) if member == name or card]


def _api() -> "HfApi":
    with optional_import('huggingface_hub is not installed; pip install "drivezoo[hub]"'):
        from huggingface_hub import HfApi, constants
        from huggingface_hub.utils import disable_progress_bars, logging
    # No statistics of the library's use, and no lines of its own among the command's.
    constants.HF_HUB_DISABLE_TELEMETRY = True
    disable_progress_bars()
    logging.set_verbosity_error()
    return HfApi(endpoint=os.environ.get("HF_ENDPOINT", "").rstrip("/") or None)


@contextmanager
def _one_line_errors(repo: str, endpoint: str) -> Iterator[None]:
    """Raise InputError for each error of the library, of the network or of the server's answer."""
    from huggingface_hub.errors import HfHubHTTPError, RepositoryNotFoundError
    from huggingface_hub.errors import HTTPError as NetworkError

    try:
        yield
    except RepositoryNotFoundError:
        raise InputError(
            f"{repo}: no such repository at {endpoint}, or it is private; check the name, or log "
            "in: hf auth login"
        ) from None
    except HfHubHTTPError as error:
        status = getattr(error.response, "status_code", None)
        reason = f"{status} {error.server_message or ''}".strip() if status else str(error)
        fix = "; the token may not write there: hf auth login" if status in (401, 403) else ""
        raise InputError(f"{repo}: {endpoint} answered {reason:.300}{fix}") from None
    except (NetworkError, OSError) as error:
        reason = str(error) or type(error).__name__
        raise InputError(f"{endpoint}: cannot be reached ({reason:.200}); try later") from None
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise InputError(f"{repo}: {endpoint} answered wrongly ({reason:.200})") from None


def _chosen(repo: str, file: str | None, sizes: Mapping[str, Any]) -> str:
    """Return the name of the checkpoint to fetch, which is no path."""
    names = sorted(name for name in sizes if _NAME.fullmatch(name))
    chosen = [name for name in names if file in (None, name)]
    if len(chosen) == 1:
        return chosen[0]
    listed = ", ".join(names[:10]) or "no .ckpt file in its top folder"
    raise UsageError(f"{repo}: has {listed}; name one with file=, or another repository")


def _download(
    api: "HfApi",
    repo: str,
    name: str,
    most: int,
    path: Path,
    progress: Callable[[float], None] = lambda share: None,
) -> str:
    """Write a repository's file of at most `most` bytes to a new file; return its SHA-256.

    Raises:
        InputError: the repository cannot be read, or sends more bytes.
        OSError: the file cannot be written.
    """
    digest, got = hashlib.sha256(), 0
    with path.open("xb") as file, closing(_chunks(api, repo, name)) as chunks:
        for chunk in chunks:
            got += len(chunk)
            if got > most:
                raise InputError(f"{repo}: {name} is larger than {most:,} bytes; it is not kept")
            file.write(chunk)
            digest.update(chunk)
            progress(got / most)
    return digest.hexdigest()


def _chunks(api: "HfApi", repo: str, name: str) -> Generator[bytes, None, None]:
    from huggingface_hub import hf_hub_url
    from huggingface_hub.utils import build_hf_headers, get_session, hf_raise_for_status

    url = hf_hub_url(repo, name, endpoint=api.endpoint)
    # Without compression: a small answer cannot become a large file.
    headers = build_hf_headers() | {"Accept-Encoding": "identity"}
    asked = get_session().stream("GET", url, headers=headers, timeout=WAIT_S)
    with _one_line_errors(repo, api.endpoint), asked as answer:
        hf_raise_for_status(answer)
        yield from answer.iter_bytes()


def _check_hash(repo: str, name: str, digest: str, listed: str | None, card: bytes) -> None:
    """Raise InputError if a hash of the repository or of its card is not the file's."""
    named = described_hash(card.decode(errors="replace"))
    for wanted, by in ((listed, "the repository's list"), (named, "its card")):
        if wanted and wanted != digest:
            raise InputError(
                f"{repo}: {name} is not the file that {by} describes (SHA-256 {digest[:16]}..., "
                f"not {wanted[:16]:.16}...); try again, or ask its author"
            )


def _check(path: Path, name: str) -> None:
    """Check a checkpoint; the network of a part that the user has not named is not built."""
    try:
        contents = read_checkpoint_file(path)
        check_card(contents["drivezoo"], path)
        if not contents["drivezoo"].get("parts"):
            build_checkpoint(contents, path)
    except InputError as error:
        raise InputError(str(error).replace(str(path), name)) from None
