"""Checkpoints exported as ONNX or for Donkeycar: they steer the same, and commands take them."""

import http.client
import json
import os
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
import torch
from rich.console import Console

from datamodules.image import decode_image
from datamodules.view import CONVERSIONS, RESIZES, View
from tests.recordings import Written
from tests.zoo.command_runs import only_line, run, run_here, succeed
from tests.zoo.models.test_models_command import build
from tests.zoo.server.serve import picture, served
from tests.zoo.written_checkpoints import write_constant
from zoo.base.compose import choices
from zoo.base.console_script import place_of
from zoo.base.errors import InputError
from zoo.base.whole_file import write_output
from zoo.base.written_files import OUTPUTS
from zoo.checkpoints import onnx_file
from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint, read_checkpoint_file
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy, load_policy
from zoo.checkpoints.onnx_file import COLOURS, MODEL_CARD, onnx_bytes
from zoo.checkpoints.onnx_policy import CARD
from zoo.commands import evaluate
from zoo.commands.drive import load_warm_policy, view_line
from zoo.commands.export import export
from zoo.export.donkeycar_file import (
    donkeycar_bytes,
    donkeycar_policy,
    inferred_throttle,
)
from zoo.export.exported_file import Int8OnnxFile, export_checkpoint
from zoo.models.commaai import CommaAi
from zoo.models.lenet import LeNet
from zoo.models.pilotnet import PilotNet
from zoo.scoring.parity import RENDERED, Frames, compare, take_frames
from zoo.scoring.visual_backprop import Saliency
from zoo.server import input_checks as inputs
from zoo.server.live_page import list_checkpoints
from zoo.server.machine_checks import OK

