"""`drivezoo studio`: its page, its steps, and what may not reach it."""

import json
import re
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from datamodules.recording_format import read_recordings
from tests.recordings import write_recording
from tests.zoo.base.test_process_pool import wait_until
from tests.zoo.command_runs import only_line, run_here, start
from tests.zoo.page_requests import Answer, ask
from tests.zoo.simulator.person import Person
from zoo.base.page_server import PageServer
from zoo.checkpoints.checkpoint_path import PACKAGED
from zoo.extras.studio import studio_page, watched_network
from zoo.extras.studio.child_command import ChildCommand
from zoo.extras.studio.steps import UPLOADS
from zoo.extras.studio.studio_page import KINDS, MOST_UPLOAD, StudioPage
from zoo.extras.studio.watched_network import Watched, start_together
from zoo.runs.status import write_status

KEY = "a long enough key"
LENET = PACKAGED / "lenet.ckpt"


class Served:
    """A studio that is served in the current folder."""

    def __init__(self, page: StudioPage, port: int) -> None:
        self.page, self.port = page, port

    def ask(self, method: str, path: str, body: object = None, **headers: str) -> Answer:
        return ask(self.port, method, path, body, **headers)

    def post(self, query: str = "", **sent: object) -> tuple[int, dict]:
        status, _, body = self.ask("POST", f"/command{query}", sent)
        return status, json.loads(body)

    def line(self, **step: object) -> list[str]:
        status, lines = self.post(line=step)
        assert status == 200, lines
        return lines

    def state(self) -> dict:
        return json.loads(self.ask("GET", "/state.json")[2])


def serve(key: str | None = None) -> Iterator[Served]:
    page = StudioPage(key)
    with PageServer(0, page, most_request=MOST_UPLOAD) as server:
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        yield Served(page, server.server_port)
        page.close()
        server.shutdown()


@pytest.fixture
def studio(here: Path) -> Iterator[Served]:
    yield from serve()


@pytest.fixture
def locked(here: Path) -> Iterator[Served]:
    yield from serve(KEY)


def test_the_page_comes_from_the_package_and_shares_the_drive(studio: Served) -> None:
    for path, holds in (("/", b"studio.js"), ("/hand.js", b"HandView"), ("/style.css", b".studio")):
        status, _, body = studio.ask("GET", path)
        assert status == 200
        assert holds in body
        assert b"https://" not in body, "it would fetch something from elsewhere"


def test_each_step_is_a_command(studio: Served, here: Path) -> None:
    (here / "my laps").mkdir()
    assert studio.line(step="drive", track="zoo_lake", day="fog") == [
        "drivezoo simulator drive track=zoo_lake 'weather={fog: 0.4}' quality=fast"
    ]
    assert studio.line(step="check", folder="my laps") == ["drivezoo check 'my laps'"]
    assert studio.line(step="train", folder="my laps", augment=[], seeds=3, quick=True) == [
        "drivezoo train experiment=first_try 'data.root=my laps' 'augment=[]' quick=true seeds=3"
    ]
    assert studio.line(step="preview", recipe="lenet", augment=["shadow"]) == [
        "drivezoo preview experiment=lenet 'augment=[shadow]'"
    ]
    both = studio.line(step="watch", first="lenet", second="lenet", track="zoo_mountain")
    assert both == ["drivezoo evaluate lenet track=zoo_mountain"] * 2
    assert studio.line(step="watch", first="lenet", folder="my laps") == [
        "drivezoo evaluate lenet 'replay=my laps'"
    ]
    assert studio.line(step="rank") == ["drivezoo leaderboard"]


