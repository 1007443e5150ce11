"""Runs and figures of `benchmarks/first_try.py`."""

import json

import pytest

from benchmarks.first_try import FirstTryOptions, Tried, main, try_one
from tests.recordings import Written
from zoo.base.errors import InputError


def test_a_finished_run_is_not_repeated(tmp_path):
    done = Tried(1.0, 2.0, {"autonomy": [1.0, 0.0]}, {"autonomy": [0.9, 0.0]}, 2, 3)
    (tmp_path / "tried.json").write_text(json.dumps(vars(done)))
    assert try_one(("no such key",), "nowhere", tmp_path, FirstTryOptions()) == done


@pytest.mark.slow
def test_a_candidate_is_trained_and_driven(recorded: Written, tmp_path):
    options = FirstTryOptions(out=str(tmp_path))
    small = ("model=tiny", "trainer.max_epochs=1", "data.samples_per_epoch=64", "score.laps=0.01")
    split = ("data.block_s=0.5", "data.gap_s=0.1")
    run = tmp_path / "run"
    first = try_one((*small, *split), str(recorded.folder), run, options)
    assert 0 <= first.best["autonomy"][0] <= 1
    assert first.last == first.best  # one epoch
    assert first.cpu_s > 0
    assert (run / "tried.json").is_file()


@pytest.mark.parametrize(
    ("argument", "said"),
    [
        ("recording=muose", "recording=muose: must be all, real"),
        ("recording=real", "real=FOLDER"),
        ("only=lennet", "only=lennet: no such candidate; available: first_try"),
        ("seed=1", "seed: no such key"),
    ],
)
def test_a_mistake_is_one_line(argument, said, tmp_path):
    with pytest.raises(InputError, match=said):
        main([argument, f"out={tmp_path}"])
