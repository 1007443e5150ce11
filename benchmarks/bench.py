"""Run all benchmarks: `python benchmarks/bench.py [ONLY=feed,start] [short] [docs]`.

Every part (a file here with a function `measure`) runs in its own process. The results are ratios,
printed as one table and written to `outputs/bench.json`. `short` only checks that the parts run;
its figures mean nothing. `docs` (or `readme`, its old name) also writes the table between the two
markers of `docs/performance.md`. Without `KERAS_PYTHON` the part that needs Keras is skipped.
"""

import json
import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from rich.console import Console

from benchmarks.measuring import make_console, markdown_table, write_between
from benchmarks.timing import COLUMNS, Row, print_rows
from zoo.base.child_process import child_environment
from zoo.base.cores import usable_cores

HERE = Path(__file__).parent
OUT = Path("outputs/bench.json")
PAGE = Path("docs/performance.md")
PAGE_WORDS = {"docs", "readme"}
LONGEST_S = 240  # of a part
PACKAGES = ("torch", "lightning", "albumentations", "opencv-python-headless", "numpy")


def part_names() -> list[str]:
    """Return the names of all parts, those about training first."""
    names = sorted(path.stem for path in HERE.glob("*.py") if "\ndef measure(" in path.read_text())
    first = ("feed", "training", "tiny", "start", "cache", "growth")
    return [name for name in first if name in names] + [word for word in names if word not in first]


def usual_parts(console: Console) -> list[str]:
    """Return the parts to run by default; print which part is skipped."""
    names = part_names()
    if not os.environ.get("KERAS_PYTHON"):
        names.remove("keras_training")
        console.print("keras_training: skipped; set KERAS_PYTHON to a Python with Keras")
    return names


def run_one(name: str, short: bool, console: Console) -> list[Row]:
    """Return a part's rows; if it fails, print its output and return none."""
    console.print(f"{name} ...", highlight=False)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "rows.json"
        command = [sys.executable, str(HERE / f"{name}.py"), f"out={out}"]
        log = Path(folder) / "log.txt"
        with log.open("w") as output:
            process = subprocess.Popen(
                command + ["short"] * short,
                env=child_environment(),
                stdout=output,
                stderr=output,
                start_new_session=True,
            )
            try:
                process.wait(LONGEST_S)
            except BaseException as error:
                os.killpg(process.pid, signal.SIGKILL)  # with the processes that it started
                if not isinstance(error, subprocess.TimeoutExpired):
                    raise
        if process.poll() or not out.is_file():
            failure = f"{name}: failed, or took more than {LONGEST_S} s"
            console.print(log.read_text()[-2000:], failure, markup=False, highlight=False)
            return []
        return [Row.read(row) for row in json.loads(out.read_text())]


def machine() -> dict:
    """Return the facts about the machine that the figures depend on."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(line.split(": ")[1] for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    return {
        "processor": model,
        "cores": usable_cores(),
        "threads": os.environ.get("OMP_NUM_THREADS", "not set"),
        "load_before": os.getloadavg(),
        "python": platform.python_version(),
        "versions": {package: version(package) for package in PACKAGES},
    }


def main(arguments: list[str]) -> int:
    """Print the table; return 1 if a part failed."""
    # SIGTERM ends the running part, too, as Ctrl-C does.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    console = make_console()
    for word in arguments:
        if word not in {"short", *PAGE_WORDS} and not word.startswith("ONLY="):
            console.print(f"bench: {word}: must be ONLY=PART,PART, short or docs")
            return 1
    names = part_names()
    wanted = [word.removeprefix("ONLY=") for word in arguments if word.startswith("ONLY=")]
    chosen = [name for word in wanted for name in word.split(",") if name] or usual_parts(console)
    for name in chosen:
        if name not in names:
            console.print(f"bench: {name}: no such part; available: {', '.join(names)}")
            return 1
    began, known, rows, failed = time.perf_counter(), machine(), [], []
    took = {}
    for name in chosen:
        before = time.perf_counter()
        of_part = run_one(name, "short" in arguments, console)
        took[name] = round(time.perf_counter() - before, 1)
        failed += [] if of_part else [name]
        rows += of_part
    seconds = time.perf_counter() - began
    print_rows(rows)
    facts = (
        f"{known['processor']}, {known['cores']} cores, load {known['load_before'][0]:.1f} before "
        f"the start; torch {known['versions']['torch']}; {seconds:.0f} s"
    )
    console.print(f"{facts}; {OUT}", highlight=False)
    console.print(", ".join(f"{name} {taken:.0f} s" for name, taken in took.items()))
    contents = known | {"short": "short" in arguments, "seconds": seconds, "parts_s": took}
    contents["rows"] = [asdict(row) | {"met": row.met} for row in rows]
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_text(json.dumps(contents, indent=1) + "\n")
    if PAGE_WORDS & set(arguments):
        lines = [[row.what, *row.cells()] for row in rows]
        table = markdown_table(["what", *COLUMNS], lines, left=2)
        write_between(PAGE, "bench", f"{table}\n\n{facts}.")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
