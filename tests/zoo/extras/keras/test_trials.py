"""Search of a network's input: what is tried, how it is judged, and what is found."""

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from torch import Tensor, nn

from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from datamodules.view import View
from tests.recordings import recording_in_memory, write_recording
from tests.zoo.extras.keras.keras_networks import write_steering_h5
from zoo.base.errors import InputError
from zoo.extras.keras.combinations import (
    CROPS,
    POPULAR,
    SCALES,
    Combination,
    KnownInput,
    TrialFrames,
    choose_rows,
    combinations,
    likeliest_combination,
    popular_combinations,
    read_trial_frames,
    with_each_resize,
)
from zoo.extras.keras.import_tables import print_judgement
from zoo.extras.keras.judgement import Driven, Judgement, judge, search
from zoo.extras.keras.keras_file import read_keras
from zoo.extras.keras.keras_import import _as_donkeycar, network_maker
from zoo.extras.keras.keras_layers import convert
from zoo.extras.keras.trials import Trial, Trials, concordance, planned_images

SIZE = (12, 40)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder = tmp_path_factory.mktemp("search") / "lake"
    return read_recordings(str(write_recording(folder, rows=200, seed=3).folder))


@pytest.fixture(scope="module")
def frames(recording: Recording) -> TrialFrames:
    return read_trial_frames(recording, 100)


@pytest.fixture
def steering_network(recording: Recording, tmp_path: Path) -> Callable:
    """Return a function from a view to the maker of a network that steers as recorded."""

    def make(view: View) -> Callable:
        converted = convert(read_keras(write_steering_h5(tmp_path / "m.h5", recording, view)))
        assert converted.scale is None
        return network_maker(converted)

    return make


@pytest.mark.parametrize(
    ("colour", "crop", "channels"),
    [
        ("yuv_old", (60, 25), 3),
        pytest.param("hsv", (70, 25), 3, marks=pytest.mark.slow),
        ("hsv_s", (70, 25), 1),
    ],
)
def test_colour_and_crop_of_the_training_are_found(
    colour: str, crop: tuple, channels: int, steering_network: Callable, frames: TrialFrames
) -> None:
    view = View(crop, colour, SIZE)
    model_input = KnownInput(shape=(*SIZE, channels), scale=SCALES[0])
    shares: list[float] = []
    judgement = search(steering_network(view), model_input, frames, shares.append)
    assert judgement.best.combination.view == view
    assert judgement.doubts == ()
    assert shares == sorted(shares)
    assert shares[-1] == 1


def test_the_progress_counts_every_image(steering_network: Callable, frames: TrialFrames) -> None:
    """Also those of the last stage, on all frames, which takes longest."""
    model_input = KnownInput(shape=(*SIZE, 3), scale=SCALES[0])
    make, seen = steering_network(View((60, 25), "rgb", SIZE)), [0]

    def counted(view: View, scale: tuple[float, float]) -> nn.Module:
        network = make(view, scale)

        def count(images: Tensor) -> Tensor:
            seen[0] += len(images)
            return network(images)

        return count

    shares: list[float] = []
    search(counted, model_input, frames, shares.append)
    planned = planned_images(model_input, frames)
    assert 0.5 * planned < seen[0] < 1.3 * planned
    assert sum(0.4 < share < 1 for share in shares) > 10
    assert shares[0] < 0.05


def test_an_unknown_scale_is_found(steering_network: Callable, frames: TrialFrames) -> None:
    make = steering_network(View((60, 25), "rgb", SIZE))
    model_input = KnownInput(shape=(*SIZE, 3), colour="rgb", crop=(60, 25))
    shown: list[Trial] = []
    judgement = search(make, model_input, frames, show_best=shown.append)
    assert judgement.best.combination.scale in ((127.5, 1.0), (128.0, 1.0))
    assert judgement.trials.finalists[0] in shown


