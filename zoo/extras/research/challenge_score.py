"""Score of steering angles on the official test of Udacity's Challenge 2, beside its teams'.

The test is 5,614 frames of one drive. Its score is the root mean squared error of the steering
wheel's angle in radians on two halves, public and private, whose frames interleave.

Source: https://github.com/udacity/self-driving-car, challenges/challenge-2.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console

from datamodules.driving_log import BadRows
from datamodules.formats.challenge2 import TEST, UNIT
from datamodules.formats.labels import decimal, read_csv
from datamodules.image import read_image
from datamodules.recording import Recording, file_name
from datamodules.recording_format import read_recordings
from datamodules.split import KINDS, split_rows
from datamodules.stretches import find_breaks
from zoo.base.bounded_files import open_text
from zoo.base.console_progress import progress_bar
from zoo.base.errors import InputError, UsageError
from zoo.base.file_text import csv_text
from zoo.base.new_folder import command_folder
from zoo.base.rig import UDACITY, Rig
from zoo.base.terminal import counted, print_written
from zoo.base.whole_file import write_whole
from zoo.checkpoints.checkpoint_path import short_name
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.checkpoints.policy_base import Policy, PolicyFunction
from zoo.driving.intervals import Estimate, bootstrap
from zoo.driving.run_drives import one_thread
from zoo.extras.research.challenge_options import ChallengeOptions
from zoo.runs.metrics_file import write_metrics_file
from zoo.runs.result_table import Column, Table, interval_column
from zoo.runs.table_files import Result
from zoo.scoring.evidence import source_of

HALVES = {"private": 0, "public": 1}  # value of the column `public`
HEADER = ("frame_id", "steering_angle")  # of a submission
MOST_BYTES = 100_000_000  # of a submission
BLOCK_S = 10.0  # neighbouring frames are alike: an interval resamples blocks of this length


@dataclass(frozen=True)
class OfficialTest:
    """The frames of the test.

    Attributes:
        recording: frames and true angles.
        frame_ids: name of each frame, nanoseconds.
        public: 1 for a frame of the public half, 0 for one of the private half, float64 [N].
    """

    recording: Recording
    frame_ids: list[str]
    public: np.ndarray

    @property
    def rig(self) -> Rig:
        """Return the car of the format."""
        assert self.recording.rig is not None
        return self.recording.rig

    @property
    def angles(self) -> np.ndarray:
        """Return the true angle of the wheel, radians, positive left, float64 [N]."""
        return UNIT.written(self.recording.steering)

    def rmse(self, rows: np.ndarray, angles: np.ndarray) -> dict[str, Estimate]:
        """Return the error of angles, radians, float64 [n], of rows on each half."""
        errors, block = angles - self.angles[rows], self.blocks(rows)
        masks = {half: self.public[rows] == number for half, number in HALVES.items()}
        return {half: block_rmse(errors[mask], block[mask]) for half, mask in masks.items()}

    def blocks(self, rows: np.ndarray) -> np.ndarray:
        """Return the number of each row's block of time, float64 [n]."""
        return np.floor((self.recording.time_s[rows] - self.recording.time_s[0]) / BLOCK_S)


def read_test(folder: str | Path) -> OfficialTest:
    """Read the test of a folder.

    Raises:
        InputError: the folder lacks the table or a frame, or a row is wrong.
    """
    path = Path(folder).expanduser() / TEST
    if not path.is_file():
        raise InputError(f"{path}: no such file; name the folder of the test with data=FOLDER")
    recording = read_recordings(str(folder), format="challenge2")
    frame_ids = [Path(file_name(str(image))).stem for image in recording.images[:, 0]]
    public = of_frames(path, read_column(path, "public"), frame_ids)
    if unknown := set(public.tolist()) - set(HALVES.values()):
        raise InputError(f"{path}: public is {min(unknown):g} in a row; it must be 0 or 1")
    return OfficialTest(recording, frame_ids, public)


@dataclass(frozen=True, repr=False)
class Challenge(Result):
    """The score of a network, baselines and teams on the official test.

    Attributes:
        folder: folder with `metrics.json` and the network's submission.
        rmse: by name of the network, baseline or team, then by half: root mean squared error of
            the wheel's angle, radians, with a 95 % interval over blocks of 10 s.
        frames: number of scored frames.
        notes: what the figures assume.
        checkpoint: path of the checkpoint, or the policy's name.
        problem: what makes the figures invalid; empty if nothing does.
        written: further files that the user asked for.
    """

    folder: Path
    rmse: dict[str, dict[str, Estimate]]
    frames: int
    notes: list[str]
    checkpoint: str
    problem: str = ""
    written: list[Path] = field(default_factory=list)

    def __repr__(self) -> str:
        private = self.rmse[self.checkpoint]["private"].value
        return f"Challenge in {self.folder}: RMSE {private:.4f} rad on the private half"

    def show(self) -> None:
        """Print the table, the notes and what was written."""
        console = Console(emoji=False)
        console.print(self.result_table().narrow().printed(left=1, whole=[0]))
        for line in self.notes:
            console.print(line, highlight=False, markup=False, soft_wrap=True)
        print_written([self.folder, *self.written], ["replay", self.checkpoint, "FOLDER"], console)

    def result_table(self) -> Table:
        """Return a row for each name, ascending by the error on the private half."""
        error = {name: by_half["private"].value for name, by_half in self.rmse.items()}
        names = sorted(error, key=lambda name: (math.isnan(error[name]), error[name]))
        columns = [Column("steering", "steering", names)]
        for half in HALVES:
            rmse, heading = [self.rmse[name][half] for name in names], f"{half}: RMSE, rad"
            columns.append(interval_column(f"{half}_rmse_rad", heading, rmse, "{:.4f}"))
        return Table(columns, f"Official test of Challenge 2, {self.frames:,} frames")


