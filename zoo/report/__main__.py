"""`python -m zoo.report RUN`: the write-up of a run, one page and one Markdown file.

`RUN/report/index.html` holds its pictures and its film, and fetches nothing; `RUN/report/report.md`
has its pictures beside it.
"""

import sys

from datamodules.errors import UsageError
from datamodules.terminal import printable
from zoo.checkpoints.checkpoint_path import find_run
from zoo.cli.console_progress import loading
from zoo.cli.run_command import run_command
from zoo.report.write_up import FOLDER, MARKDOWN, PAGE, write_report

USAGE = "python -m zoo.report RUN_FOLDER"


def report(arguments: list[str]) -> None:
    """The command: a run's folder."""
    if {"-h", "--help"} & set(arguments):
        print(f"usage: {USAGE}\n\nWrites RUN_FOLDER/{FOLDER}/{PAGE} and {MARKDOWN}.")
        print("RUN_FOLDER may be latest: the newest run below outputs.")
        return
    if len(arguments) != 1:
        raise UsageError(f"usage: {USAGE}")
    run = find_run(arguments[0])
    with loading("writing the report"):
        page = write_report(run)
    for path in (page, page.with_name(MARKDOWN)):
        print(printable(str(path)))


if __name__ == "__main__":
    sys.exit(run_command("zoo.report", report, sys.argv[1:]))
