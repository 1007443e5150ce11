"""Run a study of the manual: `python benchmarks/study.py NAME [only=lenet] [seeds=3] [runs=false]`.

A study is a grid of trainings and drives in `benchmarks/studies/NAME.yaml`. The command trains and
drives what is missing, and then writes the study's CSV file and its tables; `runs=false` writes
tables alone. Runs are kept, so that an interrupted command resumes, and a failed entry does not
stop the others. Without a name it lists the studies.
"""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.board_rows import add_submission, rows_of_board
from benchmarks.measuring import merge, read_csv, write_csv
from benchmarks.study_grid import Entry, Study, write_files
from benchmarks.study_tables import packaged, write_tables
from zoo.base.errors import InputError
from zoo.runs.code_fingerprint import changed_files, code_fingerprint
from zoo.runs.metrics_file import read_metrics_file

CODE = "code"  # column of a row's code, by its hash
ROOT = Path(__file__).resolve().parents[1]


def refuse_unclean(study: Study) -> None:
    """Refuse to measure figures in a checkout whose files differ from its commit.

    Raises:
        InputError: a file differs.
    """
    if not study.options.drive or study.options.quick:
        return
    if changed := changed_files(ROOT):
        raise InputError(
            f"{changed[0]}: differs from the commit, so that nobody could repeat the figures; "
            "commit it first, train alone with drive=false, or try with quick=true"
        )


def check_code(entry: Entry, quick: bool = False) -> None:
    """Check that an entry's runs were trained by the code that drives them, and from a commit.

    Raises:
        InputError: a run was trained by other code, or, unless `quick`, beside changed files.
    """
    for run in entry.finished:
        trained = {} if entry.corrects else read_metrics_file(run).get("code") or {}
        if (changed := trained.get("changed")) and not quick:
            raise InputError(
                f"{run}: was trained while {changed[0]} differed from the commit; commit all "
                "files, and remove the folder to train it again"
            )
        if (code := trained.get("hash")) not in (None, code_fingerprint()["hash"]):
            raise InputError(
                f"{run}: was trained by other code ({code}, here {code_fingerprint()['hash']}); "
                "remove the folder to train it again"
            )


def add_rows(study: Study, rows: list[dict]) -> None:
    """Add rows to the study's CSV file, in place of older ones of the same key."""
    if rows and "csv" in study.config:
        path, code = Path(study.config["csv"]), {CODE: str(code_fingerprint()["hash"])}
        columns = {name: study.config.get(name, ()) for name in ("key", "sort")}
        before = [{CODE: "", **row} for row in read_csv(path)]
        write_csv(path, merge(before, [row | code for row in rows], **columns))


def measure_entry(study: Study, entry: Entry) -> list[dict]:
    """Train what is missing of an entry, drive it and return its rows.

    Raises:
        InputError: a training or a drive failed.
    """
    from benchmarks.study_rows import ROWS

    with ThreadPoolExecutor(study.options.jobs) as pool:
        list(pool.map(lambda run: study.train(entry, run), entry.runs))
    if not study.options.drive:
        return []
    check_code(entry, study.options.quick)
    return ROWS[study.config["rows"]](study, entry)


def make_runs(study: Study) -> None:
    """Train and drive what is missing, and write what was measured.

    Committed files are written at the end: the first entry's would make the commit of the next ones
    unclean, so that nobody could repeat them. Rows of short trainings are printed instead, unless
    the study's key keeps them apart from those of whole ones.

    Raises:
        InputError: `only` names no entry, a recording was changed, or an entry failed.
    """
    from benchmarks.study_data import PREPARE

    refuse_unclean(study)
    chosen, failed, rows = study.chosen(), [], []
    if "prepare" in study.config:
        study.values |= PREPARE[study.config["prepare"]](study)
    for entry in chosen:
        try:
            rows += measure_entry(study, entry)
        except InputError as error:
            print(error, file=sys.stderr, flush=True)
            failed.append(entry.name)
    if failed:
        raise InputError(
            f"failed: {', '.join(failed)}; the same command resumes, and then writes all results; "
            "only= names others"
        )
    if study.options.quick and "training" not in study.config.get("key", ()):
        for row in rows:
            print(row)
        return
    add_rows(study, rows)
    write_files(study.files)


def write_results(study: Study) -> list[Path]:
    """Write the study's pages from its rows, and return the files.

    Raises:
        InputError: the rows were measured by several versions of the code.
    """
    config = study.config
    if config["rows"] == "board":  # of the committed results alone
        write_csv(Path(config["csv"]), rows_of_board())
    rows = read_csv(Path(config["csv"])) if "csv" in config else packaged()
    is_table = "csv" in config and config["rows"] != "board"
    codes = {row[CODE] for row in rows if is_table and row.get(CODE)}  # older rows lack theirs
    if len(codes) > 1:
        raise InputError(
            f"{config['csv']}: its rows were measured by {len(codes)} versions of the code "
            f"({', '.join(sorted(codes))}); measure all entries by one"
        )
    pages = write_tables(config["tables"], rows)
    return [*map(Path, [config["csv"]] if "csv" in config else []), *pages]


def main(arguments: list[str]) -> None:
    """Make the runs, then write the pages.

    Raises:
        InputError: an option is wrong, or an entry failed or could not be verified.
    """
    name, *options = arguments or ["no name given"]
    study = Study(name, options)
    if study.values.get("add"):
        add_submission(Path(study.values["add"]))
    elif study.options.runs and "grids" in study.config:
        make_runs(study)
    if study.options.drive:
        print(", ".join(map(str, write_results(study))))


if __name__ == "__main__":
    from zoo.base.run_command import run_command

    sys.exit(run_command("study", main, sys.argv[1:]))