def test_frames_lie_in_bends_all_over_the_recording() -> None:
    rows = choose_rows(recording_in_memory([0.0, 0.3, -0.3] * 100), 80)
    assert len(rows) == 80
    assert (rows % 3 > 0).all()
    assert (rows[0], rows[-1]) == (1, 299)
    with pytest.raises(InputError, match=r"/lake/0: only 0 of 300 rows .* bends"):
        choose_rows(recording_in_memory([0.01] * 300), 80)


def test_without_a_speed_all_rows_move() -> None:
    speed = np.repeat([0.0, 20.0, 0.5], 100)  # of a tub without odometer, and of a car that stops
    rows = choose_rows(recording_in_memory([0.3] * 300, speed, (100, 200)), 300)
    assert rows.tolist() == list(range(200))


def test_a_broken_image_names_its_row(tmp_path: Path) -> None:
    written = write_recording(tmp_path / "lake", rows=150)
    recording = read_recordings(str(written.folder))
    row = choose_rows(recording, 60)[5]
    written.image(row, "left").write_bytes(b"no image")
    with pytest.raises(InputError, match=rf"driving_log.csv, row {row + 1}: .*left_"):
        read_trial_frames(recording, 60)


PILOTNET = KnownInput(shape=(66, 200, 3), scale=SCALES[0])


def test_every_colour_of_three_channels_is_tried_with_every_crop_and_unknown_scale() -> None:
    entries = combinations(PILOTNET)
    assert len(entries) == len(set(entries)) == 5 * len(CROPS)
    assert {entry.view.colour for entry in entries} == {"rgb", "bgr", "yuv", "yuv_old", "hsv"}
    assert {entry.view.shape for entry in entries} == {(66, 200, 3)}
    unscaled = combinations(KnownInput(shape=(66, 200, 3), colour="rgb", crop=(60, 25)))
    assert [combination.scale for combination in unscaled] == list(SCALES)


def test_a_whole_frame_is_not_cropped() -> None:
    entries = combinations(KnownInput(shape=(160, 320, 3), scale=SCALES[0]))
    assert {(entry.view.crop, entry.view.size) for entry in entries} == {((0, 0), None)}
    for crop, frame in ((None, (160, 320)), ((0, 0), (66, 200))):
        donkeycar = _as_donkeycar(KnownInput(shape=(*frame, 3), crop=crop))
        assert (donkeycar.crop, donkeycar.frame) == ((0, 0), frame)


def test_a_crop_that_leaves_the_input_is_not_resized() -> None:
    entries = combinations(KnownInput(shape=(80, 320, 1), scale=SCALES[0]))
    assert {entry.view.colour for entry in entries} == {"gray", "hsv_s"}
    assert {entry.view.crop for entry in entries if entry.view.size is None} == {(60, 20), (55, 25)}
    likeliest = likeliest_combination(KnownInput(shape=(65, 320, 3), scale=SCALES[0]))
    assert likeliest.view == View((70, 25), "rgb", None)


def test_what_is_known_is_not_tried() -> None:
    model_input = replace(PILOTNET, colour="bgr", crop=(61, 26), resize="linear", scale=(2.0, 0.0))
    (only,) = combinations(model_input)
    assert only == Combination(View((61, 26), "bgr", (66, 200), "linear"), (2.0, 0.0))
    assert with_each_resize(only, model_input) == [only]


def test_the_popular_input_is_known_where_it_fits() -> None:
    assert popular_combinations(KnownInput(shape=(66, 200, 3))) == [POPULAR]
    for settings in ({"scale": (127.5, 1.0)}, {"colour": "rgb"}, {"resize": "area"}):
        assert popular_combinations(KnownInput(shape=(66, 200, 3), **settings)) == []
    assert popular_combinations(KnownInput(shape=(64, 64, 3))) == []


