"""Checkpoints exported as ONNX: they steer the same, and commands take them."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from rich.console import Console

from datamodules.image import decode_image
from datamodules.view import CONVERSIONS, View
from tests.recordings import Written
from tests.refusals import refusal
from tests.slow_members import slow, slow_but
from tests.zoo.command_runs import run_here
from tests.zoo.models.test_models_command import build
from tests.zoo.page_requests import ask
from tests.zoo.server.serve import picture, served
from tests.zoo.written_checkpoints import checkpoint_of
from zoo.base.compose import choices
from zoo.base.errors import InputError
from zoo.checkpoints import onnx_file
from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint, read_checkpoint_file
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy, load_policy
from zoo.checkpoints.onnx_file import COLOURS, MODEL_CARD, onnx_bytes
from zoo.checkpoints.onnx_policy import CARD
from zoo.commands import evaluate
from zoo.commands.drive import load_warm_policy, view_line
from zoo.commands.export import export
from zoo.driving.metrics import measure
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.scoring import model_card
from zoo.scoring.checked_export import export_checkpoint
from zoo.scoring.parity import RENDERED, Frames, compare, take_frames
from zoo.scoring.visual_backprop import Saliency
from zoo.server import input_checks as inputs
from zoo.server.live_page import list_checkpoints
from zoo.server.machine_checks import OK

NARROW = {"commaai": ["model.width=0.25"], "vgg": ["model.units=8"]}
# Networks of layers that a quicker one has, or that tests/zoo/checkpoints/test_engine.py exports.
SLOW = {"efficientnet_lite0", "keras", "ncp", "nvidia", "vgg"}
# Views whose colour or resize the policy looks up by its name, as those of the other members.
COLOURS_BY_AREA = [(colour, "area") for colour in CONVERSIONS if colour != "gray"]
SLOW_VIEWS = [*COLOURS_BY_AREA, ("yuv_old", "linear")]


@pytest.fixture(scope="module")
def frames(recorded: Written) -> Frames:
    rows = range(0, 120, 20)
    images = [decode_image(recorded.image(row).read_bytes()) for row in rows]
    return Frames(images, [float(5 * number) for number in range(len(rows))], "drawn")


@pytest.fixture(scope="module")
def checkpoint(run_folder: Path) -> Path:
    return run_folder / "checkpoints" / "best.ckpt"


@pytest.fixture(scope="module")
def exported(checkpoint: Path, recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Export a checkpoint with the command, over an earlier file; a link is not followed."""
    cwd = tmp_path_factory.mktemp("onnx")
    (cwd / "secret.txt").write_text("mine")
    (cwd / "model.onnx.part").symlink_to("secret.txt")
    (cwd / "model.onnx").write_bytes(b"earlier")
    arguments = [str(checkpoint), f"frames={recorded.folder}", "overwrite=true"]
    result = run_here(cwd, *arguments, module="zoo.commands.export")
    assert (result.returncode, result.stderr) == (0, "")
    assert (cwd / "secret.txt").read_text() == "mine"
    assert {path.name for path in cwd.iterdir()} == {"model.onnx", "model.onnx.part", "secret.txt"}
    for text in ("PilotNet", "252,219 parameters", "difference", str(recorded.folder)):
        assert text in result.stdout
    assert result.stdout.strip().endswith("drivezoo drive model.onnx")
    return cwd / "model.onnx"


@pytest.mark.parametrize("name", slow_but({*choices("model")} - SLOW, choices("model")))
def test_every_model_steers_as_its_checkpoint(name: str, frames: Frames, tmp_path: Path) -> None:
    torch.manual_seed(1)
    network, view = build(name, *NARROW.get(name, []))
    data = {"rows": 3, "rows_per_s": 15.0}
    checkpoint = Checkpoint(network.eval(), view, {"model": {"name": name}}, data)
    (tmp_path / "model.onnx").write_bytes(onnx_bytes(checkpoint))
    policy, onnx_policy = CheckpointPolicy(checkpoint), load_policy(tmp_path / "model.onnx")

    assert compare(policy, onnx_policy, frames).difference < 1e-5

    assert onnx_policy.view == view
    for attribute in ("name", "parameters", "config", "data", "takes_speed", "outputs", "window"):
        assert getattr(onnx_policy, attribute) == getattr(policy, attribute), attribute
    assert view_line(onnx_policy) == f"{view_line(policy)}; engine onnx"
    assert (onnx_policy(frames.frames[0], 9.0).spread is None) == (not policy.predicts_spread)
    steering = [onnx_policy(frame, 9.0)[0] for frame in frames.frames]
    assert np.std(steering) > 0, "it ignores the frame"
    throttle = [onnx_policy(frames.frames[0], mph)[1] for mph in (0.0, 30.0)]
    if policy.outputs > 1:
        assert throttle[0] != throttle[1]
    else:
        assert throttle == [None, None]