needs_reader = pytest.mark.skipif(not place_of("import"), reason="an extra reads Keras' files")
NARROW = {"commaai": ["model.width=0.25"], "vgg": ["model.units=8"]}


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
    """Export a checkpoint with the command, over its own earlier file; a link is not followed."""
    cwd = tmp_path_factory.mktemp("onnx")
    (cwd / "secret.txt").write_text("mine")
    (cwd / "model.onnx.part").symlink_to("secret.txt")
    write_output(cwd / "model.onnx", b"earlier")
    result = run_here(
        cwd, str(checkpoint), f"frames={recorded.folder}", module="zoo.commands.export"
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert (cwd / "secret.txt").read_text() == "mine"
    assert {one.name for one in cwd.iterdir()} == {
        "model.onnx",
        "model.onnx.part",
        "secret.txt",
        OUTPUTS,
    }
    for text in ("PilotNet", "252,219 parameters", "difference", str(recorded.folder)):
        assert text in result.stdout
    assert result.stdout.strip().endswith("drivezoo drive model.onnx")
    return cwd / "model.onnx"


def test_a_foreign_file_is_not_replaced(checkpoint: Path, tmp_path: Path) -> None:
    (tmp_path / "model.onnx").write_bytes(b"mine")
    result = run_here(tmp_path, str(checkpoint), module="zoo.commands.export")
    assert "out=model.onnx: exists" in only_line(result)
    assert (tmp_path / "model.onnx").read_bytes() == b"mine"


@pytest.mark.skipif(os.name != "posix", reason="makes a named pipe")
def test_a_named_pipe_is_refused_without_waiting(checkpoint: Path, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "model.onnx")
    assert "out=model.onnx: exists" in only_line(
        run_here(tmp_path, str(checkpoint), module="zoo.commands.export")
    )


@pytest.mark.parametrize("name", choices("model"))
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
    if network.outputs > 1:
        assert throttle[0] != throttle[1]
    else:
        assert throttle == [None, None]


def test_the_file_describes_its_network(exported: Path, checkpoint: Path) -> None:
    model = onnx.load(exported)
    texts = {one.key: one.value for one in model.metadata_props}
    card = json.loads(texts[CARD])
    for part in ("252,219 parameters", "negative is left", "with onnxruntime", "Intended use"):
        assert part in texts[MODEL_CARD]
    original = read_checkpoint_file(checkpoint)["drivezoo"]
    for key in ("format", "config", "view", "data"):
        assert card[key] == original[key]
    view = {"crop": [40, 20], "colour": "rgb", "size": [66, 200], "resize": "area"}
    assert card["view"] == view | {"frame": [160, 320]}
    assert card["data"]["fingerprint"]
    assert "uint8 [batch, 3, 66, 200]" in model.doc_string
    assert "in RGB, then resized by area" in model.doc_string
    assert [one.version for one in model.opset_import] == [17]


@pytest.mark.parametrize(
    ("colour", "resize"),
    [*((colour, "area") for colour in CONVERSIONS), *(("yuv_old", resize) for resize in RESIZES)],
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
    assert COLOURS[colour] in text
    assert (text.index("resized") < text.index(COLOURS[colour])) == resize.endswith("_first")


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


@pytest.mark.parametrize("name", ["lenet", "cnn_gru"])
def test_a_file_of_8_bits_steers_nearly_as_its_checkpoint(
    name: str, frames: Frames, recorded: Written, tmp_path: Path
) -> None:
    torch.manual_seed(1)
    network, view = build(name, *(["model.sequence=4"] if name == "cnn_gru" else []))
    checkpoint = Checkpoint(network.eval(), view, {}, {"rows": 3})
    kind = Int8OnnxFile(checkpoint, tmp_path / "model.onnx", str(recorded.folder))
    contents = kind.files("# card")[".onnx"]
    assert len(contents) < 0.4 * len(onnx_bytes(checkpoint))
    (tmp_path / "model.onnx").write_bytes(contents)
    policy = load_policy(tmp_path / "model.onnx")
    assert policy.view == view
    assert 0 < compare(CheckpointPolicy(checkpoint), policy, frames).difference < 0.1


def test_a_calibration_that_cannot_be_read_is_named(checkpoint: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        export_checkpoint(
            str(checkpoint),
            str(tmp_path / "model.onnx"),
            None,
            Console(quiet=True),
            weights="int8",
            calibration="nowhere",
        )


def test_frames_are_those_of_training_or_else_rendered(
    checkpoint: Path, recorded: Written, here: Path
) -> None:
    loaded = load_checkpoint(checkpoint)
    assert take_frames(None, loaded).source == f"of {recorded.folder}"
    moved = replace(loaded, config={"data": {"root": str(here / "of another machine")}})
    rendered = take_frames(None, moved)
    assert rendered.source.startswith("rendered on the embedded lake, in 320 x 160, since")
    assert "of another machine is not found" in rendered.source
    assert len(rendered.frames) == len(rendered.speeds_mph) == RENDERED
    assert {frame.shape for frame in rendered.frames} == {(160, 320, 3)}
    assert len({frame.tobytes() for frame in rendered.frames}) == RENDERED
    with pytest.raises(InputError, match="nowhere"):
        take_frames("nowhere", loaded)


def test_the_network_uses_the_threads_of_the_driver(exported: Path) -> None:
    threads = torch.get_num_threads()
    assert load_policy(exported).onnx.get_session_options().intra_op_num_threads == 1
    try:
        policy = load_warm_policy(exported, threads=2)
    finally:
        torch.set_num_threads(threads)
    assert policy.onnx.get_session_options().intra_op_num_threads == 2


def test_it_scores_as_its_checkpoint(
    exported: Path, checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    options = ("laps=0.01", "speed=25", "quality=simple", "workers=1")
    drives = []
    for path in (exported, checkpoint):
        evaluate.evaluate_or_replay([str(path), *options, f"out={tmp_path / path.suffix}"])
        metrics = json.loads((tmp_path / path.suffix / "metrics.json").read_text())
        drives.append(metrics["drives"][0])
    found, expected = ([one[key] for key in ("cte_mean_m", "laps", "speed_mph")] for one in drives)
    # A place that differs in its last digit changes a few pixels, and with them the steering.
    assert found == pytest.approx(expected, rel=1e-2)


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

    with served(
        exported.parent / "drive", "zoo.commands.drive", "model.onnx", "drive.port=0"
    ) as driver:
        client = LegacySocket(f"http://127.0.0.1:{driver.port}")

        def steering() -> str:
            frame = decode_image(picture((90, 120, 60)))
            client.emit("telemetry", make_telemetry(frame, 0.0, 0.0, 9.0, decimal_comma=False))
            while True:
                for name, argument in client.events(0.2):
                    if name == "steer":
                        return argument["steering_angle"]

        first = steering()
        status, answer = ask(driver.port, "GET", "/saliency.jpg")
        assert status == 503
        assert "ONNX" in answer["error"]
        for path in (str(checkpoint), "model.onnx"):
            _, state = ask(driver.port, "POST", "/command", {"switch": path})
            assert state["checkpoint"] == path
            assert float(steering()) == pytest.approx(float(first), abs=1e-4)
        assert ask(driver.port, "GET", "/state.json")[1]["fallbacks"] == 0
        client.close()
    assert any("PilotNet" in line and "252,219" in line for line in driver.lines)


def ask(port: int, method: str, path: str, body: object = None) -> tuple[int, dict]:
    connection = http.client.HTTPConnection("127.0.0.1", port)
    kind = {} if body is None else {"Content-Type": "application/json"}
    connection.request(method, path, None if body is None else json.dumps(body), kind)
    answer = connection.getresponse()
    return answer.status, json.loads(answer.read())


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
    with pytest.raises(InputError, match=rf"{package}: pip install 'drivezoo\[onnx\]'"):
        export_checkpoint(str(checkpoint), *files, Console(quiet=True))
    if package == "onnxruntime":
        with pytest.raises(InputError, match=r"onnxruntime.*pip install 'drivezoo\[onnx\]'"):
            load_policy(exported)
    else:
        assert load_policy(exported).outputs == 1, "driving needs only onnxruntime"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["docs"], "docs: "),
        (["CKPT", "out=model.pt"], "out=model.pt: "),
        (["CKPT", "out=absent/model.onnx"], "out=absent/model.onnx: "),
        (["CKPT", "out=FOLDER.onnx"], "folder.onnx: is a folder"),
        (["ONNX"], "model.onnx: "),
    ],
)
def test_a_mistake_is_one_line(
    arguments: list[str], text: str, exported: Path, checkpoint: Path, tmp_path: Path
) -> None:
    (tmp_path / "folder.onnx").mkdir()
    names = {"CKPT": str(checkpoint), "ONNX": str(exported)}
    folder = f"out={tmp_path / 'folder.onnx'}"
    given = [folder if one == "out=FOLDER.onnx" else names.get(one, one) for one in arguments]
    with pytest.raises(InputError) as error:
        export.main(given)
    assert text in str(error.value)


FRAME = (120, 160)


def random_checkpoint(view: View, kind: type[torch.nn.Module] = LeNet, **settings) -> Checkpoint:
    """Return a checkpoint of a network with random weights."""
    torch.manual_seed(0)
    height, width, channels = view.shape
    return Checkpoint(kind((channels, height, width), **settings).eval(), view, {"model": {}}, {})


def pictures(frame: tuple[int, int] = FRAME) -> list[np.ndarray]:
    """Return smooth frames, uint8 [H, W, 3]."""
    rng = np.random.default_rng(0)
    small = rng.integers(0, 256, (8, 6, 8, 3), np.uint8)
    return [cv2.resize(one, frame[::-1], interpolation=cv2.INTER_CUBIC) for one in small]


def difference(checkpoint: Checkpoint, folder: Path) -> float:
    """Return the largest difference of the written file's steering, relative to its spread."""
    path = folder / "pilot.h5"
    path.write_bytes(donkeycar_bytes(checkpoint)[0])
    both = (CheckpointPolicy(checkpoint), donkeycar_policy(checkpoint, path))
    ours, theirs = (
        np.array([one(frame, 0.0).steering for frame in pictures(checkpoint.view.frame)])
        for one in both
    )
    assert ours.std() > 0
    return float(np.abs(ours - theirs).max() / ours.std())


@needs_reader
@pytest.mark.parametrize("kind", [LeNet, PilotNet])
def test_layers_and_crop_are_exact(kind: type[torch.nn.Module], tmp_path: Path) -> None:
    checkpoint = random_checkpoint(View((40, 20), "rgb", None, frame=FRAME), kind)
    assert difference(checkpoint, tmp_path) < 1e-3


@needs_reader
@pytest.mark.parametrize("colour", ["rgb", "bgr", "gray", "yuv", "yuv_old"])
@pytest.mark.parametrize("resize", ["area", "linear_first"])
def test_colour_and_size_differ_by_rounding_only(colour: str, resize: str, tmp_path: Path) -> None:
    checkpoint = random_checkpoint(View((40, 20), colour, (32, 64), resize, FRAME))
    assert difference(checkpoint, tmp_path) < 0.1


def test_donkeycars_own_throttle_is_that_of_its_formula() -> None:
    assert inferred_throttle([-1.0, 0.0, 1.0]) == pytest.approx([1.0, 0.7538, 0.5565], abs=1e-4)


@needs_reader
def test_the_command_prints_the_throttle_and_the_key_that_bounds_it(
    recorded: Written, tmp_path: Path
) -> None:
    words = ("pilotnet", f"frames={recorded.folder}", "to=donkeycar", "out=pilot.h5")
    printed = succeed(run_here(tmp_path, *words, module="zoo.commands.export"))
    low, high = re.search(r"Throttle: ([\d.]+) to ([\d.]+) over", printed).groups()
    assert 0.5 < float(low) <= float(high) <= 1
    assert "throttle=0.2" in printed
    printed = succeed(run_here(tmp_path, *words, "throttle=0.15", module="zoo.commands.export"))
    assert "Throttle: 0.15 to 0.15" in printed
    assert "--type linear" in printed


@pytest.mark.parametrize("words", ["to=onnx throttle=0.2", "to=c throttle=0.2", "throttle=1.5"])
def test_a_throttle_that_cannot_be_is_refused(words: str, tmp_path: Path) -> None:
    result = run_here(tmp_path, "pilotnet", *words.split(), module="zoo.commands.export")
    assert result.returncode == 2
    assert "drivezoo export: throttle" in result.stderr
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(
    ("checkpoint", "words"),
    [
        (random_checkpoint(View((60, 40), "hsv_s", (32, 64))), "colour=hsv_s"),
        (random_checkpoint(View((0, 0), "rgb", (66, 200), "blur_linear")), "resize=blur_linear"),
        (random_checkpoint(View((0, 0), "rgb", (66, 200)), PilotNet, speed=True), "more than"),
        (random_checkpoint(View((0, 0), "rgb", (66, 200)), CommaAi, width=0.25), "CommaAi"),
    ],
)
def test_what_donkeycar_cannot_compute_is_refused(checkpoint: Checkpoint, words: str) -> None:
    with pytest.raises(InputError, match=words):
        donkeycar_bytes(checkpoint)


def test_a_refused_export_leaves_nothing(tmp_path: Path) -> None:
    write_constant(tmp_path / "constant.ckpt", 0.1)
    line = only_line(run(tmp_path, "constant.ckpt", "out=pilot.h5", module="zoo.commands.export"))
    assert "hsv_s" in line
    assert not list(tmp_path.glob("*pilot.h5*"))