def test_resizing_before_the_colour_is_tried_where_it_differs() -> None:
    yuv = Combination(View((60, 25), "yuv", (66, 200)), SCALES[0])
    rgb = Combination(View((60, 25), "rgb", (66, 200)), SCALES[0])
    whole = Combination(View((0, 0), "yuv", None), SCALES[0])
    tried = [with_each_resize(base, PILOTNET) for base in (yuv, rgb, whole)]
    ways = [[way.view.resize for way in entries] for entries in tried]
    assert ways == [
        ["area", "linear", "area_first", "linear_first", "blur_linear"],
        ["area", "linear", "blur_linear"],
        ["area"],
    ]


ROWS = 240
STEERING = np.sin(np.arange(ROWS) / 5) * np.linspace(0.2, 0.6, ROWS)


def trial(
    colour: str = "rgb",
    gain: float = 1.0,
    noise: float = 0.0,
    side: float = 0.25,
    resize: str = "area",
    crop: tuple[int, int] = (60, 25),
    seed: int = 0,
) -> Trial:
    """Return a trial whose outputs are the steering with a gain and noise."""
    rng = np.random.default_rng(seed)
    center = gain * STEERING + rng.normal(0, noise, ROWS)
    combination = Combination(View(crop, colour, (66, 200), resize), SCALES[0])
    return Trial(combination, np.stack([center, center + side, center - side]), STEERING)


def judged(*trials: Trial, driven: tuple[Driven, ...] = ()):
    ranked = sorted(trials, key=lambda candidate: -candidate.score)
    return judge(Trials(tuple(ranked), tuple(ranked)), driven)


def test_what_a_network_saw_that_steers_as_recorded_is_certain() -> None:
    judgement = judged(trial(noise=0.1), trial("yuv", gain=0.3, noise=0.3, seed=1))
    assert judgement.doubts == ()
    assert judgement.best.combination.view.colour == "rgb"
    assert judgement.next.combination.view.colour == "yuv"
    assert 0 < judgement.chance < judgement.best.correlation


@pytest.mark.parametrize(
    ("doubtful", "reason"),
    [
        ({"gain": 0.0, "noise": 1.0}, "by chance"),
        ({"gain": 1.0, "noise": 0.62}, "correlation"),
        ({"gain": 0.05, "side": 0.01}, "spread is 0.05 times"),
        ({"side": -0.25}, "recovery response"),
    ],
)
def test_a_doubt_names_its_reason(doubtful: dict, reason: str) -> None:
    others = [trial(colour, gain=0, noise=1, side=0, seed=1) for colour in ("yuv", "bgr")]
    judgement = judge(Trials((trial(**doubtful), *others), (trial(**doubtful), *others)))
    assert any(reason in doubt for doubt in judgement.doubts)


# What networks return in place of the steering, as functions of it.
MEANINGS = {
    "steering": (1.0, 0.0),
    "(output - 0.5) x 2.4": (1 / 2.4, 0.5),
    "0..1": (0.5, 0.5),
    "degrees": (25.0, 0.0),
    "radians": (0.436, 0.0),
    "left positive": (-1.0, 0.0),
}


def meaning(original: Trial, name: str) -> Trial:
    factor, offset = MEANINGS[name]
    return replace(original, cameras=factor * original.cameras + offset)


@pytest.mark.parametrize("name", MEANINGS)
def test_a_colour_that_amplifies_is_not_ranked_higher(name: str) -> None:
    """It raises the agreement of a weak network, which says nothing of the colour."""
    weak, amplified = trial(gain=0.3, side=0.07), trial("yuv", noise=0.35, seed=1)
    assert amplified.agreement > weak.agreement
    assert meaning(weak, name).score > meaning(amplified, name).score


