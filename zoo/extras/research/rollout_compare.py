"""`drivezoo compare` for results of other programs: which of some policies is better."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from zoo.base.command import command
from zoo.base.output_files import check_output
from zoo.results.result import is_result
from zoo.runs.table_files import ResultFiles

if TYPE_CHECKING:
    from zoo.extras.research.referee import Referee


def detect(files: Sequence[str | Path]) -> bool:
    """Return whether a file or folder can hold rollouts of another program."""
    from zoo.extras.research.rollouts import rollouts_path

    named = [Path(file).expanduser() for file in files if isinstance(file, str | Path)]
    return any(path.is_file() and not is_result(path) for path in map(rollouts_path, named))


@command(outputs=True)
def compare(
    file: str | Path,
    *files: str | Path,
    names: str | None = None,
    policy: str | None = None,
    scene: str | None = None,
    seed: str | None = None,
    training: str | None = None,
    score: str | None = None,
    same_seeds: bool = False,
    paired: bool = False,
    out: str = "compare.json",
    write: ResultFiles,
) -> "Referee":
    """Compare policies by their rollouts in any program.

    Reads LeRobot's eval_info.json, Bench2Drive's merged.json, and CSV files with a row for each
    rollout. Prints which policies are told apart, on the same scenes and on new ones, and how many
    rollouts, scenes or trainings would be needed to tell.

      drivezoo compare A/eval_info.json B/eval_info.json
      drivezoo compare rollouts.csv policy=policy

    Args:
        file: file of rollouts, or the folder that LeRobot or Bench2Drive wrote it in.
        *files: further ones; a file without a column of policies is one policy.
        names: name of the policy of each file, such as a,b; files of one name are its trainings.
        policy: CSV column of the policy; null: policy.
        scene: CSV column of the scene; null: scene, task, route, track or env.
        seed: CSV column of the rollout's seed; null: seed.
        training: CSV column of the training seed; null: training_seed, train_seed or training.
        score: score to compare, or its CSV column; null: success, in a CSV file also score.
        same_seeds: true: rollouts without a seed are pairs, in their order in each scene.
        paired: whether trainings of the same seed are pairs.
        out: JSON file to write.
        write: see `ResultFiles`.

    Raises:
        InputError: a file cannot be read or written, or holds one policy alone.
        UsageError: there is no such column or score, or the names do not fit.
    """
    path, paths = Path(out).expanduser(), [Path(each).expanduser() for each in (file, *files)]
    from zoo.extras.research.rollouts import Wanted, rollouts_path

    read = list(map(rollouts_path, paths))  # a folder may have other files, such as compare.json
    check_output(path, inputs=read)
    from zoo.extras.research.referee import COLUMNS, Referee  # slow imports: SciPy, Matplotlib

    write.check_files(COLUMNS, read)
    typed = {"policy": policy, "scene": scene, "seed": seed, "training": training}
    wanted = Wanted(score or "", {key: name for key, name in typed.items() if name is not None})
    named = [name.strip() for name in names.split(",")] if names else ()
    result = Referee.read(paths, named, wanted, same_seeds, paired)
    result.written.extend([result.write(path), *write.write_files(result)])
    return result
