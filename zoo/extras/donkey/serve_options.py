"""Keys of `drivezoo simulator serve`."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field


@dataclass(frozen=True, kw_only=True)
class ServeOptions:
    """Keys of a server.

    Args:
        protocol: donkey, the protocol of the Donkeycar simulator.
        host: address to listen on; 0.0.0.0 lets other machines connect.
        port: TCP port to listen on; 0: any free one.
        scene: scene that is loaded when a client connects; null: the client chooses.
        rate: telemetry messages per second, 1..50; max: one for each control, as fast as possible.
        clients: number of clients at the same time, each with a car and a world of its own.
        tub: folder in which a client records; the rig.yaml of its camera and car is written there.
        renderer: auto, software or opengl.
    """

    protocol: Literal["donkey"] = "donkey"
    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 9091
    scene: str | None = None
    rate: Annotated[float, Field(ge=1, le=50)] | Literal["max"] = 20.0
    clients: Annotated[int, Field(ge=1, le=64)] = 4
    tub: str | None = None
    renderer: Literal["auto", "software", "opengl"] = "auto"
