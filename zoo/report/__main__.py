"""`drivezoo report RUN_FOLDER`: write a run's report as a page and as Markdown.

RUN_FOLDER/report/index.html contains its images and film and loads nothing else;
RUN_FOLDER/report/report.md uses image files in the same folder.
"""

import sys

from zoo.checkpoints.checkpoint_path import find_run
from zoo.cli.closing_lines import print_written
from zoo.cli.command import Command
from zoo.cli.console_progress import loading
from zoo.cli.run_command import run_command
from zoo.report.write_up import MARKDOWN, write_report

COMMAND = Command(__doc__, {"RUN_FOLDER": "run's folder, or latest: the newest below outputs"})


def report(arguments: list[str]) -> None:
    """Read the arguments and write the report."""
    (folder,), _ = COMMAND.split(arguments)
    run = find_run(folder)
    with loading("writing the report"):
        page = write_report(run)
    print_written([page, page.with_name(MARKDOWN)], ["leaderboard"])


if __name__ == "__main__":
    sys.exit(run_command("zoo.report", report, sys.argv[1:]))
