"""`drivezoo report`: write a run's report as a page and as Markdown."""

from zoo.base.command import command
from zoo.base.console_progress import loading
from zoo.base.terminal import print_written
from zoo.checkpoints.checkpoint_path import find_run
from zoo.runs.run_record import Run


@command
def report(run_folder: str) -> None:
    """Write the report of a run or an evaluation as a page and as Markdown.

    RUN_FOLDER/report/index.html contains its images and film and loads nothing else;
    RUN_FOLDER/report/report.md uses image files in the same folder.

    Args:
        run_folder: folder of a run or of an evaluation, or latest: the newest run below outputs.
    """
    run = find_run(run_folder)
    if not run.exists():  # reported before torch is imported
        Run.open(run)
    with loading("writing the report"):
        from zoo.scoring.write_up import MARKDOWN, write_report

        page = write_report(run)
    print_written([page, page.with_name(MARKDOWN)], ["leaderboard"])


if __name__ == "__main__":
    report.run()
