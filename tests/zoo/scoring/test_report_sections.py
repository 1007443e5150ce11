"""Parts of a report: a network's layers, a recovery, and the images of a scored drive."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import imageio_ffmpeg
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from torch import nn

from datamodules.recording import Recording
from datamodules.stretches import STRETCH_S
from tests.recordings import FPS, recording_in_memory
from tests.refusals import refusal
from tests.zoo.command_runs import run_here, succeed
from tests.zoo.compositions import composed
from zoo.base.compose import choices
from zoo.base.errors import InputError
from zoo.base.rig import UDACITY
from zoo.commands.evaluate import evaluate_or_replay as command
from zoo.commands.film import film
from zoo.driving.drive_film import WorstMoments, angle_text, badness
from zoo.driving.drive_log import read_drive
from zoo.driving.drive_record import DriveRow
from zoo.models.make_network import make_network, view_of
from zoo.models.network_facts import facts_of
from zoo.scoring.data_section import find_recovery, signed
from zoo.scoring.drive_section import infractions
from zoo.scoring.training_section import metrics_table, network_layers


@pytest.mark.parametrize("model", choices("model"))
def test_the_parameters_of_the_layers_add_up(model: str) -> None:
    config = composed(f"model={model}")
    view = view_of(config["model"], config["data"]["crop"])
    network = make_network(config["model"], view)
    layers = network_layers(network, view.shape)

    assert sum(layer.parameters for layer in layers) == sum(p.numel() for p in network.parameters())
    facts = facts_of(network)
    steps = 1 + (facts.window.ahead if facts.window else 0)
    assert layers[-1].shape == (facts.columns * steps,)
    assert {layer.name for layer in layers} <= dict(network.named_modules()).keys()


class Odd(nn.Module):
    """A network with a layer that is used twice, and a parameter outside layers."""

    takes_speed, outputs = False, 1

    def __init__(self) -> None:
        super().__init__()
        self.layer, self.scale = nn.Conv2d(1, 1, 1), nn.Parameter(torch.ones(3))

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        return self.layer(self.layer(images)).mean((1, 2, 3))[:, None] * self.scale.sum()


def test_a_layer_used_twice_counts_once_and_no_parameter_is_lost() -> None:
    layers = network_layers(Odd(), (4, 4, 1))
    assert [layer.parameters for layer in layers] == [2, 0, 3]
    assert layers[-1].name == ""


LENGTH = round(STRETCH_S * FPS)
BEND, BACK = 60, 200  # rows where a sharp bend and a recovery begin


def driven(pause: bool) -> Recording:
    """Return a recording with a sharp bend, then a recovery, with or without a pause before it."""
    steering = np.zeros(300)
    steering[BEND : BEND + 20] = 0.8
    steering[BACK : BACK + 15] = np.linspace(-0.4, 0, 15)
    recording = recording_in_memory(steering)
    time = recording.time_s.copy()
    time[BACK:] += 5.0 if pause else 0.0
    return replace(recording, time_s=time)


def test_a_recovery_after_a_pause_goes_before_a_sharper_bend() -> None:
    rows, why = find_recovery(driven(pause=True))
    assert rows.tolist() == list(range(BACK, BACK + LENGTH))
    assert "follow a pause" in why
    assert "0.40" in why


def test_without_a_pause_the_largest_return_is_shown_with_a_warning() -> None:
    rows, why = find_recovery(driven(pause=False))
    assert BEND in rows
    assert BACK not in rows
    assert "may be a sharp bend" in why


def test_a_stretch_never_crosses_a_pause_or_another_recording() -> None:
    steering = np.zeros(200)
    steering[80:110] = 0.9
    recording = recording_in_memory(steering, sizes=(100, 100))
    rows, _ = find_recovery(recording)
    assert len(set(recording.recording[rows])) == 1


@pytest.mark.parametrize(
    ("rows", "steering", "words"),
    [(20, 0.5, "No stretch of 3 s"), (200, 0.3, "hardly changes")],
)
def test_a_missing_recovery_has_a_reason(rows: int, steering: float, words: str) -> None:
    assert words in refusal(find_recovery, recording_in_memory(np.full(rows, steering)))


def test_causes_are_those_of_all_drives() -> None:
    drive = SimpleNamespace(track="lake", summary={"infractions": {"left": 1}})
    heading, rows = infractions(SimpleNamespace(tracks=["lake"], drives=[drive, drive]))
    assert "all drives" in heading.text
    assert ("left the road to the left", "2") in rows.table.cells


def test_standing_still_is_no_recovery() -> None:
    steering = np.zeros(200)
    steering[100:120] = 1.0
    assert "No stretch" in refusal(find_recovery, recording_in_memory(steering, speed_mph=0.0))


FRAME = np.zeros((160, 320, 3), np.uint8)


@given(
    st.lists(st.tuples(st.floats(-4, 4), st.booleans()), min_size=1, max_size=200),
    st.integers(1, 5),
)
def test_the_worst_moments_are_not_near(drive: list[tuple[float, bool]], count: int) -> None:
    rows = [
        DriveRow(time_s=number / 15, cross_track_m=error, intervention=lost)
        for number, (error, lost) in enumerate(drive)
    ]
    moments = WorstMoments(count)
    for row in rows:
        moments(FRAME, row)
    worst = [row for _, row, _ in moments.moments]
    assert 1 <= len(worst) <= count
    assert max(map(badness, worst)) == max(map(badness, rows))
    assert np.diff([row.time_s for row in worst]).min(initial=9.0) >= moments.apart_s
    assert all(rows[number] is row for number, row, _ in moments.moments)


def test_an_intervention_is_worse_than_any_distance() -> None:
    moments = WorstMoments(count=1)
    for number, (error, lost) in enumerate([(3.0, False), (0.5, True), (2.0, False)]):
        moments(FRAME, DriveRow(time_s=10.0 * number, cross_track_m=error, intervention=lost))
    assert [row.intervention for _, row, _ in moments.moments] == [True]


def test_what_rounds_to_zero_has_no_minus() -> None:
    scores = {"mse": 0.0, "mae": 0.0, "balanced_mae": 0.0, "bias": -1e-6}
    assert metrics_table("net", {"val": scores}, {"val": {}}).cells[0][-1] == "+0.0000"
    assert (signed(-1e-6), angle_text(-1e-6, UDACITY)) == ("+0.000", "+0.0°")


def test_a_scored_drive_can_be_filmed(checkpoint: str, tmp_path: Path) -> None:
    options = ("laps=0.015", "speed=25", "quality=simple", "workers=1")
    filmed = (*options, "film=true", "film_speed=3", "out=filmed")
    printed = succeed(run_here(tmp_path, checkpoint, *filmed, module="zoo.commands.evaluate"))
    assert "wrote: filmed/lake-0/film.mp4" in printed.splitlines()
    report = (tmp_path / "filmed" / "report" / "report.md").read_text()
    for setting in ("laps=0.015", "speed=25", "weather=clear", "quality=simple"):
        assert setting in report
    command([checkpoint, *options, f"out={tmp_path / 'plain'}"])
    filmed, plain = (read_drive(tmp_path / name / "lake-0") for name in ("filmed", "plain"))
    assert filmed.steering.tolist() == plain.steering.tolist()
    assert not (plain.folder / "film.mp4").exists()
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(filmed.folder / "film.mp4"))
    assert frames == -(-len(filmed) // 3)
    assert seconds == pytest.approx(frames / 15, abs=0.1)
    about = next(imageio_ffmpeg.read_frames(str(filmed.folder / "film.mp4")))
    assert about["source_size"] == (640, 320)

    names = [name for name in plain.frame if name]
    assert 1 <= len(names) <= 10
    worst = int(np.abs(plain.cross_track_m).argmax())
    assert plain.intervention.any() or plain.frame[worst]
    for name in names:
        with Image.open(plain.folder / name) as image:
            assert image.size == (320, 160)


def test_ten_moments_are_not_a_film(tmp_path: Path) -> None:
    from zoo.driving.drive_log import DriveWriter

    writer = DriveWriter(tmp_path)
    writer.add(DriveRow(i / 15, frame="frames/0.jpg" if i == 5 else "") for i in range(200))
    writer.close()
    with pytest.raises(InputError, match=r"worst moments; .*film=true"):
        film(tmp_path, out=tmp_path / "film.mp4")
