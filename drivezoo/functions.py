"""A function for each command, and functions of files; keywords are the command's keys."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from zoo.base.command_keys import typed_keys
from zoo.base.console_script import challenge_command
from zoo.base.errors import UsageError, library_errors
from zoo.base.key_values import constructed, convert
from zoo.base.output_files import overwriting
from zoo.base.parts import name_parts
from zoo.base.run_command import expected_failure
from zoo.base.terminal import counted
from zoo.commands.benchmark import benchmark as benchmark_command
from zoo.commands.compare import comparison_of
from zoo.commands.drive import drive as drive_command
from zoo.commands.evaluate import evaluate as evaluate_command
from zoo.commands.leaderboard import leaderboard as leaderboard_command
from zoo.commands.replay import replay as replay_command
from zoo.commands.results import read_finished
from zoo.commands.results import results as results_command
from zoo.driving.drive_log import SUMMARY_NAME, read_summary
from zoo.driving.metrics import METRICS
from zoo.runs.result_table import Cell, Table
from zoo.runs.run_record import Run
from zoo.runs.table_files import Result
from zoo.runs.table_files import write_table as write_result_table

if TYPE_CHECKING:
    import gymnasium
    import numpy as np

    from zoo.checkpoints.policy_base import Policy
    from zoo.driving.drive_loop import EnvironmentPolicy
    from zoo.results.benchmarked import Benchmarked
    from zoo.scoring.driven_road import DrivenRoad

Given = ParamSpec("Given")
Returned = TypeVar("Returned")


class Training(Run, Result):
    """A finished training: a run with the table of its figures."""

    @classmethod
    def read(cls, folder: str | Path) -> Training:
        """Return the training of a run's folder.

        Raises:
            InputError: the folder has no figures of a finished run.
        """
        return cls(read_finished([folder]).runs[0].folder)

    def __fspath__(self) -> str:
        """Return the folder, so that commands take the training as a path."""
        return str(self.folder)

    @property
    def checkpoint(self) -> Path | None:
        """Return the best checkpoint, or the last; None if the run kept none."""
        return self.checkpoint_path

    @property
    def figures(self) -> dict[str, Cell]:
        """Return the only row of the table: model, seed, errors and driving figures by name."""
        return self.table()[0]

    def __repr__(self) -> str:
        from zoo.scoring.track_scores import how_well  # slow import: matplotlib

        figures = self.figures
        lines = [f"  {track}: {how_well(scores)}" for track, scores in self.tracks.items()]
        if (mse := figures.get("test_mse")) is not None:
            lines.insert(0, f"  test MSE {mse:.4f}, always zero {figures['test_mse_zero']:.4f}")
        return "\n".join([f"Training of {figures['experiment']} in {self.folder}", *lines])

    def result_table(self) -> Table:
        """Return one row, as `drivezoo results` prints it."""
        return read_finished([self.folder]).result_table()


@dataclass(frozen=True, repr=False)
class ServedDrive(Result):
    """A drive on the socket.

    Attributes:
        folder: drive's folder.
        figures: contents of `drive.json`.
    """

    folder: Path
    figures: dict

    @classmethod
    def read(cls, folder: Path) -> ServedDrive:
        """Return the drive of a folder.

        Raises:
            InputError: the folder has no readable `drive.json`.
        """
        return cls(folder, read_summary(folder / SUMMARY_NAME))

    def __repr__(self) -> str:
        driven_m, lost = (self.figures.get(key) or 0 for key in ("driven_m", "interventions"))
        return f"ServedDrive in {self.folder}: {driven_m:.0f} m, {counted(lost, 'intervention')}"

    def result_table(self) -> Table:
        """Return one row with all figures."""
        figures = {key: value for key, value in self.figures.items() if key in METRICS}
        return Table.of_figures([figures])


def one_line_errors(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Let a function raise the error of one line that its command prints, and take `parts=`.

    An error that is a bug in drivezoo keeps its type and its traceback. `parts` names the user's
    own modules, as on the command line: a name, or a list of names.
    """

    @wraps(function)
    def call(*args: Given.args, **kwargs: Given.kwargs) -> Returned:
        os.environ["NO_ALBUMENTATIONS_UPDATE"] = "1"
        # A notebook needs no ipywidgets: drivezoo shows no bar of tqdm's, which Lightning imports.
        warnings.filterwarnings("ignore", message="IProgress not found")
        parts: Any = kwargs.pop("parts", None) or []
        try:
            name_parts(map(str, [parts] if isinstance(parts, str | Path) else parts))
            returned: Any = function(*args, **kwargs)
            if isinstance(folder := getattr(returned, "folder", None), Path):
                # A notebook may leave the present folder.
                returned = replace(returned, folder=folder.absolute())
            written = getattr(returned, "written", [])
            written[:] = map(Path.absolute, written)
            return returned
        except Exception as error:
            # Of this call itself: an argument is missing, or the function does not take it.
            wrong = isinstance(error, TypeError) and not getattr(error.__traceback__, "tb_next", 0)
            failure = UsageError(error) if wrong else expected_failure(error)
            if failure is None:
                raise
        raise failure.with_traceback(None)

    return call


