"""The doctor, run in processes, with healthy inputs and with common faults."""

import os
import shutil
import socket
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from tests.recordings import Written
from tests.zoo.command_runs import ROOT, run, run_words
from zoo.base.run_command import run_command
from zoo.checkpoints.checkpoint_path import packaged_file
from zoo.commands import doctor
from zoo.server import input_checks as inputs
from zoo.server import machine_checks as machine
from zoo.server.machine_checks import FAULT, WARNING, check_device


def run_doctor(cwd: Path, *arguments: object, **more: str) -> subprocess.CompletedProcess:
    """Run the doctor, on a free port: a driver may use the default one."""
    ports = [] if any(str(word).startswith("port=") for word in arguments) else [free_port()]
    with pytest.MonkeyPatch.context() as patch:
        for name, value in ({"COLUMNS": "400"} | more).items():
            patch.setenv(name, value)
        result = run(cwd, *map(str, arguments), *ports, module="zoo.commands.doctor")
    assert "Traceback" not in result.stdout + result.stderr, result.stderr
    return result


def free_port() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"port={probe.getsockname()[1]}"


def row(result: subprocess.CompletedProcess, what: str) -> str:
    """Return the rows of a check, with the fixes below them."""
    lines, inside = [], False
    for line in result.stdout.splitlines():
        inside = inside if line.startswith(" ") else line[9:].startswith(what)
        lines += [line] if inside else []
    return "\n".join(lines)


def test_a_healthy_checkpoint_is_ok(tmp_path: Path, run_folder: Path, recorded: Written) -> None:
    result = run_doctor(tmp_path, run_folder, recorded.folder)

    assert result.returncode == 0, result.stdout
    assert row(result, "Python").startswith("ok")
    assert "torch" in row(result, "packages")
    assert row(result, "renderer").startswith("ok")
    assert "252,219 parameters" in row(result, "checkpoint")
    assert "200 x 66 rgb" in row(result, "input")
    assert "the same as this recording" in row(result, "trained on")
    assert "not the same" not in row(result, "trained on")
    assert "120 rows, cameras centre, left, right" in row(result, "recording")
    assert "ok" in row(result, "round trip")
    assert not list(tmp_path.iterdir()), "the doctor leaves no files"


def test_the_size_of_the_cache_is_printed(here: Path) -> None:
    assert not list(machine.check_cache())
    machine.CACHE.mkdir(parents=True)
    with (machine.CACHE / "0123.npy").open("wb") as file:
        file.truncate(1_300_000_000)
    (finding,) = machine.check_cache()
    assert "1.3 GB" in finding.found
    assert str(here / "outputs" / "cache") in finding.found
    assert "delete" in finding.found


def test_every_fault_is_named_with_its_fix(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder:
        port = holder.getsockname()[1]
        result = run_doctor(tmp_path, "a [b] c.ckpt", tmp_path, f"port={port}")

    assert result.returncode == 1
    assert row(result, "port").startswith("fault")
    if sys.platform == "linux":
        assert f"(process {os.getpid()})" in row(result, "port"), "the process that uses it"
    assert "a [b] c.ckpt" in row(result, "checkpoint")
    assert "driving_log.csv" in row(result, "recording")
    for what in ("port", "checkpoint", "recording"):
        assert "fix: " in row(result, what)
    assert not row(result, "round trip"), "it would fail for the same reason"
    assert result.stdout.splitlines()[-1].startswith("faults: 3, warnings: 0,")


@pytest.mark.parametrize("program", ["drivezoo ", "-m zoo.commands.", r"C:\env\drivezoo.exe "])
def test_a_driver_that_holds_the_port_is_no_fault(program: str, monkeypatch) -> None:
    monkeypatch.setattr("zoo.base.machine.port_holder", lambda _: f"python {program}drive lenet")
    with socket.create_server(("127.0.0.1", 0)) as driver:
        (finding,) = machine.check_port(driver.getsockname()[1])
    assert finding.state == WARNING


@pytest.mark.parametrize(
    ("name", "version", "words", "fix"),
    [
        ("lightning", "2.6.2", "lightning 2.6.2 carries malware", "pip uninstall lightning"),
        ("lightning", "2.5.6", " 2.5.6 is installed, ", ""),
        ("opencv_python_headless", "4.10.0.84", " 4.10.0.84 is installed, ", ""),
    ],
)
def test_a_package_with_malware_or_without_what_drivezoo_calls_is_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, version: str, words: str, fix: str
) -> None:
    """2.5 has no Trainer.fit(weights_only=...), 4.10 no IMREAD_COLOR_RGB."""
    info = tmp_path / f"{name}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    monkeypatch.syspath_prepend(tmp_path)

    (fault,) = (check for check in machine.check_packages() if check.state == FAULT)

    assert words in fault.found
    assert fix in fault.fix