def test_a_stopped_training_is_resumed_as_its_command_says(
    studio: Served, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep, alone = Path("outputs/sweeps/2026-11-30/10-00-00"), "outputs/2026-11-30/11-00-00"
    for run in (sweep / "0", Path(alone)):  # stopped before their first checkpoint
        run.mkdir(parents=True)
        write_status(run, "stopped")
    (sweep / "sweep.json").touch()
    assert studio.line(step="train", resume=alone) == [f"drivezoo train resume={alone}"]
    resumed = studio.line(step="train", resume=str(sweep / "0"))
    assert resumed == [f"drivezoo sweep resume={sweep}"]
    monkeypatch.setattr(ChildCommand, "run_folder", lambda self, outputs: Path(alone))
    studio.page.children["train"] = ChildCommand(["--version"])
    assert studio.state()["training"]["drives"] is False, "the page offers nothing to watch"


def test_an_editor_keeps_and_prints_its_edits(here: Path, capsys: pytest.CaptureFixture) -> None:
    served = serve()
    studio = next(served)
    for name in "ab":
        write_recording(here / name, rows=40)

    def open_editor(name: str) -> str:
        studio.post(start={"step": "edit", "folder": name})
        address = re.compile(r"http://127.0.0.1:(\d+)")
        wait_until(lambda: address.search("\n".join(studio.state()["edit"]["lines"])))
        return address.search("\n".join(studio.state()["edit"]["lines"]))[1]

    port = open_editor("a")
    status, _ = Served(studio.page, int(port)).post(drop=[3, 34])
    assert status == 200
    assert open_editor("b") != port
    assert open_editor("a") == port
    assert next(served, None) is None
    assert "next: drivezoo edit a drop=4-34" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("step", "words"),
    [
        ({"step": "check", "folder": "missing"}, "missing: no such folder"),
        ({"step": "edit", "folder": "~nobodyx/drives"}, "~nobodyx/drives: no such folder"),
        ({"step": "check", "folder": "a" * 3000}, "(3001 characters) no such folder"),
        ({"step": "train", "recipe": "../x"}, "recipe=../x"),
        ({"step": "train", "augment": ["x,model=y"]}, "augment=x,model=y"),
        ({"step": "train", "seeds": 6}, "seeds"),
        ({"step": "train", "resume": "/etc"}, "resume=/etc"),
        ({"step": "watch", "first": "/etc/passwd"}, "network=/etc/passwd"),
        ({"step": "drive", "track": "/etc/passwd"}, "track=/etc/passwd"),
        ({"step": "drive", "track": "zoo_lake", "day": "{fog: 2}"}, "day="),
        ({"step": "hub"}, "line"),
        ({"step": "check"}, "no such folder"),
        ({"step": "watch", "first": ""}, "network"),
    ],
)
def test_a_field_is_checked_before_it_is_a_command(studio: Served, step: dict, words: str) -> None:
    status, answer = studio.post(line=step)
    assert status == 400
    assert words in answer["error"]


def test_another_site_cannot_use_it(studio: Served) -> None:
    for headers in ({"Origin": "http://example.org"}, {"Host": "example.org"}):
        for method, path in (("GET", "/state.json"), ("POST", "/upload?name=a.onnx")):
            assert studio.ask(method, path, b"x" * (method == "POST"), **headers)[0] == 403


def test_all_but_the_files_needs_the_key(locked: Served) -> None:
    paths = ("/state.json", "/choices.json", "/frame", "/watch", "/preview.png", "/ranking")
    for query in ("", "?token=wrong"):
        assert {locked.ask("GET", path + query)[0] for path in paths} == {403}
        assert locked.post(query, line={"step": "rank"})[0] == 403
        name = f"{query or '?'}&name=a.onnx"
        assert locked.ask("POST", f"/upload{name}", b"x")[0] == 403
    token = f"?token={KEY.replace(' ', '+')}"
    assert locked.ask("GET", f"/state.json{token}")[0] == 200
    assert locked.post(token, line={"step": "rank"})[0] == 200
    assert locked.ask("GET", "/")[0] == 200


def test_another_host_needs_a_key(here: Path) -> None:
    options = ("host=0.0.0.0", "key=short")
    line = only_line(run_here(here, *options, module="zoo.extras.studio.studio"))
    assert line.startswith("drivezoo studio: host=0.0.0.0: other machines")
    assert "key=" in line


@pytest.mark.parametrize("host", ["::1", "192.0.2.1"])
def test_a_host_of_another_machine_is_named_without_its_port(host: str, here: Path) -> None:
    options = (f"host={host}", "key=long enough")
    line = only_line(run_here(here, *options, module="zoo.extras.studio.studio"))
    assert line.startswith(f"drivezoo studio: host={host}: ")
    assert "use the machine's IPv4 address" in line
    assert "port=" not in line


@pytest.mark.parametrize("name", ["a.py", "a.pkl", "", "../../a.yaml"])
def test_only_networks_are_taken(studio: Served, here: Path, name: str) -> None:
    status, _, body = studio.ask("POST", f"/upload?name={name}", b"x")
    assert status == 400
    assert all(kind in json.loads(body)["error"] for kind in KINDS)
    assert not UPLOADS.exists()


def test_an_upload_lies_in_a_folder_of_its_own(studio: Served, here: Path) -> None:
    status, _, body = studio.ask("POST", "/upload?name=../../evil%2F..%2Fnet.onnx", b"x")
    assert status == 200
    (path,) = [path for path in here.rglob("*") if path.is_file()]
    assert path.parent == here / UPLOADS
    assert json.loads(body)["network"] == str(path.relative_to(here))
    assert studio.line(step="watch", first=str(path.relative_to(here)))
    for length in (str(MOST_UPLOAD), "9" * 5000):
        long = {"Content-Length": length}
        assert studio.ask("POST", "/upload?name=a.ckpt", None, **long)[0] == 413