def score_challenge(
    driver: str | Policy | PolicyFunction, folder: str, options: ChallengeOptions, console: Console
) -> Challenge:
    """Score a network on the test's frames; write `metrics.json` and its submission.

    Args:
        driver: path of a checkpoint, or a policy.
        folder: folder with the test's table, its frames in `center`, and submissions of teams as
            further CSV files.
        options: options of the score.
        console: console for the progress.

    Raises:
        InputError: the checkpoint cannot be loaded, frames are missing, a table is wrong, or the
            network's car is unknown.
        UsageError: the network was trained on these frames, and no split says on which.
    """
    options.check_files(inputs=[folder])
    test = read_test(folder)
    policy = load_policy(driver)
    name = short_name(Path(driver)) if isinstance(driver, str) else policy.name
    rows = scored_rows(policy, test.recording, options.split)
    car = car_of(policy, test, name)
    teams = {team: angles[rows] for team, angles in team_angles(folder, test.frame_ids)}
    angles = steer_rows(policy, test, rows, car, options.speed, console)
    steered = {**baselines(test.angles, rows), name: angles}
    steered |= {f"{team}.csv" if team in steered else team: teams[team] for team in teams}
    rmse = {entry: test.rmse(rows, radians) for entry, radians in steered.items()}
    with command_folder(options.out, "challenges") as out:
        lines = zip((test.frame_ids[row] for row in rows), angles.tolist(), strict=True)
        write_whole(out / "submission.csv", csv_text([HEADER, *lines]))
        scores = {
            entry: {half: asdict(estimate) for half, estimate in by_half.items()}
            for entry, by_half in rmse.items()
        }
        about = {"checkpoint": name, "recording": list(test.recording.names)}
        write_metrics_file(out, about | {"challenge": {"rmse_rad": scores, "frames": len(rows)}})
        bad = int((~np.isfinite(angles)).sum())
        problem = f"{name}: steered NaN in {bad:,} frames; train a network with a smaller optim.lr"
        notes = list(assumptions(policy, test, rows, options))
        result = Challenge(out, rmse, len(rows), notes, name, problem if bad else "")
        result.written.extend(options.write_files(result))
        return result


def scored_rows(policy: Policy, recording: Recording, split: str | None) -> np.ndarray:
    """Return the numbers of the rows to score: all, or the test rows of a split.

    Raises:
        InputError: the split's file is wrong.
        UsageError: the network was trained on the recording, and no split is named, or one of whose
            test rows it was trained on some.
    """
    own = recording.fingerprint()
    trained = [member for member in policy.members if member.data.get("fingerprint") == own]
    if split is None:
        if trained:
            raise UsageError(
                "this network was trained on frames of the test; score it on those that it did not "
                "see: split=RUN/split.csv"
            )
        return np.arange(len(recording))
    rows = split_rows(recording, split, val_share=0, test_share=0).test
    if not len(rows):
        raise InputError(f"{split}: has no test rows of this recording; name another split=")
    for said in (member.config.get("data", {}) for member in trained):
        if said.get("split") not in KINDS:
            continue
        shares = {key: said[key] for key in ("val_share", "test_share", "block_s", "gap_s")}
        train = split_rows(recording, said["split"], **shares, seed=said["split_seed"]).train
        if seen := np.isin(rows, train).sum():
            raise UsageError(
                f"{split}: the network was trained on {seen:,} of its {len(rows):,} test rows; "
                "name the split.csv of the network's own run"
            )
    return rows


def car_of(policy: Policy, test: OfficialTest, name: str) -> Rig:
    """Return the car whose steering the network returns, and set the driven car of its members.

    Raises:
        InputError: the car is unknown, or the members of an ensemble steer different cars.
    """
    policy.in_car(test.rig)
    cars = {
        (source_of(member.data) or UDACITY.name) if member.label.is_steering else test.rig.name
        for member in policy.members
    }
    if len(cars) == 1 and (car := {rig.name: rig for rig in (test.rig, UDACITY)}.get(min(cars))):
        return car
    raise InputError(
        f"{name}: the steering range of its car ({' or '.join(sorted(cars))}) is not in the "
        "checkpoint, so that its steering is no angle of this car; train it with "
        "data.label=curvature"
    )


