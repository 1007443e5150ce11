"""A page that a command serves: its requests and answers, headers, commands, refusals."""

import hmac
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from http import HTTPStatus
from itertools import chain
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from pydantic import TypeAdapter, ValidationError

MOST_COMMAND = 4096  # bytes of a command
# Content type of the page's files, by their ending.
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}
STATIC = Path(__file__).with_name("static")  # what all pages share
# Another site can neither embed the page, to make users click its buttons, nor show its images.
HEADERS = [
    ("Cache-Control", "no-store"),
    (
        "Content-Security-Policy",
        "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'",
    ),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("X-Content-Type-Options", "nosniff"),
    ("Referrer-Policy", "no-referrer"),  # the address may hold the token
]

Answer = tuple[bytes, str]  # body and content type


class RequestError(Exception):
    """A refused request.

    Args:
        status: HTTP status of the answer.
        line: reason, shown to the user.
    """

    def __init__(self, status: HTTPStatus, line: str) -> None:
        super().__init__(line)
        self.status = status


class ServedPage(ABC):
    """WSGI application of a page: its files, answers that it polls, and commands that it posts.

    Args:
        folder: folder of the page's files; `index.html` is served as `/`.
        answers: functions of the query, by path.
        token: token that the address of a command must contain, `?token=...`; None if only this
            machine can send commands.
        further: folders of modules that several pages share.
    """

    def __init__(
        self,
        folder: Path,
        answers: Mapping[str, Callable[[dict], Answer]],
        token: str | None = None,
        further: Sequence[Path] = (),
    ) -> None:
        self._answers, self.token = answers, token
        self._files = {
            f"/{path.name}".replace("/index.html", "/"): (path.read_bytes(), KINDS[path.suffix])
            for path in chain.from_iterable(each.iterdir() for each in (STATIC, *further, folder))
            if path.suffix in KINDS
        }

    def __call__(self, environ: dict, start_response: Callable) -> Iterable[bytes]:
        """Answer a request; a refused one with its error as JSON."""
        status = HTTPStatus.OK
        try:
            body, kind = self._answer(environ)
        except RequestError as error:
            status = error.status
            body, kind = json_answer({"error": str(error)})
        headers = [("Content-Type", kind), ("Content-Length", str(len(body)))]
        headers += self._headers(environ)
        start_response(f"{status.value} {status.phrase}", headers)
        return [body]

    def _answer(self, environ: dict) -> Answer:
        """Return the answer to a request, by its path.

        Raises:
            RequestError: the path is unknown, or its method is another one.
        """
        method, path = environ["REQUEST_METHOD"], environ.get("PATH_INFO", "")
        if path == "/command":
            if method != "POST":
                raise RequestError(HTTPStatus.METHOD_NOT_ALLOWED, "/command: send it with POST")
            self._check_token(parse_qs(environ.get("QUERY_STRING", "")))
            return self._command(environ)
        if path not in self._files and path not in self._answers:
            raise RequestError(HTTPStatus.NOT_FOUND, f"{path[:80]}: not found; the page is at /")
        if method != "GET":
            raise RequestError(HTTPStatus.METHOD_NOT_ALLOWED, f"{path}: read it with GET")
        if path in self._files:
            return self._files[path]
        return self._answers[path](parse_qs(environ.get("QUERY_STRING", "")))

    def _headers(self, environ: dict) -> Sequence[tuple[str, str]]:
        return HEADERS

    def _check_token(self, query: dict) -> None:
        token = query.get("token", [""])[0]
        if self.token and not hmac.compare_digest(token.encode(), self.token.encode()):
            line = "token: wrong or missing; open the address with ?token= that drivezoo printed"
            raise RequestError(HTTPStatus.FORBIDDEN, line)

    @abstractmethod
    def _command(self, environ: dict) -> Answer:
        """Run a posted command, and return the answer to it."""


def read_command(environ: dict, kinds: Mapping[str, Any]) -> tuple[str, Any]:
    """Return the name and value of a posted command, an object with one key.

    Args:
        environ: WSGI environment of the request.
        kinds: type of each command's value.

    Raises:
        RequestError: the command is no JSON, too long, unknown, of another type, or does not
            arrive in time.
    """
    # A form of another site cannot send JSON. Its script can, but with an Origin, which the
    # guard refuses.
    if environ.get("CONTENT_TYPE", "").partition(";")[0].strip() != "application/json":
        line = "Content-Type: must be application/json"
        raise RequestError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, line)
    length = environ.get("CONTENT_LENGTH") or ""
    # Python reads no number of thousands of digits.
    if not length.isdecimal() or len(length) > 9 or int(length) > MOST_COMMAND:
        line = f"Content-Length: must be a number up to {MOST_COMMAND}"
        raise RequestError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, line)
    try:
        command = json.loads(environ["wsgi.input"].read(int(length)))
    except OSError:
        raise RequestError(HTTPStatus.REQUEST_TIMEOUT, "the command did not arrive") from None
    except (ValueError, RecursionError):
        raise RequestError(HTTPStatus.BAD_REQUEST, "the command is no JSON") from None
    if not isinstance(command, dict) or len(command) != 1 or not set(command) & {*kinds}:
        names = ", ".join(kinds)
        raise RequestError(
            HTTPStatus.BAD_REQUEST, f"the command must be an object with one key of {names}"
        )
    ((name, value),) = command.items()
    try:  # as JSON, in which a list is a set, too
        return name, TypeAdapter(kinds[name]).validate_json(json.dumps(value), strict=True)
    except ValidationError as error:
        line = f"{name}: {value!r:.40}: {error.errors()[0]['msg']}"
        raise RequestError(HTTPStatus.BAD_REQUEST, line) from None


def json_answer(value: object) -> Answer:
    """Return the body and content type of a JSON answer."""
    return json.dumps(value).encode(), "application/json"
