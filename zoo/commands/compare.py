"""`drivezoo compare`: compare two results of the benchmark."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zoo.base.command import Command, Comparison, command, is_help, is_path
from zoo.base.entry_points import installed_entries, usable
from zoo.base.output_files import check_output
from zoo.base.run_command import exit_after
from zoo.runs.table_files import ResultFiles

if TYPE_CHECKING:
    from zoo.results.comparison import ComparedEntries


@command(outputs=True)
def compare(
    a: str | Path,
    b: str | Path,
    *,
    paired: bool = False,
    out: str = "compare.json",
    files: ResultFiles,
) -> "ComparedEntries":
    """Compare two results of the benchmark.

    Pairs the drives of both on the same roads. Prints which one drives better, with intervals over
    roads and training seeds, and how many training seeds would be needed to tell.

    For rollouts of other programs see below.

    Args:
        a: result.json of a benchmark, or its folder.
        b: the other result.json, or its folder.
        paired: whether trainings of the same seed are pairs, as of two settings of one network.
        out: JSON file to write.
        files: see `ResultFiles`.

    Raises:
        InputError: a result cannot be read, the results are of different roads or, paired, share no
            training seed, or a file cannot be written.
    """
    from zoo.results.result import result_path

    path = Path(out).expanduser()
    check_output(path, inputs=[result_path(Path(each).expanduser()) for each in (a, b)])
    from zoo.results.comparison import COLUMNS, ComparedEntries  # slow imports: SciPy, Matplotlib

    files.check_files(COLUMNS)
    result = ComparedEntries.read(a, b, paired)
    result.written.extend([result.write(path), *files.write_files(result)])
    return result


def comparison_of(files: Sequence[str | Path]) -> Command[Any]:
    """Return the command that compares some files: that of an installed package which reads them.

    No package is asked about results of the benchmark. An entry point of `drivezoo.comparisons`
    names a module with `detect`, which looks at the files, and `compare`, the command.
    """
    from zoo.results.result import is_result

    paths = [Path(file).expanduser() for file in files if isinstance(file, str | Path)]
    others = [] if all(map(is_result, paths)) else _others()
    return next((other.compare for other in others if other.detect(files)), compare)


def compare_files(arguments: list[str]) -> None:
    """Compare two results of the benchmark, or files of other programs."""
    if not is_help(arguments):
        comparison_of([*filter(is_path, arguments)]).main(arguments)
        return
    for number, documented in enumerate([compare, *(other.compare for other in _others())]):
        print("\n" * bool(number), end="")
        documented.main(["--help"])


def _others() -> list[Comparison]:
    return [each for _, each in usable(installed_entries("drivezoo.comparisons"), Comparison)]


if __name__ == "__main__":
    exit_after("drivezoo compare", compare_files)