def steer_rows(
    policy: Policy,
    test: OfficialTest,
    rows: np.ndarray,
    car: Rig,
    speed_mph: float,
    console: Console,
) -> np.ndarray:
    """Return the wheel's angle, radians, positive left, float64 [n], that a policy steers to.

    Args:
        policy: network or function.
        test: frames of the test.
        rows: numbers of the rows, ascending, int64 [n].
        car: car that the policy's steering is of; the angle is that of the same curvature.
        speed_mph: speed that the policy is given, since the test has none.
        console: console for the progress.
    """
    broken = find_breaks(test.recording)
    steering = np.empty(len(rows))
    with progress_bar(f"steering {len(rows):,} frames", console) as shown, one_thread():
        for number, row in enumerate(rows.tolist()):
            if number == 0 or rows[number - 1] != row - 1 or broken[row - 1]:
                policy.reset()
            steering[number] = policy(read_image(test.recording.images[row, 0]), speed_mph).steering
            shown((number + 1) / len(rows))
    if car != test.rig:
        steering = test.rig.steering_of(car.curvature(steering))
    return UNIT.written(steering)


def baselines(angles: np.ndarray, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Return the angles of predictors that look at no image; two of them know the true angles."""
    return {
        "always zero": np.zeros(len(rows)),
        "mean angle of these frames": np.full(len(rows), angles[rows].mean()),
        "true angle of the frame before": angles[np.maximum(rows - 1, 0)],
    }


def block_rmse(errors: np.ndarray, block: np.ndarray) -> Estimate:
    """Return a root mean squared error with a 95 % interval over blocks of time.

    Args:
        errors: errors of frames, float64 [n].
        block: number of each frame's block, float64 [n]; blocks are resampled, frames are not.

    >>> block_rmse(np.array([1.0, -1.0, 1.0, 1.0]), np.array([0, 0, 1, 2])).value
    1.0
    """
    _, index = np.unique(block, return_inverse=True)
    mean = errors @ errors / max(len(errors), 1)
    # What a block adds to the mean over frames, of which the last block may have few.
    sums = np.bincount(index, errors**2 - mean)
    squares = bootstrap(mean + sums * (len(sums) / max(len(errors), 1)), limits=(0, math.inf))
    return Estimate(*np.sqrt([squares.value, squares.low, squares.high]).tolist())


def team_angles(folder: str | Path, frame_ids: list[str]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the name and the angles, float64 [N], of each submission beside the test's table.

    A submission without any of the frames is left out: the challenge's example of another test lies
    in the same folder.

    Raises:
        InputError: see `read_column`.
    """
    for path in sorted(Path(folder).expanduser().glob("*.csv")):
        with open_text(path, MOST_BYTES, errors="replace") as file:
            header = file.readline(100).strip()
        if path.name != TEST and header == ",".join(HEADER):
            angles = read_column(path, HEADER[1])
            if not angles.keys().isdisjoint(frame_ids):
                yield path.stem, of_frames(path, angles, frame_ids)


def read_column(path: Path, column: str) -> dict[str, float]:
    """Return a column's numbers by `frame_id`.

    Raises:
        InputError: the file cannot be read, or has a bad row.
    """
    bad = BadRows()
    numbers: dict[str, float] = {}
    for label, fields in read_csv(path, (HEADER[0], column), bad):
        try:
            number, frame = decimal(fields, column), fields[HEADER[0]]
            if column == HEADER[1] and abs(number) > UNIT.full:
                raise ValueError(
                    f"{column} is {fields[column]}, beyond the wheel's {UNIT.full:g} radians; "
                    "divide degrees by 57.3"
                )
            if frame in numbers:
                raise ValueError(f"has the frame {frame:.40} for the second time")
            numbers[frame] = number
        except ValueError as error:
            bad.faults.append(f"{label}: {error}")
    if bad.faults:
        raise InputError(f"{bad.faults[0]}; correct or delete the row")
    return numbers


def of_frames(path: Path, numbers: Mapping[str, float], frame_ids: list[str]) -> np.ndarray:
    """Return the numbers of frames, float64 [N].

    Raises:
        InputError: a frame has none.
    """
    missing = [frame for frame in frame_ids if frame not in numbers]
    if missing:
        raise InputError(
            f"{path}: has no row of the frame {missing[0]} ({len(missing):,} of {len(frame_ids):,} "
            "frames lack one); complete it, or move it to another folder"
        )
    return np.array([numbers[frame] for frame in frame_ids])


def assumptions(
    policy: Policy, test: OfficialTest, rows: np.ndarray, options: ChallengeOptions
) -> Iterator[str]:
    """Yield what the figures assume and mean."""
    blocks = counted(len(np.unique(test.blocks(rows))), "block")
    yield f"interval: 95 %, bootstrap over {blocks} of {BLOCK_S:g} s"
    if policy.takes_speed:
        yield f"the test has no speed: the network was given {options.speed:g} mph"
    if any(source_of(member.data) != test.rig.name for member in policy.members):
        yield (
            f"zero shot: its recording is of another car; the angle is that of the same curvature "
            f"on the {test.rig.name} (GUESSED: {', '.join(test.rig.guesses)})"
        )
    if options.split is not None:
        yield f"the {len(rows):,} test rows of {options.split} alone, for all rows of the table"
