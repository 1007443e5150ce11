"""`drivezoo drive world=donkey`: a network that drives in a Donkeycar simulator."""

import socket
import subprocess
from datetime import datetime
from pathlib import Path

import eventlet
import numpy as np
import pytest

from datamodules.recorded_car import other_car
from datamodules.recording_format import read_recordings
from tests.zoo.command_runs import only_line, run, succeed
from tests.zoo.extras.donkey.donkey_process import donkey_simulator
from tests.zoo.extras.donkey.donkey_replica import donkey_replica, telemetry
from tests.zoo.server.serve import red_policy
from tests.zoo.server.test_driver import Bend
from zoo.base.errors import InputError
from zoo.base.notices import Notices
from zoo.base.rig import RIGS
from zoo.driving.drive_log import read_drive
from zoo.driving.speed_controller import Constant, SteeringFilter
from zoo.extras.donkey.donkey_client import DonkeyClient
from zoo.extras.donkey.donkey_server import serve_clients
from zoo.extras.donkey.donkey_world import DonkeyWorld
from zoo.extras.donkey.serve_options import ServeOptions
from zoo.server.drive_writer import BackgroundWriter
from zoo.server.driver import Driver


def drive(cwd: Path, *arguments: str) -> subprocess.CompletedProcess:
    return run(cwd, "lenet", "world=donkey", *arguments, module="zoo.commands.drive")


def test_a_donkeycar_simulator_is_driven_until_it_ends(tmp_path: Path) -> None:
    with donkey_simulator("rate=max") as (port, _):
        options = (f"port={port}", "scene=lake", "laps=0.01", "page=0", "record=drive")
        assert "simulator 1 has connected" in succeed(drive(tmp_path, *options))
    record = read_drive(tmp_path / "drive")
    assert record.summary["track"] == f"127.0.0.1:{port}/lake"
    assert record.summary["autonomy"] is not None
    assert record.speed_mph.max() > 2
    assert np.isfinite(record.cross_track_m).all()
    recording = read_recordings(str(tmp_path / "drive"))
    assert len(recording) == len(record)
    assert recording.image(0).shape == (120, 160, 3)
    assert recording.rig == RIGS["donkey_sim"]
    assert other_car(recording) == "lake"


def change_at_20(number: int, message: dict) -> dict:
    """Drive off the road at once, and send another size of frames after 20 messages."""
    changed = telemetry(number, (60, 80)) if number >= 20 else message
    return changed | {"cte": 9.0, "speed": 4.0}


@pytest.mark.parametrize("put_back", [True, False])
def test_a_failing_simulator_leaves_a_line_and_the_drive(tmp_path: Path, put_back: bool) -> None:
    with donkey_replica(change_at_20) as (address, received):
        port = address.partition(":")[2].partition("/")[0]
        options = ("scene=oval", "page=0", "record=drive", f"put_back={str(put_back).lower()}")
        result = drive(tmp_path, f"port={port}", *options)
    assert result.returncode == 1
    (line,) = result.stderr.splitlines()[-1:]
    assert f"{address}: the simulator failed: its frames changed" in line
    record = read_drive(tmp_path / "drive")
    assert record.summary["interventions"] == record.summary["off_road"] >= 1
    assert put_back == ("set_position" in {message["msg_type"] for message in received})


@pytest.mark.parametrize(
    ("image", "mps", "paused"), [("", 9.0, False), ("AAAA", 1.0, False), (None, 1.0, True)]
)
def test_a_pause_and_a_damaged_image_are_braked_for(
    tmp_path: Path, image: str | None, mps: float, paused: bool
) -> None:
    def change(number: int, message: dict) -> dict | None:
        damaged = {"image": image} if number == 5 else {}
        return message | {"speed": mps} | damaged if number < 10 else None

    notices = Notices(lambda line: None)
    writer = BackgroundWriter(tmp_path / "drive", notices, "oval")
    driver = Driver(red_policy, Constant(0.2), SteeringFilter(), writer, notices)
    driver.paused = paused
    with donkey_replica(change) as (address, received):
        client = DonkeyClient(driver, address, 1, put_back=True)
        client.start()
        while not client.ended:
            eventlet.sleep(0.01)
    assert driver.latest().steering_deg is None, "degrees of an unknown car are not shown"
    assert (driver.tally.telemetry, driver.tally.fallbacks) == (9, 1)
    braked = [message["brake"] for message in received if message["msg_type"] == "control"]
    assert braked[5:7] == ["0.2" if paused else "0.0", "0.2"]


def test_a_network_of_curvature_is_refused_in_an_unknown_car(tmp_path: Path) -> None:
    notices = Notices(lambda line: None)
    writer = BackgroundWriter(tmp_path / "drive", notices, "oval")
    driver = Driver(Bend(), Constant(0.2), SteeringFilter(), writer, notices)
    with donkey_replica(lambda number, message: message) as (address, _):
        client = DonkeyClient(driver, address, 1, put_back=True)
        client.start()
        while not client.ended:
            eventlet.sleep(0.01)
    assert "data.label=curvature, and the rig of the driven car is unknown" in client.stop()
    assert driver.end(datetime.now()) is None


@pytest.mark.parametrize(("host", "reason"), [("192.0.2.1", "Cannot assign"), (None, "in use")])
def test_an_address_that_cannot_be_listened_on_is_named(host: str | None, reason: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        host, port = host or "127.0.0.1", taken.getsockname()[1]
        with pytest.raises(InputError, match=f"^host={host} port={port}: .*{reason}.*; try"):
            serve_clients(ServeOptions(host=host, port=port))


def test_an_address_of_ipv6_is_listened_on_and_connected_to() -> None:
    with donkey_simulator("host=::1") as (port, _):
        DonkeyWorld(f"::1:{port}/lake").close()


def test_two_simulators_at_once_are_refused(tmp_path: Path) -> None:
    assert "sim=lake: world=donkey is driven; drop one" in only_line(drive(tmp_path, "sim=lake"))
