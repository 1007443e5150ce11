"""`drivezoo grade`: mark the networks of a class."""

from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from zoo.base.command import command
from zoo.base.console_progress import loading
from zoo.extras.teaching.grade_options import GradeOptions
from zoo.extras.teaching.submissions import find_submissions

if TYPE_CHECKING:
    from zoo.extras.teaching.graded import Graded

# Slow imports (torch, Panda3D) come late: --help and typos answer at once.


@command(outputs=True)
def grade(folder: str, *, options: GradeOptions) -> "Graded":
    """Mark the networks of a class.

    Drives each .ckpt or .onnx file in FOLDER, or in a folder of a student there, on the roads of a
    course. Nothing of a submission is run but its network, in a process of its own. Writes
    grades.html and grades.csv for the teacher, and a page for each student. With the `out=` of an
    interrupted command it resumes; a new or changed file is driven, the others are kept.

    Args:
        folder: folder of the submissions.
        options: see `GradeOptions`.

    Raises:
        UsageError: a key or value is wrong.
        InputError: there is no submission, or the suite has no marks.
    """
    out = Path(options.out).expanduser() if options.out else None
    submissions = find_submissions(Path(folder).expanduser(), out)
    with loading():
        from zoo.extras.teaching.graded import grade_class
    return grade_class(submissions, options, Console(emoji=False))


if __name__ == "__main__":
    grade.run()
