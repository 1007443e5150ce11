"""The driver's memory while clients hold requests, messages and WebSockets open."""

import contextlib

import psutil
import pytest

from tests.hostile.attacker import ATTACKS, HALF, MOST_GROWTH_MB, POST, Attacker, megabytes
from tests.hostile.attacker import LARGE as LONGEST
from tests.hostile.test_driver_sessions import FINE, RED, assert_drives, assert_steered, closed
from tests.zoo.server.old_client import OldClient
from tests.zoo.server.serve import Served
from zoo.server.connections import MOST_HELD, MOST_QUIET_WEBSOCKETS

# Each attack would take over 150 MB of a driver without its limits.
LARGE = {
    "half-sent messages": 90,
    "half-sent after telemetry": 90,
    "half-sent polling requests": 90,
    "whole large messages": 60,
    "missing attachments": 60,
}


def grown(driver: Served, name: str, requests: int) -> float:
    """Return the largest growth of a driver's memory during an attack, in MB."""
    process, attacker = psutil.Process(driver.process.pid), Attacker(driver.port)
    before = peak = megabytes(process)
    for _ in range(requests):
        with contextlib.suppress(OSError, ValueError):
            ATTACKS[name](attacker)
        peak = max(peak, megabytes(process))
    attacker.close()
    return peak - before


@pytest.mark.parametrize(
    "name",
    [
        # In the sum that the driver limits, as those before telemetry.
        pytest.param(name, marks=[pytest.mark.slow] * (name == "half-sent after telemetry"))
        for name in LARGE
    ],
)
def test_large_messages_do_not_fill_the_memory(fresh: Served, name: str) -> None:
    with OldClient(fresh.port, timeout_s=10) as steady:
        assert_steered(steady)
        assert grown(fresh, name, LARGE[name]) < MOST_GROWTH_MB
        assert_steered(steady)
    assert_drives(fresh)


def test_lists_that_grow_when_read_are_answered_as_invalid(fresh: Served) -> None:
    with OldClient(fresh.port, timeout_s=10) as client:
        client.send_frame(1, b'42["telemetry"' + b",[]" * 600_000 + b"]")
        assert client.reply() == ("steer", {"steering_angle": "0", "throttle": "0"})
        assert_steered(client)
    assert fresh.stop() == 0
    assert not any("Traceback" in line for line in fresh.lines)


def test_the_oldest_websocket_without_telemetry_is_closed(fresh: Served) -> None:
    with OldClient(fresh.port) as steady:
        assert_steered(steady)
        quiet = [OldClient(fresh.port) for _ in range(MOST_QUIET_WEBSOCKETS + 5)]
        assert closed(quiet[0].socket)
        assert_steered(steady)
    quiet[-1].telemetry(jpeg=RED)
    assert quiet[-1].reply() == FINE, "the newest stays open"
    for client in quiet:
        client.socket.close()


def test_the_largest_unfinished_message_is_closed_and_logged(fresh: Served) -> None:
    small = OldClient(fresh.port)
    small.send_frame(1, b'42["telem', last=False)
    attacker = Attacker(fresh.port)
    oldest = attacker.websocket()
    oldest.sendall(HALF)
    for _ in range(MOST_HELD // LONGEST + 4):
        with contextlib.suppress(OSError):
            ATTACKS["half-sent messages"](attacker)
    assert closed(oldest)
    small.send_frame(0, b'etry",{}]')
    assert small.reply()[0] == "steer"
    attacker.close()
    assert fresh.stop() == 0
    assert any("unfinished" in line and "127.0.0.1" in line for line in fresh.lines)


def test_a_request_that_is_itself_the_largest_is_closed(fresh: Served) -> None:
    attacker = Attacker(fresh.port)
    for _ in range(MOST_HELD // LONGEST - 1):
        ATTACKS["half-sent messages"](attacker)
    post = attacker.connect(POST % (b"none", LONGEST))
    assert closed(post)
    attacker.close()
    assert_drives(fresh)
    assert fresh.stop() == 0
    assert not any("Traceback" in line or "failed" in line for line in fresh.lines)