evaluate = one_line_errors(evaluate_command)
replay = one_line_errors(replay_command)
benchmark = one_line_errors(benchmark_command)
leaderboard = one_line_errors(leaderboard_command)
results = one_line_errors(results_command)


@one_line_errors
def challenge(*arguments: Any, test: str = "ch2", **keys: Any) -> Any:
    """Score a driver on a published test, as `drivezoo evaluate challenge=NAME` does.

    >>> challenge("lenet", "FOLDER")  # doctest: +SKIP

    Args:
        *arguments: driver, see `evaluate`, and the folder of the test.
        test: name of the test.
        **keys: keys of the test's command.

    Raises:
        UsageError: there is no such test, or a key or value is wrong.
        InputError: the checkpoint or the test cannot be used; or the network steered NaN.
    """
    return challenge_command(test)(*arguments, **keys)


@one_line_errors
def compare(*files: Any, **keys: Any) -> Any:
    """Compare results of the benchmark or rollouts of other programs, as `drivezoo compare` does.

    >>> compare("A/eval_info.json", "B/eval_info.json")  # doctest: +SKIP

    Args:
        *files: two files `result.json`, or files of rollouts.
        **keys: keys of the command.

    Raises:
        UsageError: a key or value is wrong.
        InputError: a file cannot be read or does not fit, or a file cannot be written.
    """
    return comparison_of(files)(*files, **keys)


@one_line_errors
def train(**keys: Any) -> Training:
    """Train a network, test it, and score it by driving, as `drivezoo train` does.

    >>> run = train(model="lenet", data={"root": "FOLDER"})  # doctest: +SKIP

    Args:
        **keys: overrides of the config; a dict has the keys after a dot. `resume=FOLDER` resumes a
            run. `parts=` names files of the user's own networks, losses, ...

    Raises:
        UsageError: a key or value is wrong, or asks for several processes or runs.
        InputError: the recording or another file cannot be used.
        StoppedError: an interrupt, such as Ctrl-C; names how to resume.
    """
    from zoo.commands.train import each_seed, is_sweep
    from zoo.commands.train import train as train_run

    arguments = [f"{key}={text}" for key, text in typed_keys(keys)]
    if is_sweep(each_seed(arguments)):
        raise UsageError("seeds=, hydra.mode=: call train for each run, or type drivezoo train -m")
    return Training.read(train_run(arguments, several=False))


@one_line_errors
def drive(driver: str | os.PathLike[str], **keys: Any) -> ServedDrive | None:
    """Serve a checkpoint to simulators until an interrupt, as `drivezoo drive` does.

    >>> drive("latest", sim="lake", laps=1, port=0)  # doctest: +SKIP

    Args:
        driver: checkpoint's path, run's folder, `latest`, or what `train` returned.
        **keys: keys of the command; `speed` takes mph, a controller's name, or its keys.

    Returns:
        The drive; None if no frame came.

    Raises:
        UsageError: a key or value is wrong.
        InputError: the checkpoint cannot be loaded, the port is taken, or the embedded simulator
            failed.
    """
    folder = drive_command(driver, **keys)
    return None if folder is None else ServedDrive.read(folder)


@one_line_errors
def drive_road(
    driver: str | Path | Training | Callable[..., Any],
    points: Sequence[Sequence[float]],
    width: float = 8.0,
    **keys: Any,
) -> DrivenRoad:
    """Drive a road through points, and return whether the driver kept its lane up to the end.

    >>> drive_road("lenet", [(0, 0), (0, 50), (20, 80)]).passed  # doctest: +SKIP
    True

    Args:
        driver: see `evaluate`.
        points: x and y in metres of points along the road's middle.
        width: width of the road in metres, 3..30.
        **keys: keys of a drive: `speed`, `margin`, `weather`, `frame_rate`, ...

    Raises:
        InputError: the road cannot be driven, or the checkpoint cannot be loaded.
        UsageError: a key or value is wrong.
    """
    from zoo.scoring.driven_road import drive_road as drive

    return drive(load_policy(driver), points, width, **keys)


