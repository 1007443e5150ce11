"""Private parts of libraries, for which there is no public way: each test says who needs it."""

from importlib import import_module

import pytest
import socketio

PARTS = {
    "hydra._internal.callbacks:Callbacks": "zoo.runs.run_folder.run_in_folder calls the callbacks",
    "hydra._internal.core_plugins.basic_sweeper:BasicSweeper.split_arguments": (
        "zoo.training.sweep_jobs divides a sweep into jobs"
    ),
    "lightning.fabric.strategies.launchers.subprocess_script:_ChildProcessObserver": (
        "zoo.training.distributed.Watch replaces it"
    ),
}
OVERRIDDEN = {
    "eventlet.websocket:RFC6455WebSocket": (
        *("Message", "UTF8Decoder", "_apply_mask", "_iter_frames", "_recv_frame"),
        *("_send_closing_frame", "wait", "send", "close"),
    ),
    "eventlet.websocket:WebSocketWSGI": ("_handle_hybi_request", "_negotiate_permessage_deflate"),
    "engineio.socket:Socket": ("_send_ping", "_websocket_handler", "close"),
    "engineio:Server": ("start_background_task",),
    "socketio:Server": (
        *("_engineio_server_class", "_handle_connect", "_handle_disconnect"),
        *("_handle_eio_connect", "_handle_eio_disconnect", "_handle_eio_message"),
    ),
}
SERVER = "zoo/server/fast_socket.py and socketio_server.py need it"
PARTS |= {f"{owner}.{name}": SERVER for owner, names in OVERRIDDEN.items() for name in names}


@pytest.mark.parametrize("part", PARTS)
def test_a_private_part_is_where_it_was(part: str) -> None:
    module, _, names = part.partition(":")
    owner = import_module(module)
    for name in names.split("."):
        owner = getattr(owner, name, None)
    assert owner is not None, f"{part} is gone: {PARTS[part]}; find another way there"


def test_a_server_has_the_tables_that_the_driver_reads() -> None:
    server = socketio.Server(async_mode="eventlet")
    assert isinstance(server._binary_packet, dict), SERVER
    assert isinstance(server.eio._async, dict), SERVER


def test_lightnings_watch_of_its_processes_has_a_list() -> None:
    """`Watch` finds it among the threads, and empties its list."""
    from lightning.fabric.strategies.launchers.subprocess_script import _ChildProcessObserver

    observer = _ChildProcessObserver(main_pid=1, child_processes=[])
    assert observer._child_processes == [], "see zoo.training.distributed.Watch"
