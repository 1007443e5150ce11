"""`drivezoo drive`, as users start and end it."""

import json
import os
import shutil
import signal
import socket
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
import torch

from datamodules.image import decode_image
from datamodules.recording_format import read_recordings
from tests.recordings import Written
from tests.zoo.base.test_process_pool import wait_until
from tests.zoo.command_runs import only_line, run, succeed
from tests.zoo.server.old_client import OldClient
from tests.zoo.server.serve import served
from tests.zoo.server.test_live_page import until
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.commands.drive import EmbeddedClient
from zoo.driving.drive_log import read_drive
from zoo.driving.metrics import measure
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario


@pytest.fixture(scope="module")
def checkpoint(run_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a checkpoint whose name Hydra cannot parse."""
    folder = tmp_path_factory.mktemp("lr=0.1, [a] 'run'")
    return Path(shutil.copy(run_folder / "checkpoints" / "best.ckpt", folder / "best=1 (2).ckpt"))


def drive(cwd: Path, *arguments: object) -> object:
    return run(cwd, *map(str, arguments), module="zoo.commands.drive")


def test_a_drive_from_start_to_end(checkpoint: Path, recorded: Written, tmp_path: Path) -> None:
    folder = tmp_path / "my drive=1"
    pictures = [recorded.image(row).read_bytes() for row in range(0, 120, 6)]
    policy = load_policy(checkpoint)
    expected = [policy(decode_image(picture), 9.0)[0] for picture in pictures]
    command = ("zoo.commands.drive", str(checkpoint), "drive.port=0", f"drive.record={folder}")
    with served(folder, *command) as driver:
        with OldClient(driver.port) as client:
            steered = []
            for picture in pictures:
                client.telemetry(jpeg=picture, speed="9.0000")
                steered.append(float(client.reply()[1]["steering_angle"]))
            for _ in range(3):
                client.emit("telemetry", None)
                assert client.reply() == ("manual", {})
        assert driver.stop() == 0

    # The network gets the same pixels as in training: its steering for a JPEG on the socket is that
    # for the file.
    assert steered == pytest.approx(expected, abs=5e-5)

    printed = "\n".join(driver.lines)
    assert "PilotNet" in printed
    assert "23 telemetry" in printed
    assert "latency p50" in printed
    assert "1 intervention" in printed

    recording = read_recordings(str(folder))
    assert len(recording) == 20
    assert Path(recording.images[0, 0]).read_bytes() == pictures[0], "not compressed again"
    assert recording.images[0, 1] is None
    assert recording.steering == pytest.approx(expected, abs=1e-6)
    assert (np.diff(recording.time_s) > 0).all()

    record = read_drive(folder)
    assert len(record) == 23
    assert record.driver.tolist() == ["policy"] * 20 + ["person"] * 3
    assert record.intervention.sum() == record.intervention[20] == 1
    assert (folder / record.frame[5]).read_bytes() == pictures[5]
    assert record.summary["recorded_rows"] == 20
    summary = json.loads((folder / "drive.json").read_text())
    assert summary["interventions"] == 1
    assert [engine["name"] for engine in summary["engines"]] == ["torch"]


def test_a_drive_leaves_its_log_among_the_outputs(checkpoint: Path, tmp_path: Path) -> None:
    with served(tmp_path / "x", "zoo.commands.drive", str(checkpoint), "drive.port=0") as driver:
        with OldClient(driver.port) as client:
            client.telemetry(jpeg=b"no picture")
            client.reply()
        assert driver.stop() == 0
    (folder,) = (tmp_path / "outputs" / "drives").glob("*/*")
    assert str(folder.relative_to(tmp_path)) in "\n".join(driver.lines)
    assert read_drive(folder).driver.tolist() == ["fallback"]
    assert not (folder / "IMG").exists()


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        ("drive.speed.setmph=1", "did you mean speed.set_mph"),
        ("drive.speed=turns", "bends, constant, doubt, network, pi, proportional"),
        ("speed=doubt drive.port=0", "predicts no spread of its steering; drive a checkpoint"),
        ("drive.port=99999", "port=99999: must be a whole number in 0..65535"),
        ("drive.margin=0", "margin=0: must be a number of 0.2 or more, or null"),
        ("drive.port=[", "port=["),
        ("drive.host=0.0.0.0", "add expose=true"),
        ("drive.host=192.0.2.1 drive.expose=true", "Cannot assign requested address"),
    ],
)
def test_a_mistake_is_one_line(checkpoint: Path, tmp_path: Path, typed: str, words: str) -> None:
    line = only_line(drive(tmp_path, checkpoint, *typed.split()))
    assert words in line
    assert line.startswith("drivezoo drive: ")
    assert list(tmp_path.iterdir()) == []


def test_a_port_that_is_taken_names_who_holds_it(checkpoint: Path, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        line = only_line(drive(tmp_path, checkpoint, f"drive.port={port}"))
    assert f"port {port} is held by" in line
    assert f"(process {os.getpid()})" in line
    assert "add port=0" in line


def test_a_drive_without_a_simulator_leaves_nothing(checkpoint: Path, tmp_path: Path) -> None:
    with served(tmp_path / "x", "zoo.commands.drive", str(checkpoint), "drive.port=0") as driver:
        assert driver.stop() == 0
    assert any("no simulator" in line for line in driver.lines)
    assert list(tmp_path.iterdir()) == []


def test_the_embedded_simulator_is_driven_until_it_ends(checkpoint: Path, tmp_path: Path) -> None:
    options = ("drive.port=0", "drive.sim=lake", "drive.laps=0.01", "drive.record=drive")
    printed = succeed(drive(tmp_path, checkpoint, *options))
    assert "listening on http://127.0.0.1:" in printed
    assert "simulator 1 has connected" in printed
    assert "autonomy" in printed
    record = read_drive(tmp_path / "drive")
    assert record.summary["clients"] == 1
    assert record.speed_mph.max() > 2
    assert len(read_recordings(str(tmp_path / "drive"))) > 20


@pytest.fixture(scope="module")
def off_the_road(checkpoint: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a network that always steers to the left."""
    content = torch.load(checkpoint, weights_only=False)
    weights = content["state_dict"]
    *_, weight, bias = weights
    weights[weight].zero_()
    weights[bias].fill_(-0.3)
    path = tmp_path_factory.mktemp("bad") / "left.ckpt"
    torch.save(content, path)
    return path


@pytest.mark.slow
def test_a_bad_network_scores_as_in_an_evaluation(off_the_road: Path, tmp_path: Path) -> None:
    options = ("drive.port=0", "drive.sim=lake", "drive.laps=0.03", "drive.record=drive")
    printed = succeed(drive(tmp_path, off_the_road, *options))
    (scored,) = all_drives(load_policy(off_the_road), [Scenario("lake", laps=0.03, speed=9)])
    wanted = measure(scored)["interventions"]

    record = read_drive(tmp_path / "drive")
    assert wanted >= 2
    assert record.summary["interventions"] == record.summary["off_road"] >= wanted
    assert record.summary["autonomy"] < 0.5
    assert record.intervention.sum() == record.summary["interventions"]
    assert f"{record.summary['interventions']} interventions" in printed


@pytest.mark.slow
def test_a_car_that_is_not_put_back_costs_ever_more(off_the_road: Path, tmp_path: Path) -> None:
    options = ("drive.port=0", "drive.sim=lake", "drive.laps=0.03", "drive.put_back=false")
    with served(tmp_path / "x", "zoo.commands.drive", str(off_the_road), *options) as driver:
        assert until(driver, lambda now: now["telemetry"] >= 200, seconds=60)["lost"] == "off_road"
        assert driver.stop() == 0
    (folder,) = (tmp_path / "outputs" / "drives").glob("*/*")
    record = read_drive(folder)
    off_s = 0.066 * (np.abs(record.cross_track_m) > 3.2).sum()
    assert off_s > 5
    assert 6 * record.summary["off_road"] >= off_s


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGSTOP")
def test_ctrl_c_at_the_simulator_first_is_no_failure(checkpoint: Path, tmp_path: Path) -> None:
    options = ("drive.port=0", "drive.sim=lake")
    with served(tmp_path / "x", "zoo.commands.drive", str(checkpoint), *options) as driver:
        parent, children = psutil.Process(driver.process.pid), []
        while not children:
            children = parent.children()
        parent.suspend()  # as if it were slow
        children[0].send_signal(signal.SIGINT)
        while children[0].status() != psutil.STATUS_ZOMBIE:
            time.sleep(0.05)
        parent.send_signal(signal.SIGINT)
        parent.resume()
        printed = driver.process.communicate(timeout=60)
        assert driver.process.returncode == 0, printed


def test_a_simulator_that_fails_is_noticed() -> None:
    client = EmbeddedClient("nowhere", "http://127.0.0.1:1", None, put_back=True)
    client.start()
    wait_until(lambda: client.ended)
    assert "exit status 2" in client.stop()