def test_without_packages_it_names_them_and_how_to_install(tmp_path: Path) -> None:
    words = ("-S", "-m", "zoo.commands.doctor", str(tmp_path), free_port())
    result = run_words(tmp_path, sys.executable, *words, COLUMNS="400")

    assert "Traceback" not in result.stdout + result.stderr
    assert result.returncode == 1
    assert "not installed: albumentations" in row(result, "packages")
    assert "torch is not installed" in row(result, "device")
    assert "pip install -e ." in row(result, "packages")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"rubbish" * 999])
def test_a_file_that_is_no_checkpoint_is_a_fault(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bad.ckpt"
    path.write_bytes(content)

    (finding,) = machine.careful("checkpoint", partial(inputs.check_checkpoint, str(path)))

    assert finding.state == FAULT
    assert str(path) in finding.found
    assert finding.fix


def test_a_slow_network_is_measured_as_it_drives(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inputs, "SLOW_MS", 0.0)
    torch.set_num_threads(2)
    threads: list[int] = []
    real = time.perf_counter
    timer = SimpleNamespace(perf_counter=lambda: threads.append(torch.get_num_threads()) or real())
    monkeypatch.setattr(inputs, "time", timer)
    *_, finding = inputs.check_checkpoint(str(packaged_file("tiny41")))
    assert {*threads} == {1}
    assert torch.get_num_threads() == 2, "left as it was"
    assert (finding.state, finding.what) == (WARNING, "speed")
    assert "smaller model" in finding.fix
    assert "threads" not in finding.fix


def test_bad_images_are_a_warning(tmp_path: Path, recorded: Written) -> None:
    folder = tmp_path / "lake"
    shutil.copytree(recorded.folder, folder)
    (folder / "IMG" / recorded.image(0).name).write_bytes(recorded.image(0).read_bytes()[:500])
    (folder / "IMG" / recorded.image(5).name).unlink()

    _, finding = inputs.check_recording(str(folder))

    assert finding.state == WARNING
    assert finding.found.startswith("2 ")
    assert "drivezoo check" in finding.fix
    policy: Any = SimpleNamespace(data={"fingerprint": "of another"}, config={})
    assert "not the same as this" in inputs._trained_on(policy, str(folder)).found


def test_a_driver_that_does_not_start_is_a_fault(tmp_path: Path) -> None:
    (finding,) = inputs.check_round_trip(str(tmp_path / "absent.ckpt"))
    assert finding.state == FAULT
    assert "absent.ckpt" in finding.found


def test_two_checkpoints_get_one_line(capsys: pytest.CaptureFixture) -> None:
    assert run_command("zoo.commands.doctor", doctor.main, ["a.ckpt", "b.ckpt"]) in (1, 2)
    printed = capsys.readouterr()
    assert len(printed.err.splitlines()) == 1
    assert not printed.out


def test_the_supported_pythons_are_those_of_pyproject() -> None:
    text = (ROOT / "pyproject.toml").read_text()
    (oldest, first), (newest, last) = machine.OLDEST, machine.NEWEST
    assert f'requires-python = ">={oldest}.{first},<{newest}.{last + 1}"' in text


@pytest.mark.parametrize(
    ("given", "command"),
    [
        ((None, None), "drivezoo demo"),
        ((None, "my laps"), "drivezoo check 'my laps'"),
        (("best.ckpt", "laps"), "drivezoo evaluate best.ckpt"),
    ],
)
def test_the_next_command_fits(given: tuple[str | None, str | None], command: str) -> None:
    assert doctor.next_step(*given)[0] == command


def test_the_cores_are_those_of_the_containers_quota(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zoo.base.machine._container_cores", lambda: 0.5)
    assert "on 1 core" in next(check_device()).found
