"""Socket.IO of today that also serves the original simulator's client, which is of 2016.

That client says `EIO=4` and speaks Engine.IO 3: it never asks to be connected to a namespace, so
that today's server drops its telemetry in silence and the car never moves. Engine.IO's part of the
cure, PINGs that come from the client, is in `fast_socket`.
"""

import logging

import engineio
import socketio

from zoo.driving.fast_socket import MAX_MESSAGE, FastWebSocketWSGI

FIRST_EVENT = "2["  # an event in the default namespace, as Socket.IO writes it
TELEMETRY = '2["telemetry"'


class FastEngine(engineio.Server):
    """Engine.IO on eventlet, with our WebSockets."""

    def __init__(self, **options: object) -> None:
        super().__init__(**options)
        self._async = self._async | {"websocket": FastWebSocketWSGI}


class SimulatorServer(socketio.Server):
    """Serves clients of 2016 and of today; events run in order, and within their session's task.

    Args:
        logger: told of what clients do wrong.
        origin_allowed: engineio's `cors_allowed_origins`, asked of requests with an Origin.
    """

    def __init__(self, logger: logging.Logger, origin_allowed: object) -> None:
        super().__init__(
            logger=logger,
            engineio_logger=logger,
            async_mode="eventlet",
            async_handlers=False,
            cors_allowed_origins=origin_allowed,
            max_http_buffer_size=MAX_MESSAGE,
        )
        self._silent: set[str] = set()  # Engine.IO sessions that have not sent a message yet

    def _engineio_server_class(self) -> type[engineio.Server]:
        return FastEngine

    def _handle_eio_connect(self, eio_sid: str, environ: dict) -> None:
        self._silent.add(eio_sid)
        super()._handle_eio_connect(eio_sid, environ)

    def _handle_eio_disconnect(self, eio_sid: str, reason: str) -> None:
        self._silent.discard(eio_sid)
        super()._handle_eio_disconnect(eio_sid, reason)

    def _handle_eio_message(self, eio_sid: str, data: str | bytes) -> None:
        first = eio_sid in self._silent
        self._silent.discard(eio_sid)
        # Only the first message: a client that was sent away later must stay away.
        if first and isinstance(data, str) and data.startswith(FIRST_EVENT):
            self._handle_connect(eio_sid, "/", None)
        try:
            super()._handle_eio_message(eio_sid, data)
        except (ValueError, RecursionError):
            # No JSON, or JSON that overflows the stack. The client waits for its reply for ever, so
            # it gets one as for any rubbish.
            if not (isinstance(data, str) and data.startswith(TELEMETRY)):
                raise
            super()._handle_eio_message(eio_sid, f'{TELEMETRY},"no JSON"]')
