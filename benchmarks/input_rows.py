"""How often the search of a network's input is right, on networks whose input is known."""

import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from benchmarks.board_rows import Row
from benchmarks.measuring import make_console
from benchmarks.study_grid import Entry, Study, kept
from datamodules.recording_format import read_recordings
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.input_search.combinations import Combination, KnownInput, read_trial_frames
from zoo.input_search.import_options import ImportOptions
from zoo.input_search.judgement import steer_alike
from zoo.input_search.keras_import import find_input, network_maker
from zoo.input_search.trials import NEAR_ROWS, try_one
from zoo.keras.keras_layers import ConvertedKeras


def input_rows(study: Study, entry: Entry, run: Path) -> Iterable[Row]:
    """Return a row for a search with the scale that a file tells, and one for a search of it."""
    for scale_from in ("told", "searched"):
        path = run / f"search_{scale_from}.json"
        yield kept(path, lambda told=scale_from == "told": searched(study, run, told))


def searched(study: Study, run: Path, told: bool) -> Row:
    """Return what the search of a network's input finds, whether it is certain, and its drive.

    Args:
        study: study with the folder of the recording.
        run: folder of the network's training.
        told: whether the scale is known.
    """
    path = run / "checkpoints" / "best.ckpt"
    checkpoint, recording = load_checkpoint(path), read_recordings(study.values["root"])
    settings, view = checkpoint.config["model"], checkpoint.view
    own = Combination(view, tuple(settings["scale"]))
    state = checkpoint.network.state_dict()
    converted = ConvertedKeras(settings["layers"], state, view.shape, own.scale, [], 1)
    known = KnownInput(shape=view.shape, scale=own.scale if told else None)
    began = os.times()
    judged = find_input(path, converted, known, recording, ImportOptions(), make_console())
    ended = os.times()
    found, make = judged.best.combination, network_maker(converted)
    frames = read_trial_frames(recording, ImportOptions.frames)
    truth, trial = (try_one(make, one, frames) for one in (own, found))
    rows_off = np.abs(np.subtract(found.view.crop, view.crop)).max()
    return {
        "scale_from": "the file" if told else "the search",
        "verdict": "not certain" if judged.doubts else "certain",
        "drive": "kept the lane" if judged.driven and judged.driven[0].kept else "left the lane",
        "colour_differs": int(found.view.colour != view.colour),
        # 128 and 127.5 are the same for a network.
        "scale_differs": int(not np.allclose(found.scale, own.scale, rtol=0.01)),
        "crop_differs": int(rows_off > NEAR_ROWS),
        "steers_otherwise": int(not steer_alike(trial, truth)),
        "found": found.text(),
        "correlation": round(judged.best.correlation, 3),
        "chance": round(judged.chance, 3),
        "true_correlation": round(truth.correlation, 3),
        "driven_m": round(judged.driven[0].driven_m) if judged.driven else "",
        "cpu_s": round(sum(ended[:4]) - sum(began[:4]), 1),
    }
