"""The private names of libraries that the driver's WebSockets and sessions build on."""

from importlib.metadata import version

import engineio
import engineio.socket
import pytest
import socketio
from eventlet import websocket

CHECKED = {"eventlet": "0.41.3", "python-engineio": "4.15.1", "python-socketio": "5.18.1"}
USED = {
    (websocket.RFC6455WebSocket, "eventlet"): (
        *("Message", "UTF8Decoder", "_apply_mask", "_iter_frames", "_recv_frame"),
        *("_send_closing_frame", "wait", "send", "close"),
    ),
    (websocket.WebSocketWSGI, "eventlet"): (
        *("_handle_hybi_request", "_negotiate_permessage_deflate"),
    ),
    (engineio.socket.Socket, "python-engineio"): ("_send_ping", "_websocket_handler", "close"),
    (engineio.Server, "python-engineio"): ("start_background_task",),
    (socketio.Server, "python-socketio"): (
        *("_engineio_server_class", "_handle_connect", "_handle_disconnect"),
        *("_handle_eio_connect", "_handle_eio_disconnect", "_handle_eio_message"),
    ),
}


@pytest.mark.parametrize(("kind", "package"), USED)
def test_a_library_has_what_the_driver_overrides(kind: type, package: str) -> None:
    gone = [name for name in USED[kind, package] if not hasattr(kind, name)]
    assert not gone, (
        f"{package} {version(package)} has no {kind.__name__}.{gone[0]} any more: look at what "
        f"zoo/server/fast_socket.py and socketio_server.py do with it; {CHECKED[package]} had it"
    )


def test_a_server_has_the_tables_that_the_driver_reads() -> None:
    server = socketio.Server(async_mode="eventlet")
    for owner, name in ((server, "_binary_packet"), (server.eio, "_async")):
        assert isinstance(getattr(owner, name, None), dict), (
            f"{type(owner).__module__} has no {name} any more: look at zoo/drive; checked with "
            f"{CHECKED}"
        )
