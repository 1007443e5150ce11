"""Try drivezoo with each Python from 3.10 to 3.13 that this machine has: `make matrix`.

    python .ci/matrix.py [VERSION ...] [tests=false | tests="-n 1 -k doctor"]

Each Python gets an environment in `.matrix/VERSION`, with the versions of constraints.txt. It
imports every module, runs the doctor, records, trains, evaluates, drives and runs the fast tests.
What each step prints is in `.matrix/VERSION/STEP.log`. The exit status is 1 if a step failed, or
if no such Python was found.
"""

import os
import shlex
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VERSIONS = ("3.10", "3.11", "3.12", "3.13")
ASK = "import sys; print('%d.%d' % sys.version_info[:2], sys.executable)"
IMPORT_ALL = """
import importlib, pkgutil
names = ["datamodules", "drivezoo", "hydra_plugins.drivezoo", "zoo"]
for name in names:
    if name == "zoo.extras.hub.lerobot.lerobot_env":  # only LeRobot imports it
        continue
    module = importlib.import_module(name)
    inside = pkgutil.iter_modules(getattr(module, "__path__", []))
    names += [f"{name}.{part.name}" for part in inside]
print(len(names), "modules")
"""
SHORT = "model=tiny trainer.max_epochs=1 score.laps=0.05 hydra.run.dir=run"
DRIVE = "run sim=lake laps=0.05 port=0"


def main(arguments: list[str]) -> int:
    """Run every step with every interpreter, then print the table; return the exit status."""
    tests = next((word[len("tests=") :] for word in arguments if word.startswith("tests=")), "-n 2")
    versions = [word for word in arguments if not word.startswith("tests=")] or VERSIONS
    found = {version: find(version) for version in versions}
    rows = {version: try_python(version, path, tests) for version, path in found.items() if path}
    print()
    for version in versions:
        print(version, *rows.get(version, ["not found"]), sep="  ")
    failed = any(cell.endswith("FAILED") for row in rows.values() for cell in row)
    return int(failed or not rows)


def find(version: str) -> str | None:
    """Return the path of an interpreter; None if this machine has none of that version."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
    installed = [[str(path)] for path in sorted(pyenv.glob(f"{version}.*/bin/python"))]
    for words in ([sys.executable], [f"python{version}"], ["py", f"-{version}"], *installed):
        with suppress(OSError):
            done = subprocess.run([*words, "-c", ASK], capture_output=True, text=True, check=False)
            if done.stdout.startswith(f"{version} "):
                return done.stdout.strip().partition(" ")[2]
    return None


def try_python(version: str, interpreter: str, tests: str) -> list[str]:
    """Return each step with its seconds, or FAILED."""
    home = ROOT / ".matrix" / version
    scripts = home / ("Scripts" if os.name == "nt" else "bin")
    python, drivezoo = str(scripts / "python"), str(scripts / "drivezoo")
    ready = home / "ready"
    pinned = [ROOT / "pyproject.toml", ROOT / "constraints.txt"]
    steps = {
        "venv": [interpreter, "-m", "venv", str(home)],
        "install": [python, "-m", "pip", "install", "-c", "constraints.txt", "-e", ".[dev]"],
        "imports": [python, "-c", IMPORT_ALL],
        "doctor": [drivezoo, "doctor"],
        "record": [drivezoo, "simulator", "record", "out=lake", "laps=0.3", "quality=simple"],
        "train": [python, "-m", "zoo", *SHORT.split(), "data.root=lake"],
        "evaluate": [drivezoo, "evaluate", "run", "laps=0.05", "out=score"],
        "drive": [drivezoo, "drive", *DRIVE.split()],
        "tests": [python, "-m", "pytest", "-m", "not slow", "--dist=loadfile", *shlex.split(tests)],
    }
    if ready.exists() and all(ready.stat().st_mtime > path.stat().st_mtime for path in pinned):
        del steps["venv"], steps["install"]
    if tests == "false":
        del steps["tests"]
    place = home / "tried" / time.strftime("%Y-%m-%d_%H-%M-%S")
    place.mkdir(parents=True)
    row = []
    for name, words in steps.items():
        log, began = home / f"{name}.log", time.monotonic()
        print(f"{version}: {name} ...", end=" ", flush=True)
        with log.open("wb") as output:
            status = subprocess.run(
                words,
                cwd=ROOT if name in ("venv", "install", "tests") else place,
                env={key: value for key, value in os.environ.items() if key != "PYTHONPATH"},
                stdout=output,
                stderr=subprocess.STDOUT,
                check=False,
            ).returncode
        if status:
            print(f"failed with exit status {status}; {log} ends:")
            print(*log.read_text(errors="replace").splitlines()[-15:], sep="\n")
            row.append(f"{name} FAILED")
            if name in ("venv", "install"):
                break
            continue
        row.append(f"{name} {time.monotonic() - began:.0f} s")
        print(row[-1].partition(" ")[2], flush=True)
        if name == "install":
            ready.touch()
    return row


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
