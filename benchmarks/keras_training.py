"""Compare training with Keras: `KERAS_PYTHON=... make bench ONLY=keras_training`.

The reference is a well-known solution of the course (`keras_solution.py`), with its own settings
and TensorFlow's defaults. It runs in the interpreter that `KERAS_PYTHON` names, such as
`venv/bin/python`, because TensorFlow is too large to install for this alone. `make bench` skips
this part if `KERAS_PYTHON` is not set.
"""

import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from benchmarks.material import OUT, linked_recording
from benchmarks.measuring import Row, compared, contestants, ratios, take_turns

ROWS = 2_000
BARE, SHARE = "bare loop/s", 0.95
INSTALL = (
    "set KERAS_PYTHON to a Python with Keras, such as that of a virtual environment after "
    "`pip install tensorflow-cpu opencv-python-headless`"
)


def measure(short: bool) -> list[Row]:
    """Measure `drivezoo train`'s samples per second relative to Keras, also in bf16.

    The aim is 0.95 of what a bare loop on tensors in memory reaches in the same run.
    """
    batches, steps, rounds = (2, 2, 1) if short else (24, 30, 5)
    python = os.environ.get("KERAS_PYTHON")
    if not python:
        raise SystemExit(f"keras_training: {INSTALL}")
    from benchmarks.training import BATCH, ROUND_S, run_bare, zoo_targets  # a slow import

    targets = zoo_targets(batches)
    log = linked_recording(ROWS) / "driving_log.csv"
    with ExitStack() as stack:
        theirs, solution = stack.enter_context(keras_process(python, log, steps))
        bare = {BARE: (run_bare, 0.1 if short else ROUND_S, True)}
        ours = stack.enter_context(contestants(targets | bare, asleep=targets))
        rates = take_turns({**ours, "Keras/s": theirs}, rounds)
    reference = f"{solution}, its own generator, batch 40"
    what = f"training nvidia, batch {BATCH}, augmented"
    names = {target: what + target.removeprefix("zoo").removesuffix("/s") for target in targets}
    # What the bare loop allows, in the same 32 bits.
    aim = SHARE * ratios(rates[BARE], rates["Keras/s"])[1]
    return [
        compared(rates, name, reference, (target, "Keras/s"), aim) for target, name in names.items()
    ]


@contextmanager
def keras_process(python: str, log: Path, steps: int) -> Iterator[tuple[Callable[[], float], str]]:
    """Start the Keras process; yield a function that measures in it, and its name.

    Its threads use TensorFlow's wait policy.

    Raises:
        SystemExit: the process cannot start or has no Keras; the message names the remedy.
    """
    program = Path(__file__).with_name("keras_solution.py")
    kept = {k: v for k, v in os.environ.items() if k not in ("OMP_WAIT_POLICY", "PYTHONPATH")}
    OUT.mkdir(parents=True, exist_ok=True)
    log_file = OUT / "keras.txt"
    with log_file.open("w") as errors:
        try:
            process = subprocess.Popen(
                [python, str(program), str(log), str(steps)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                env=kept | {"TF_CPP_MIN_LOG_LEVEL": "3"},
                text=True,
            )
        except OSError as error:
            raise SystemExit(f"keras_training: {python}: {error.strerror}; {INSTALL}") from None
    try:
        ready = process.stdout.readline()
        if not ready.startswith("ready: "):
            last = log_file.read_text().strip().splitlines()[-1:] or ["no output"]
            raise SystemExit(f"keras_training: {python}: {last[0]}; {INSTALL}")
        yield lambda: _ask(process), ready.removeprefix("ready: ").strip()
    finally:
        process.kill()
        process.wait()


def _ask(process: subprocess.Popen) -> float:
    process.stdin.write("\n")
    process.stdin.flush()
    return float(process.stdout.readline())