@pytest.mark.parametrize("name", MEANINGS)
def test_the_straight_line_tells_what_the_output_means(name: str) -> None:
    entry = meaning(trial(noise=0.05), name)
    factor, offset = MEANINGS[name]
    assert entry.line == pytest.approx((1 / factor, -offset / factor), rel=0.05, abs=0.01)
    # A factor of 2 is that of a network that steers weakly, too.
    assert entry.means_steering == (name in ("steering", "radians"))
    doubts = judged(entry, trial("yuv", gain=0, noise=1, seed=1)).doubts
    assert ["not like steering" in doubt for doubt in doubts] == [True] * (not entry.means_steering)


@pytest.mark.parametrize("gain", [0.4, 2.0])
def test_a_weak_or_strong_steering_is_steering(gain: float) -> None:
    assert trial(gain=gain, noise=0.1).means_steering


def test_a_constant_output_has_a_line() -> None:
    assert trial(gain=0).line == (0.0, pytest.approx(STEERING.mean()))


def printed(judgement: Judgement) -> str:
    console = Console(file=io.StringIO(), width=200)
    again = ["drivezoo", "import", "my net.h5", "recording=lake"]
    print_judgement(judgement, judgement.best.line, again, console)
    return console.file.getvalue()


@pytest.mark.parametrize("finished", [True, False])
@pytest.mark.parametrize("noise", [0.1, 0.62])
def test_what_it_saw_and_how_it_drives_are_two_sentences(finished: bool, noise: float) -> None:
    best = trial(noise=noise)
    lines = printed(judged(best, driven=(Driven(best, 150, finished, 0.3),))).splitlines()
    (saw,) = (line for line in lines if line.startswith("what it saw: colour=rgb 'crop=[60,25]'"))
    (drives,) = (line for line in lines if line.startswith("how it drives: "))
    assert ("not certain" in saw) == (noise > 0.5)
    assert ("left the lane after 150 m" in drives) == (not finished)
    failed = noise > 0.5 or not finished
    missing = [word for word in ("columns", "Canny", "blurs", "own pixels") if word in str(lines)]
    assert len(missing) == 4 * failed, "what no key does is told where the search fails"


def test_a_line_that_is_far_from_the_output_is_offered_as_a_key() -> None:
    text = printed(judged(meaning(trial(noise=0.05), "0..1")))
    assert "how it drives: not tried" in text
    assert "drivezoo import 'my net.h5' recording=lake 'steering=[" in text
    assert "steering=[" not in printed(judged(trial(noise=0.05)))
    assert "steering = 0.9" in printed(judged(trial(noise=0.05)))


def test_the_input_that_drives_is_taken() -> None:
    likely, driver = trial(noise=0.05), trial("yuv", gain=0.2, side=0.05, noise=0.06, seed=1)
    drives = (Driven(driver, 285, True, 0.3), Driven(likely, 60, False, 1.5))
    assert judged(likely, driver).best is likely
    assert judged(likely, driver, driven=drives).best is driver


def test_chance_counts_all_inputs_that_were_tried() -> None:
    alone = judged(trial(gain=0, noise=1))
    many = judged(*(trial(gain=0, noise=1, seed=seed) for seed in range(10)))
    assert many.chance > alone.chance


def test_inputs_that_steer_the_same_or_as_well_are_named() -> None:
    judgement = judged(trial(resize="linear"), trial(noise=0.001), trial("yuv", noise=0.6))
    assert judgement.best.combination.view.resize == "area", "the usual one"
    assert [trial.combination.view.resize for trial in judgement.alike] == ["linear"]
    assert not judgement.tied
    judgement = judged(trial("rgb", noise=0.2), trial("bgr", noise=0.2, seed=1))
    assert len(judgement.tied) == 1
    assert judgement.next is None


def test_concordance_sees_what_the_correlation_does_not() -> None:
    assert concordance(STEERING, STEERING) == pytest.approx(1)
    assert concordance(STEERING / 2, STEERING) < 0.9
    assert concordance(STEERING + 0.5, STEERING) < 0.5
    assert concordance(np.full(ROWS, np.nan), STEERING) == 0
    assert concordance(np.zeros(ROWS), np.zeros(ROWS)) == 0