def test_the_file_describes_its_network(exported: Path, checkpoint: Path) -> None:
    model = onnx.load(exported)
    texts = {entry.key: entry.value for entry in model.metadata_props}
    card = json.loads(texts[CARD])
    for part in ("252,219 parameters", "negative is left", "with onnxruntime", "Intended use"):
        assert part in texts[MODEL_CARD]
    original = read_checkpoint_file(checkpoint)["drivezoo"]
    del original["config"]["logger"]  # may name servers and passwords
    for key in ("format", "config", "view", "data"):
        assert card[key] == original[key]
    view = {"crop": [40, 20], "colour": "rgb", "size": [66, 200], "resize": "area"}
    assert card["view"] == view | {"frame": [160, 320]}
    assert card["data"]["fingerprint"]
    assert "uint8 [batch, 3, 66, 200]" in model.doc_string
    assert "in RGB, then resized by area" in model.doc_string
    assert [opset.version for opset in model.opset_import] == [17]


@pytest.mark.parametrize(
    ("colour", "resize"),
    [("gray", "area"), ("yuv_old", "area_first"), ("yuv_old", "linear_first"), *slow(*SLOW_VIEWS)],
)
def test_the_file_keeps_the_view_and_the_scale(
    colour: str, resize: str, frames: Frames, tmp_path: Path
) -> None:
    keys = [f"model.colour={colour}", f"model.resize={resize}", "model.scale=[128,1]"]
    network, view = build("lenet", *keys)
    config = {"model": {"name": "lenet", "scale": [128, 1]}}
    checkpoint = Checkpoint(network.eval(), view, config, {"rows": 3})
    (tmp_path / "model.onnx").write_bytes(onnx_bytes(checkpoint))
    policy = load_policy(tmp_path / "model.onnx")
    assert policy.view == view == View([40, 20], colour, [32, 64], resize)
    assert policy.config == config
    assert compare(CheckpointPolicy(checkpoint), policy, frames).difference < 1e-5
    text = onnx.load(tmp_path / "model.onnx").doc_string
    assert ("INTER_AREA" if resize.startswith("area") else "INTER_LINEAR") in text
    assert {*COLOURS} == {*CONVERSIONS}
    assert COLOURS[colour] in text
    assert (text.index("resized") < text.index(COLOURS[colour])) == resize.endswith("_first")


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (["cnn_gru", "model.stride=2"], "the next_... of the frame 2 before it"),
        (["action_chunk"], "(OpenCV's INTER_AREA) -> controls"),
    ],
)
def test_a_file_says_which_state_it_takes(keys: list[str], words: str, tmp_path: Path) -> None:
    (tmp_path / "model.onnx").write_bytes(onnx_bytes(checkpoint_of(*keys)))
    assert words in onnx.load(tmp_path / "model.onnx").doc_string


@pytest.mark.parametrize(
    ("size", "words"),
    [("[32,64]", ", resized to 32 x 64 (resize=linear_first)."), ("null", "colour gray.")],
)
def test_a_card_says_how_the_view_is_resized(size: str, words: str) -> None:
    keys = [f"model.size={size}", "model.resize=linear_first"]
    assert model_card._network(checkpoint_of("lenet", *keys))[1].endswith(words)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nvidia_gaussian", ["Output: logarithm of the steering's standard deviation."]),
        ("pilotnet_stack", ["Memory: of earlier frames; frames/s of its recording: 15.0."]),
        ("lenet", []),
    ],
)
def test_a_card_names_a_spread_and_a_memory(name: str, words: list[str]) -> None:
    points = model_card._units(checkpoint_of(name))
    assert [point for point in points if "deviation" in point or "Memory" in point] == words


