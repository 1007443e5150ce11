"""What every simulator of `drivezoo drive world=NAME` promises, that of a package among them."""

import socket
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import eventlet
import pytest

from tests.contracts.outside_package import installed, manual_example
from zoo.base.entry_points import load_named, named_entries
from zoo.base.notices import Notices
from zoo.driving.speed_controller import Constant, SteeringFilter
from zoo.server.drive_writer import BackgroundWriter
from zoo.server.driven_simulator import SIMULATORS, DrivenSimulator
from zoo.server.driver import Driver

WAIT_S = 20.0


@pytest.fixture(params=("mine", *sorted(named_entries(SIMULATORS))))
def kind(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[type[DrivenSimulator]]:
    code = manual_example("my_simulator.py")
    with installed(tmp_path / "site", code, SIMULATORS, attribute=":StillSimulator"):
        yield load_named(SIMULATORS, request.param, DrivenSimulator)


def make_driver(folder: Path) -> Driver:
    parts = Constant(0.2), SteeringFilter(), BackgroundWriter(folder, Notices()), Notices()
    return Driver(lambda frame, mph: (0.1, None), *parts)


def test_a_simulator_drives_or_names_a_failure(kind: type[DrivenSimulator], tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}/road"  # which nothing listens on
    driver = make_driver(tmp_path / "drive")
    simulator = kind(driver, address, None, True)
    simulator.start()
    with eventlet.Timeout(WAIT_S):
        while not simulator.ended:
            eventlet.sleep(0.01)
    failure = simulator.stop()
    assert (driver.end(datetime.now()) is None) == bool(failure)
    assert failure.startswith(address) or not failure
    assert "\n" not in failure


def test_a_simulator_is_stopped_before_its_end(kind: type[DrivenSimulator], tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        driver = make_driver(tmp_path / "drive")
        simulator = kind(driver, f"127.0.0.1:{silent.getsockname()[1]}/road", None, True)
        simulator.start()
        eventlet.sleep(0.1)
        assert not simulator.ended
        assert simulator.stop() == ""
        assert simulator.ended
        driver.end(datetime.now())
