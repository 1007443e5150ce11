"""The contract of a simulator that a drive on the socket starts, or connects to."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from zoo.server.driver import Driver  # slow import

SIMULATORS = "drivezoo.simulators"  # entry points: classes that are derived from the one below


class DrivenSimulator(ABC):
    """A simulator that is driven while `drivezoo drive` serves the page, in green threads.

    Args:
        driver: driver that answers telemetry.
        address: `HOST:PORT/SCENE`, from the keys of the command.
        laps: laps after which it ends; None drives until `stop`.
        put_back: whether an intervention puts the car back on the road.
    """

    @abstractmethod
    def __init__(self, driver: Driver, address: str, laps: float | None, put_back: bool) -> None:
        """Take what the drive needs; nothing is connected yet."""

    @abstractmethod
    def start(self) -> None:
        """Connect, and drive."""

    @property
    @abstractmethod
    def ended(self) -> bool:
        """Whether the drive has ended by itself."""

    @abstractmethod
    def stop(self) -> str:
        """End the drive; return what failed, empty if nothing did."""