@one_line_errors
def load_policy(path: str | Path | Training | Callable[..., Any]) -> Policy:
    """Return a driver's policy, a function of a frame and mph; see `zoo.policy`.

    Args:
        path: checkpoint's path, run's folder, `latest`, what `train` returned, or a function.

    Raises:
        InputError: the checkpoint cannot be loaded.
    """
    from zoo.checkpoints.checkpoint_path import find_driver
    from zoo.checkpoints.checkpoint_policy import load_policy as load

    return load(find_driver(path))


@one_line_errors
def policy(
    driver: str | Path | Training | Callable[..., Any],
    speed: float = 15.0,
    throttle: str = "hold",
    frame_rate: float = 15.0,
) -> EnvironmentPolicy:
    """Return a policy for the simulator's Gymnasium environments.

    >>> act = policy("latest")  # doctest: +SKIP
    >>> observation, reward, *rest = env.step(act(observation))  # doctest: +SKIP

    Args:
        driver: see `evaluate`.
        speed: speed to hold in mph.
        throttle: `hold` for that speed, `network` for the network's throttle.
        frame_rate: the environment's steps per second of simulated time.

    Raises:
        InputError: the checkpoint cannot be loaded, or predicts no throttle although it must.
        UsageError: a value is wrong.
    """
    from zoo.base.rig import UDACITY
    from zoo.driving.drive_loop import EnvironmentPolicy, speed_controller
    from zoo.driving.run_drives import check_throttle
    from zoo.scoring.evaluate_options import EvaluateOptions

    keys = {"speed": speed, "throttle": throttle, "frame_rate": frame_rate}
    settings = EvaluateOptions(**constructed(EvaluateOptions, keys))
    steering = load_policy(driver).in_car(UDACITY)
    check_throttle(steering, settings.throttle)
    return EnvironmentPolicy(steering, speed_controller(settings), settings.frame_rate)


@one_line_errors
def expert(env: gymnasium.Env, speed: float = 15.0) -> Callable[..., np.ndarray]:
    """Return the driver that knows the road, for one of the simulator's Gymnasium environments.

    It is called as a policy is, once a step, but looks at the environment instead of the
    observation; its action is float32 [2].

    >>> act = expert(env)  # doctest: +SKIP
    >>> observation, reward, *rest = env.step(act(observation))  # doctest: +SKIP

    Args:
        env: environment, wrapped or not.
        speed: speed on straights in mph; it is slower in bends.

    Raises:
        UsageError: the environment is not the simulator's, or the speed is not allowed.
    """
    import numpy as np

    from zoo.simulator.env import DrivingEnv
    from zoo.simulator.expert import Expert, ExpertSettings

    inner, settings = getattr(env, "unwrapped", env), ExpertSettings(speed)
    if not isinstance(inner, DrivingEnv):
        raise UsageError(f"env: is {type(inner).__name__}; name one of ours, as drivezoo/Lake-v0")
    driver = Expert(inner.world.track, settings)

    def act(observation: Any = None) -> np.ndarray:
        nonlocal driver
        if inner.world.time == 0 or driver.track is not inner.world.track:  # a new episode or road
            driver = Expert(inner.world.track, settings)
        return np.array(driver(inner.world), np.float32)

    return act


@one_line_errors
def read_run(folder: str | Path) -> Training:
    """Return what `train` returned for a run's folder.

    Raises:
        InputError: the folder has no figures of a finished run.
    """
    return Training.read(convert("folder", str, folder))


@one_line_errors
def read_benchmark(path: str | Path) -> Benchmarked:
    """Return what `benchmark` returned for a folder or its `result.json`.

    Raises:
        InputError: the file cannot be read.
    """
    from zoo.results.benchmarked import Benchmarked

    return Benchmarked.read(convert("path", str, path))


@one_line_errors
def write_table(rows: Any, path: str | Path, overwrite: bool = False) -> Path:
    """Write rows of figures as a .csv, .tex, .parquet, .md or .html file; return its path.

    Args:
        rows: mappings, figures by the name of their column, or a DataFrame; such as the `table()`
            or `to_pandas()` of a result. A named index, or one of texts, gives columns, too.
        path: file to write.
        overwrite: whether an existing file is replaced.

    Raises:
        InputError: the file's name has another ending, or it exists or cannot be written.
    """
    with library_errors("rows", "have no figures by name", "give mappings, such as a table()"):
        rows = rows.to_dicts() if hasattr(rows, "to_dicts") else rows  # of polars
        if hasattr(rows, "notna"):  # a DataFrame of pandas has NaN where there is no figure
            rows = rows.reset_index(drop=rows.index.dtype.kind == "i" and not any(rows.index.names))
            rows = rows.astype(object).where(rows.notna(), None).to_dict("records")
        table = Table.of_figures(rows)
    with overwriting(convert("overwrite", bool, overwrite)):
        return write_result_table(table, path)
