"""A small replica of a Donkeycar simulator, whose telemetry a test changes."""

import base64
import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import cv2
import numpy as np

# From number and telemetry to what is sent; None closes the connection, {} sends nothing.
Change = Callable[[int, dict], dict | None]
ANSWERS = {
    "get_scene_names": {"msg_type": "scene_names", "scene_names": ["oval"]},
    "load_scene": {"msg_type": "car_loaded"},
    "get_protocol_version": {"msg_type": "protocol_version", "version": "2"},
    "node_position": {"msg_type": "node_position"}
    | dict.fromkeys(("pos_x", "pos_y", "pos_z", "Qx", "Qy", "Qz", "Qw"), 0.0),
}


def telemetry(number: int, size: tuple[int, int] = (120, 160)) -> dict:
    """Return the telemetry of a car that stands."""
    jpeg = cv2.imencode(".jpg", np.full((*size, 3), 90, np.uint8))[1].tobytes()
    state = dict.fromkeys(("pos_x", "pos_y", "pos_z", "cte", "steering_angle"), 0.0)
    state |= {"activeNode": number, "totalNodes": 100}
    image = base64.b64encode(jpeg).decode()
    return {"msg_type": "telemetry", "time": number / 20, "speed": 1, "image": image, **state}


@contextmanager
def donkey_replica(
    change: Change, each: int = 1, crossed: tuple[str, ...] = ()
) -> Iterator[tuple[str, list[dict]]]:
    """Serve a client; yield the address of a scene, and the messages that the client sends.

    Args:
        change: change of the telemetry.
        each: number of telemetry messages for each control.
        crossed: kinds of messages before whose answer the car crosses the starting line twice.
    """
    listener = socket.create_server(("127.0.0.1", 0))
    received: list[dict] = []

    def serve() -> None:
        connection, _ = listener.accept()
        number, text = 0, ""

        def send(*messages: dict) -> None:
            connection.sendall(b"".join(json.dumps(packet).encode() + b"\n" for packet in messages))

        with connection, suppress(OSError):  # the client has left
            send({"msg_type": "scene_selection_ready"})
            while data := connection.recv(65_536):
                text += data.decode()
                while "}" in text:
                    message, _, text = text.partition("}")
                    received.append(json.loads(message + "}"))
                    kind = received[-1]["msg_type"]
                    if kind in crossed:
                        send(*[{"msg_type": "collision_with_starting_line"}] * 2)
                    if kind in ANSWERS:
                        send(ANSWERS[kind])
                    if kind != "control":
                        continue
                    numbers = range(number, number + each)
                    changed = [change(at, telemetry(at)) for at in numbers]
                    number += each
                    if None in changed:
                        return
                    send(*filter(None, changed))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    with listener:
        yield f"127.0.0.1:{listener.getsockname()[1]}/oval", received
        thread.join(5)  # until it has read what the client sent before it left