def test_a_file_that_steers_differently_is_removed(
    checkpoint: Path, recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = load_checkpoint(checkpoint)
    with torch.no_grad():
        other.network.head[-1].bias += 0.001
    monkeypatch.setattr(onnx_file, "onnx_bytes", lambda *_: onnx_bytes(other))
    files = str(tmp_path / "model.onnx"), str(recorded.folder)

    with pytest.raises(InputError, match=r" 0\.001 .* 0\.0001"):
        export_checkpoint(str(checkpoint), *files, Console(quiet=True))

    assert not list(tmp_path.glob("*.onnx"))


def test_frames_are_recorded_or_drawn(checkpoint: Path, recorded: Written, here: Path) -> None:
    loaded = load_checkpoint(checkpoint)
    assert take_frames(None, loaded).source == f"of {recorded.folder}"
    # Of a stranger's checkpoint; the last one would be a server's on Windows.
    for root in (str(here / "of another machine"), "~nobody/lake", f"/{recorded.folder}"):
        rendered = take_frames(None, replace(loaded, config={"data": {"root": root}}))
        assert rendered.source.startswith("rendered on the embedded lake, in 320 x 160, since")
        assert f"{root} is not found" in rendered.source
    assert len(rendered.frames) == len(rendered.speeds_mph) == RENDERED
    assert {frame.shape for frame in rendered.frames} == {(160, 320, 3)}
    assert len({frame.tobytes() for frame in rendered.frames}) == RENDERED
    assert "nowhere" in refusal(take_frames, "nowhere", loaded)


def test_the_network_uses_the_threads_of_the_driver(exported: Path) -> None:
    threads = torch.get_num_threads()
    assert load_policy(exported).onnx.get_session_options().intra_op_num_threads == 1
    try:
        policy = load_warm_policy(exported, threads=2)
    finally:
        torch.set_num_threads(threads)
    assert policy.onnx.get_session_options().intra_op_num_threads == 2
    assert "runs in onnxruntime" in refusal(load_warm_policy, exported, 1, engine="torch")


def test_it_scores_as_its_checkpoint(exported: Path, checkpoint: Path, tmp_path: Path) -> None:
    options = ("laps=0.01", "speed=25", "quality=simple", "workers=1", f"out={tmp_path / 'out'}")
    evaluate.evaluate_or_replay([str(exported), *options])
    (scored,) = json.loads((tmp_path / "out" / "metrics.json").read_text())["drives"]
    scenario = Scenario("lake", laps=0.01, speed=25, quality="simple")
    (driven,) = all_drives(str(checkpoint), [scenario])
    keys = ("cte_mean_m", "laps", "speed_mph")
    measured, expected = ([figures[key] for key in keys] for figures in (scored, measure(driven)))
    # A place that differs in its last digit changes a few pixels, and with them the steering.
    assert measured == pytest.approx(expected, rel=1e-2)


def test_the_doctor_checks_it(exported: Path, recorded: Written) -> None:
    findings = list(inputs.check_checkpoint(str(exported), str(recorded.folder)))
    assert {finding.state for finding in findings} == {OK}
    text = " ".join(finding.found for finding in findings)
    assert "nvidia, 252,219 parameters" in text
    assert "; the same as this recording" in text


def test_it_has_no_saliency(exported: Path) -> None:
    with pytest.raises(InputError, match=r"model\.onnx: .*ONNX.* the checkpoint"):
        Saliency(load_policy(exported))


def test_the_live_page_switches_to_and_from_it(exported: Path, checkpoint: Path) -> None:
    from zoo.simulator.legacy_socket import LegacySocket
    from zoo.simulator.telemetry import make_telemetry

    words = ("zoo.commands.drive", "model.onnx", "drive.port=0")
    with served(exported.parent / "drive", *words) as driver:
        client = LegacySocket(f"http://127.0.0.1:{driver.port}")

        def steering() -> str:
            frame = decode_image(picture((90, 120, 60)))
            client.emit("telemetry", make_telemetry(frame, 0.0, 0.0, 9.0, decimal_comma=False))
            while True:
                for name, argument in client.events(0.2):
                    if name == "steer":
                        return argument["steering_angle"]

        first = steering()
        status, _, answer = ask(driver.port, "GET", "/saliency.jpg")
        assert status == 503
        assert "ONNX" in json.loads(answer)["error"]
        for path in (str(checkpoint), "model.onnx"):
            _, _, state = ask(driver.port, "POST", "/command", {"switch": path})
            assert json.loads(state)["checkpoint"] == path
            assert float(steering()) == pytest.approx(float(first), abs=1e-4)
        assert json.loads(ask(driver.port, "GET", "/state.json")[2])["fallbacks"] == 0
        client.close()
    assert any("PilotNet" in line and "252,219" in line for line in driver.lines)


def test_the_page_lists_it(exported: Path, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    shutil.copy(exported, tmp_path / "run")
    assert list_checkpoints(tmp_path) == [str(tmp_path / "run" / "model.onnx")]


@pytest.mark.parametrize("package", ["onnx", "onnxruntime"])
def test_a_missing_package_is_named(
    package: str, exported: Path, checkpoint: Path, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    files = str(tmp_path / "model.onnx"), None
    with pytest.raises(InputError, match=rf'{package}: pip install "drivezoo\[onnx\]"'):
        export_checkpoint(str(checkpoint), *files, Console(quiet=True))
    if package == "onnxruntime":
        with pytest.raises(InputError, match=r'onnxruntime.*pip install "drivezoo\[onnx\]"'):
            load_policy(exported)
    else:
        assert load_policy(exported).outputs == 1, "driving needs only onnxruntime"


@pytest.mark.parametrize("out", ["model.pt", "absent/model.onnx"])
def test_a_wrong_output_is_one_line(out: str, checkpoint: Path) -> None:
    assert f"out={out}: " in refusal(export.main, [str(checkpoint), f"out={out}"])


def test_an_exported_file_is_not_exported(exported: Path) -> None:
    assert "model.onnx: " in refusal(export.main, [str(exported)])
