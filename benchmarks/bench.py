"""Run all benchmarks: `python benchmarks/bench.py [ONLY=feed,start] [short] [docs]`.

Every part (a file here with a function `measure`) runs in its own process. The results are ratios,
printed as one table and written to `outputs/bench.json`. `short` only checks that the parts run;
its figures mean nothing. `docs` also writes the table between the two markers of
`docs/performance.md`.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import asdict
from importlib import import_module
from pathlib import Path

import psutil
from rich.console import Console

from benchmarks import measuring
from zoo.base.child_process import child_environment
from zoo.base.machine import processor_name, usable_cores
from zoo.runs.code_fingerprint import package_versions

HERE = Path(__file__).parent
OUT = Path("outputs/bench.json")
PAGE = Path("docs/performance.md")
DOCS = "docs"
MEASURE = "measure"  # first word of a part's process
FIRST = ("feed", "training", "tiny", "start", "cache")  # parts about training
LONGEST_S = 600  # of a part, on a slow machine


def run_part(name: str, short: bool, console: Console) -> list[measuring.Row]:
    """Return a part's rows; if it fails, print its output and return none."""
    console.print(f"{name} ...", highlight=False)
    with tempfile.TemporaryDirectory() as folder:
        out, log = Path(folder) / "rows.json", Path(folder) / "log.txt"
        command = [sys.executable, __file__, MEASURE, name, str(out), *["short"] * short]
        with log.open("w") as output:
            environment = child_environment()
            process = subprocess.Popen(command, env=environment, stdout=output, stderr=output)
            try:
                process.wait(LONGEST_S)
            except subprocess.TimeoutExpired:
                end_children()
        if process.poll() or not out.is_file():
            failure = f"{name}: failed, or took more than {LONGEST_S} s"
            console.print(log.read_text()[-2000:], failure, markup=False, highlight=False)
            return []
        return [measuring.Row(**row) for row in json.loads(out.read_text())]


def measure_part(name: str, out: str, *short: str) -> None:
    """Measure a part in this process, and write its rows to a file."""
    rows = import_module(f"benchmarks.{name}").measure(bool(short))
    Path(out).write_text(json.dumps([asdict(row) for row in rows]))


def end_children() -> None:
    """End the running part, and the processes that it started."""
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.NoSuchProcess):
            child.kill()


def end(number: int, _: object) -> None:
    """End with the running part, also while it starts."""
    end_children()
    sys.exit(128 + number)


def machine() -> dict:
    """Return the facts about the machine that the figures depend on."""
    return {
        "processor": processor_name(),
        "cores": usable_cores(),
        "threads": os.environ.get("OMP_NUM_THREADS", "not set"),
        "load_before": os.getloadavg(),
        "versions": package_versions(),
    }


def main(arguments: list[str]) -> int:
    """Print the table; return 1 if a part failed."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    console, short, chosen = measuring.make_console(), "short" in arguments, []
    names = sorted(path.stem for path in HERE.glob("*.py") if "\ndef measure(" in path.read_text())
    names = [*FIRST, *(name for name in names if name not in FIRST)]
    for word in arguments:
        if word.startswith("ONLY="):
            chosen += filter(None, word.removeprefix("ONLY=").split(","))
        elif word not in {"short", DOCS}:
            console.print(f"bench: {word}: must be ONLY=PART,PART, short or docs")
            return 1
    if unknown := [name for name in chosen if name not in names]:
        console.print(f"bench: {unknown[0]}: no such part; available: {', '.join(names)}")
        return 1
    chosen = chosen or names
    began, contents, rows, took, failed = time.perf_counter(), machine(), [], {}, False
    for name in chosen:
        before = time.perf_counter()
        of_part = run_part(name, short, console)
        rows, failed = [*rows, *of_part], failed or not of_part
        took[name] = round(time.perf_counter() - before, 1)
    seconds = time.perf_counter() - began
    measuring.print_rows(rows)
    facts = (
        f"{contents['processor']}, {contents['cores']} cores, load {contents['load_before'][0]:.1f}"
        f" before the start; torch {contents['versions']['torch']}; {seconds:.0f} s"
    )
    console.print(f"{facts}; {OUT}", highlight=False)
    contents |= {"short": short, "seconds": seconds, "parts_s": took}
    contents["rows"] = [asdict(row) | {"met": row.met} for row in rows]
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_text(json.dumps(contents, indent=1) + "\n")
    if DOCS in arguments:
        lines = [[row.what, *row.cells()] for row in rows]
        table = measuring.markdown_table(["what", *measuring.COLUMNS], lines, left=2)
        measuring.write_between(PAGE, "bench", f"{table}\n\n{facts}.")
    return int(failed)


if __name__ == "__main__":
    if sys.argv[1:2] == [MEASURE]:
        sys.exit(measure_part(*sys.argv[2:]))
    sys.exit(main(sys.argv[1:]))
