"""Requests that try to fill or control the terminal, or to press the page's buttons."""

import contextlib
import json
import re
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.zoo import page_requests
from tests.zoo.server.old_client import OldClient
from tests.zoo.server.serve import Served, picture, served
from tests.zoo.written_checkpoints import write_constant

ESCAPE = "\x1b[2J\x1b]0;owned\x07"
BAD = [
    b"\x1b[2J\x1b[31m / HTTP/1.1\r\n\r\n",
    b"GET / HTTP/9.9\r\n\r\n",
    b"GET / HTTP/\x1b[2J\r\n\r\n",
    b"GET\r\n\r\n",
    b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 200 + b"\r\n",
    b"GET /" + b"a" * 20_000 + b" HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.1\r\nA: " + b"b" * 10_000 + b"\r\n\r\n",
    b"GET / HTTP/1.1\r\nContent-Length: -5\r\n\r\n",
    b"GET / HTTP/1.1\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\xde\xad\r\n",
    b"GET /\x1b[2J HTTP/1.1\r\nHost: \x1b[2Jx\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://\x1b]0;owned\x07\r\n\r\n",
    b"GET /socket.io/?EIO=3&transport=\x1b[2J HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    b"GET /socket.io/?EIO=4&transport=polling&sid=\x1b[2J HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    b"\x1b[2J /socket.io/?EIO=4 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
]


def ask(port: int, request: bytes) -> bytes:
    """Return the driver's answer, up to the end of the connection."""
    answer = b""
    connection = socket.create_connection(("127.0.0.1", port), 5)
    with connection, contextlib.suppress(OSError):
        connection.sendall(request)
        while more := connection.recv(4096):
            answer += more
    return answer


def test_bad_requests_print_one_line_of_a_kind(fresh: Served) -> None:
    with OldClient(fresh.port) as simulator:
        for request in 5 * BAD:
            assert not ask(fresh.port, request).startswith(b"HTTP/1.1 200"), request
            simulator.check_steered()
    assert fresh.stop() == 0
    kinds = [line for line in fresh.lines if "printed once" in line]
    assert len(kinds) == len({line.partition(":")[0] for line in kinds}) < 10
    assert any("(400)" in line for line in kinds)
    assert any(line.endswith("(400)") for line in fresh.lines), "the number at the end"
    assert len(fresh.lines) < 35, fresh.lines


def test_no_control_character_reaches_the_terminal(fresh: Served) -> None:
    for request in BAD:
        ask(fresh.port, request)
    for message in ('42["telemetry","' + ESCAPE + '"]', "4" + ESCAPE, "40/" + ESCAPE + ","):
        with OldClient(fresh.port) as client:
            client.send(message)
            client.telemetry(jpeg=picture((9, 9, 9)), speed=ESCAPE)
            client.reply()
            client.telemetry(image=ESCAPE)
            client.reply()
    assert fresh.stop() == 0
    text = "\n".join(fresh.lines)
    assert not re.search(r"[^\n\x20-\x7e]", text), repr(text)
    assert r"\x1b[2J" in text, "shown as text"


# --- The buttons of an exposed page ---


@pytest.fixture(scope="module")
def exposed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Start a driver that other machines can reach."""
    folder = tmp_path_factory.mktemp("exposed")
    checkpoint = write_constant(folder / "best.ckpt", 0.1)
    options = (str(checkpoint), "drive.host=0.0.0.0", "drive.expose=true", "drive.port=0")
    with served(folder / "drive", "zoo.commands.drive", *options) as process:
        process.lines.append(process.process.stdout.readline().strip())
        yield process


def command(driver: Served, query: str) -> tuple[int, dict]:
    status, _, answer = page_requests.ask(driver.port, "POST", f"/command{query}", {"pause": True})
    return status, json.loads(answer)


def token(driver: Served) -> str:
    (line,) = (line for line in driver.lines if "?token=" in line)
    return re.search(r"\?token=([\w-]{20,})", line)[1]


@pytest.mark.parametrize("query", ["", "?token=", "?token=x", "?token=%00%ff", "?nekot={}"])
def test_a_command_without_the_token_is_refused(exposed: Served, query: str) -> None:
    status, answer = command(exposed, query.format(token(exposed)))
    assert status == 403
    assert "?token=" in answer["error"]


def test_a_command_with_the_token_is_accepted(exposed: Served) -> None:
    status, state = command(exposed, f"?token={token(exposed)}")
    assert status == 200
    assert state["paused"] is True


def test_reading_needs_no_token_and_reveals_none(exposed: Served) -> None:
    for path in (b"/", b"/page.js", b"/state.json", b"/checkpoints.json"):
        answer = ask(exposed.port, b"GET %s HTTP/1.1\r\nHost: a.example\r\n\r\n" % path)
        assert answer.startswith(b"HTTP/1.1 200"), answer
        assert token(exposed).encode() not in answer


def test_the_terminal_names_what_needs_the_token(exposed: Served) -> None:
    (line,) = (line for line in exposed.lines if line.startswith("warning: every machine"))
    assert "watch" in line
    assert "buttons" in line


def test_on_this_machine_alone_no_token_is_needed(tmp_path: Path) -> None:
    words = ("zoo.commands.drive", str(write_constant(tmp_path / "best.ckpt", 0.1)), "drive.port=0")
    with served(tmp_path / "drive", *words) as driver:
        assert command(driver, "")[0] == 200
        assert driver.stop() == 0
    assert not any("token" in line for line in driver.lines)
