"""Compare converted networks with Keras: `KERAS_PYTHON=... python benchmarks/keras_parity.py`.

The Python that `KERAS_PYTHON` names needs Keras 3 or, for Keras 2, `tf-keras`: for example that of
a virtual environment after `pip install tensorflow-cpu tf-keras`. It builds models over all layers
(`keras_models.py`; arguments are the names of some), each saved as `.h5`, as `.json` with weights,
and as `.keras`. Every file is converted here, and its output on random and rendered frames is
compared with Keras' own. The largest difference that is allowed is 0.00001, relative to outputs
above 1.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
import torch
from keras_training import INSTALL
from material import pictures
from rich.console import Console
from rich.table import Table

from zoo.base.errors import InputError
from zoo.checkpoints.keras_file import read_keras
from zoo.checkpoints.keras_layers import convert
from zoo.models.sequential import Sequential

SIZES = ((34, 46), (66, 200), (160, 320))
MOST = 1e-5
ENDINGS = {".h5": "{}.h5", ".json": "{}_json.json", ".keras": "{}.keras"}
OUTPUTS = {"two_outputs": ["steering", "throttle"]}


def write_frames(path: Path) -> dict[str, np.ndarray]:
    """Write and return three random and three real frames of each size, uint8 [6, H, W, 3]."""
    rng = np.random.default_rng(0)
    real = [cv2.imread(str(one)) for one in pictures()["center"][:60:20]]
    frames = {}
    for rows, columns in SIZES:
        small = [cv2.resize(one, (columns, rows), interpolation=cv2.INTER_AREA) for one in real]
        random = rng.integers(0, 256, (3, rows, columns, 3), dtype=np.uint8)
        frames[f"{rows}x{columns}"] = np.concatenate([random, np.stack(small)])
    np.savez(path, **frames)
    return frames


def difference(path: Path, frames: dict[str, np.ndarray], expected: np.ndarray, name: str) -> float:
    """Return the largest difference between a converted file's outputs and Keras'."""
    model = read_keras(path)
    found = convert(model, outputs=OUTPUTS.get(name))
    rows, columns, channels = found.input_shape
    scale = found.scale or (1.0, 0.0)
    network = Sequential((channels, rows, columns), found.layers, scale)
    network.load_state_dict(found.state)
    images = frames[f"{rows}x{columns}"][..., :channels]
    with torch.inference_mode():
        out = network.eval()(torch.from_numpy(images).permute(0, 3, 1, 2)).numpy()
    wanted = expected.reshape(len(expected), -1)
    return float((np.abs(out - wanted) / np.maximum(np.abs(wanted), 1)).max())


def main() -> int:
    """Print a row for each model; return 1 if a file is refused or differs."""
    python = os.environ.get("KERAS_PYTHON")
    if not python:
        raise SystemExit(f"keras_parity: {INSTALL}")
    console = Console(soft_wrap=True)
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    table = Table(title="converted networks", title_justify="left")
    for column in ("model", *ENDINGS):
        table.add_column(column, justify="left" if column == "model" else "right")
    wrong: list[str] = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        frames = write_frames(folder / "frames.npz")
        program = Path(__file__).with_name("keras_models.py")
        console.print("building models with Keras ...")
        subprocess.run(
            [python, str(program), str(folder), *sys.argv[1:]],
            env=kept | {"TF_CPP_MIN_LOG_LEVEL": "3"},
            stderr=subprocess.DEVNULL,
            check=True,
        )
        expected = dict(np.load(folder / "expected.npz"))
        versions = json.loads((folder / "versions.json").read_text())
        for key, outputs in expected.items():
            name = key.partition("_")[2]
            cells = []
            for ending, pattern in ENDINGS.items():
                try:
                    found = difference(folder / pattern.format(key), frames, outputs, name)
                except InputError as error:
                    wrong.append(f"{key}{ending}: {str(error).replace(f'{folder}/', '')}")
                    cells.append("refused")
                    continue
                cells.append(f"{found:.1e}")
                if not found <= MOST:
                    wrong.append(f"{key}{ending}: differs by {found:.1e}, more than {MOST:g}")
            table.add_row(key, *cells)
    console.print(table)
    names = ", ".join(f"{label} is {version}" for label, version in versions.items())
    console.print(f"{len(expected)} models, {names}; {len(wrong)} files refused or different")
    for line in wrong:
        console.print(line, highlight=False, markup=False)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
