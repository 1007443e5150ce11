"""The official test of Challenge 2: its score, its baselines and the teams' submissions."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import drivezoo
from datamodules.recording_format import read_recordings
from datamodules.split import split_rows, write_split
from tests.foreign_recordings import challenge2_test
from tests.refusals import refusal
from zoo.base.errors import InputError, UsageError
from zoo.checkpoints.policy_base import Command, Policy
from zoo.commands.evaluate import evaluate_or_replay as command
from zoo.driving.intervals import Estimate
from zoo.extras.research.challenge_score import block_rmse
from zoo.extras.research.doubt_policy import EnsemblePolicy

TEST = "CH2_final_evaluation.csv"


class RightHalf(Policy):
    """A policy of Udacity's car that always steers half of its lock to the right."""

    def __call__(self, frame: object, speed_mph: float) -> Command:
        return Command(0.5)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return the folder of a small test whose frames are public and private in turns."""
    path = challenge2_test(tmp_path / "test")
    header, *rows = (path / TEST).read_text().splitlines()
    rows = [f"{row[:-1]}{number % 2}" for number, row in enumerate(rows)]
    (path / TEST).write_text("\n".join([header, *rows, ""]))
    return path


def frames_of(path: Path) -> tuple[list[str], np.ndarray]:
    rows = list(csv.DictReader(path.read_text().splitlines()))
    angles = np.array([float(row["steering_angle"]) for row in rows])
    return [row["frame_id"] for row in rows], angles


def write_team(folder: Path, name: str, angles: np.ndarray) -> Path:
    rows = zip(frames_of(folder / TEST)[0], angles.tolist(), strict=True)
    text = "".join(f"{frame},{angle!r}\n" for frame, angle in rows)
    (folder / name).write_text(f"frame_id,steering_angle\n{text}")
    return folder / name


def test_the_errors_are_those_of_the_angles_of_each_half(folder: Path, tmp_path: Path) -> None:
    frames, angles = frames_of(folder / TEST)
    write_team(folder, "team.csv", angles + 0.25)
    result = drivezoo.challenge(RightHalf(), folder, out=tmp_path / "out")

    private = np.arange(len(frames)) % 2 == 0
    assert result.rmse["team"]["public"].value == pytest.approx(0.25)
    zero = np.sqrt((angles[private] ** 2).mean())
    assert result.rmse["always zero"]["private"].value == pytest.approx(zero)
    # The same curvature on the wheels of the road car, whose wheelbase and lock are others.
    degrees = np.degrees(np.arctan(2.85 * np.tan(np.radians(12.5)) / 2.87))
    wheel = -np.radians(degrees) * 14.8
    error = np.sqrt(((angles[private] - wheel) ** 2).mean())
    assert result.rmse["policy"]["private"].value == pytest.approx(error, rel=1e-3)
    sent, steering = frames_of(tmp_path / "out" / "submission.csv")
    assert sent == frames
    assert steering[0] == pytest.approx(wheel, rel=1e-3)
    saved = json.loads((tmp_path / "out" / "metrics.json").read_text())["challenge"]
    assert saved["rmse_rad"]["team"]["private"]["value"] == pytest.approx(0.25)
    lost = {"lost": dict.fromkeys(("private", "public"), Estimate(np.nan))}
    names = replace(result, rmse=lost | result.rmse).result_table().columns[0].cells
    assert names[-1] == "lost", "below the errors that are known"


def test_a_file_of_other_frames_is_left_out(folder: Path, tmp_path: Path) -> None:
    (folder / "example.csv").write_text("frame_id,steering_angle\n1,0.5\n")
    result = drivezoo.challenge(RightHalf(), folder, out=tmp_path / "out")
    assert "example" not in result.rmse


@pytest.mark.parametrize("name", ["policy", "always zero"])
def test_a_team_replaces_neither_the_network_nor_a_baseline(
    folder: Path, tmp_path: Path, name: str
) -> None:
    write_team(folder, f"{name}.csv", frames_of(folder / TEST)[1])
    result = drivezoo.challenge(RightHalf(), folder, out=tmp_path / "out")
    assert result.rmse[name]["private"].value > 0.1
    assert result.rmse[f"{name}.csv"]["private"].value < 1e-9


def test_blocks_of_frames_are_resampled_and_not_frames() -> None:
    errors = np.repeat([0.0, 1.0, 0.0, 1.0, 0.0, 1.0], 200)
    by_frame = block_rmse(errors, np.arange(1200))
    by_block = block_rmse(errors, np.repeat(np.arange(6), 200))
    assert by_frame.value == by_block.value == pytest.approx(np.sqrt(0.5))
    assert by_block.high - by_block.low > 5 * (by_frame.high - by_frame.low)
    short = block_rmse(np.full(450, 0.1), np.arange(450) // 200)  # the last block has few frames
    assert (short.low, short.high) == pytest.approx((0.1, 0.1))


def test_a_network_of_these_frames_needs_a_split(folder: Path, tmp_path: Path) -> None:
    policy = RightHalf()
    policy.data = {"fingerprint": read_recordings(str(folder)).fingerprint()}
    with pytest.raises(UsageError, match="split="):
        drivezoo.challenge(policy, folder)

    frames = frames_of(folder / TEST)[0]
    rows = [f"{frame}.jpg,{'test' if frame in frames[:4] else 'train'}\n" for frame in frames]
    (tmp_path / "split.csv").write_text("".join(["image,part\n", *rows]))
    result = drivezoo.challenge(policy, folder, split=tmp_path / "split.csv", out=tmp_path / "out")
    assert result.frames == 4
    assert "over 1 block of 10 s" in result.notes[0]


def test_each_member_of_an_ensemble_counts(folder: Path, tmp_path: Path) -> None:
    recording, members = read_recordings(str(folder)), [RightHalf(), RightHalf()]
    assert recording.rig is not None
    members[1].data = {"fingerprint": recording.fingerprint(), "source": recording.rig.name}
    policy = EnsemblePolicy(members)
    with pytest.raises(UsageError, match=r"split="):
        drivezoo.challenge(policy, folder, out=tmp_path / "out")
    members[1].data = {"source": recording.rig.name}
    with pytest.raises(InputError, match=f"{recording.rig.name} or udacity"):
        drivezoo.challenge(policy, folder, out=tmp_path / "out")


def test_a_split_of_another_run_is_refused(folder: Path, tmp_path: Path) -> None:
    recording, policy = read_recordings(str(folder)), RightHalf()
    shares = {"val_share": 0.1, "test_share": 0.3}
    trained = {"split": "random", "split_seed": 0, "block_s": None, "gap_s": None, **shares}
    policy.data, policy.config = {"fingerprint": recording.fingerprint()}, {"data": trained}
    for seed in (0, 1):
        split = split_rows(recording, "random", seed=seed, **shares)
        write_split(tmp_path / f"{seed}.csv", recording, split)
    assert drivezoo.challenge(policy, folder, split=tmp_path / "0.csv", out=tmp_path / "out").frames
    with pytest.raises(UsageError, match=r"1\.csv: .*trained on \d+ of its \d+ test rows"):
        drivezoo.challenge(policy, folder, split=tmp_path / "1.csv", out=tmp_path / "out")


def test_a_car_whose_steering_range_is_unknown_is_refused(folder: Path) -> None:
    policy = RightHalf()
    policy.data = {"source": "a club's car"}
    with pytest.raises(InputError, match=r"a club's car.*data\.label=curvature"):
        drivezoo.challenge(policy, folder)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("degrees", "divide degrees"),
        ("short", "of the frame"),
        ("twice", "for the second time; correct or delete the row"),
        ("public", "public"),
        ("image", "no centre image"),
        ("none", "name the folder of the test"),
    ],
)
def test_a_damaged_test_is_one_line(folder: Path, change: str, words: str) -> None:
    frames, angles = frames_of(folder / TEST)
    if change == "degrees":
        write_team(folder, "team.csv", np.degrees(angles) + 40)
    elif change == "short":
        team = write_team(folder, "team.csv", angles)
        team.write_text("\n".join(team.read_text().splitlines()[:-1] + [""]))
    elif change == "twice":
        team = write_team(folder, "team.csv", angles)
        team.write_text(team.read_text() + f"{frames[0]},1.0\n")
    elif change == "public":
        (folder / TEST).write_text((folder / TEST).read_text().replace(",1\n", ",2\n"))
    elif change == "image":
        (folder / "center" / f"{frames[1]}.jpg").unlink()
    else:
        (folder / TEST).unlink()
    assert words in refusal(drivezoo.challenge, RightHalf(), folder)


@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        (["challenge=ch3", "data=x"], "did you mean ch2"),
        (["challenge=ch2"], "data=FOLDER"),
        (["data=x"], "challenge=ch2"),
        (["challenge=ch2", "challenge=ch2"], "twice"),
    ],
)
def test_keys_of_a_test_come_together(words: list[str], remedy: str) -> None:
    with pytest.raises(UsageError, match=remedy):
        command(["lenet", *words])


def test_a_folder_as_world_is_a_replay(folder: Path) -> None:
    line = refusal(command, ["lenet", f"world={folder}"])
    assert "speed" in line  # of which the test has none