def test_an_upload_that_cannot_be_written_says_why(
    studio: Served, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(studio_page, "UPLOADS", here / "file" / "uploads")
    (here / "file").touch()
    status, _, body = studio.ask("POST", "/upload?name=net.onnx", b"x")
    assert status == 400
    assert "cannot be written" in json.loads(body)["error"]


@pytest.mark.slow
@pytest.mark.skipif(".h5" not in KINDS, reason="another extra imports it")
def test_a_broken_keras_file_is_refused_in_the_words_of_import(studio: Served) -> None:
    status, _, body = studio.ask("POST", "/upload?name=a.h5", b"no network")
    assert status == 400
    assert "drivezoo import" in json.loads(body)["error"]
    assert not list(UPLOADS.iterdir())


def test_a_person_drives_and_records(studio: Served, here: Path) -> None:
    status, state = studio.post(start={"step": "drive", "track": "zoo_lake"})
    assert status == 200
    assert "out=outputs/recordings/" in state["drive"]["line"]
    person = Person(f"http://127.0.0.1:{studio.port}")
    person.until(lambda now: "lap" in now)
    assert studio.post(start={"step": "drive", "track": "zoo_lake"})[0] == 409
    person.send(press="r")
    person.hold("arrow_up")
    person.until(lambda now: now["rows"] > 20)
    person.send(press="escape")
    wait_until(lambda: not studio.state()["drive"]["running"])
    drive = studio.state()["drive"]
    assert any(line.startswith("rows") for line in drive["lines"])
    folder = drive["folder"]
    assert len(read_recordings(folder)) > 20
    assert json.loads(studio.ask("GET", "/choices.json")[2])["recordings"] == [folder]
    studio.post(start={"step": "check", "folder": folder})
    wait_until(lambda: studio.state()["check"]["status"] is not None)
    assert "all images are whole" in studio.state()["check"]["lines"]


@pytest.mark.parametrize(
    "paths", [[LENET], pytest.param([LENET, Path("broken.ckpt")], marks=pytest.mark.slow)]
)
def test_networks_drive_side_by_side_and_broken_files_say_so(here: Path, paths: list[Path]) -> None:
    (here / "broken.ckpt").write_bytes(b"no checkpoint")
    scenario = {"track": "zoo_lake", "quality": "simple"}
    networks = [Watched(path.stem, str(path), scenario) for path in paths]
    assert all(network.state()["loading"] for network in networks), "also in a second drive"
    start_together(networks)
    try:
        first, *broken = networks
        wait_until(lambda: b'"time_s": 1.' in first.frame.answer({})[0])
        for network in broken:
            wait_until(lambda network=network: network.failure)
            assert "broken.ckpt" in network.failure
            assert "Traceback" not in network.failure
        assert not first.failure
        assert not first.state()["loading"]
    finally:
        for network in networks:
            network.stop()
    assert not any(network.running for network in networks)
    wait_until(lambda: first.failure)
    assert first.failure == "was stopped"


def test_a_network_that_is_silent_is_ended(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watched_network, "LOADS_S", 0.0)
    network = Watched("lenet", "lenet", {})
    wait_until(lambda: not network.running)
    assert "gives no frame" in network.failure


def test_the_time_left_counts_the_epochs_of_all_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    child = ChildCommand.__new__(ChildCommand)
    child.epochs = []
    assert child.training() == {}
    child.epochs = [(10.0, 1, 4, "0.5", ""), (20.0, 2, 4, "0.25", "1,250")]
    monkeypatch.setattr(time, "monotonic", lambda: 24.0)
    facts = {"epoch": 2, "epochs": 4, "loss": 0.25, "rate": 1250.0}
    assert child.training() == facts | {"left_s": 16.0}
    assert child.training(3) == facts | {"left_s": 96.0}
    resumed = ChildCommand.__new__(ChildCommand)
    resumed.epochs = [(10.0, 2, 4, "0.5", ""), (20.0, 3, 4, "0.25", "1,250")]
    assert resumed.training()["left_s"] == 6.0


def test_the_log_of_a_sweeps_job_is_read_once(here: Path) -> None:
    child = ChildCommand(["--version"])
    child.wait(30)
    assert (child.status, len(child.lines)) == (0, 1)
    child.read_log(here)
    (here / "log.txt").write_text("plan\nepoch   1/3  train/loss 0.0080  val/mse 0.0006\n")
    for _ in range(2):
        child.read_log(here)
        assert [epoch[1:] for epoch in child.epochs] == [(1, 3, "0.0080", "")]
    assert list(child.lines)[1] == "plan"


def test_a_loss_may_be_negative_or_no_number(here: Path) -> None:
    child = ChildCommand(["--version"])
    child.wait(30)
    log = ""
    for text, loss in (("-0.1250", -0.125), ("nan", None), ("-inf", None)):
        log += f"epoch   1/3  train/loss {text}  1,250 samples/s\n"
        (here / "log.txt").write_text(log)
        child.read_log(here)
        facts = child.training()
        assert (facts["epoch"], facts["loss"], facts["rate"]) == (1, loss, 1250.0)


def test_ctrl_c_ends_it(here: Path) -> None:
    process = start(here, "zoo.extras.studio.studio", "port=0")
    assert "http://127.0.0.1:" in process.stdout.readline()
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=30)[0] == ""
    assert process.returncode == 0
