"""The file that keeps a correction's rounds."""

from pathlib import Path

import pytest

from zoo.base.command_keys import read_options
from zoo.base.errors import InputError
from zoo.correct.correct_options import CorrectOptions
from zoo.correct.correction import open_progress, save


def test_a_correction_with_other_options_is_not_resumed(tmp_path: Path) -> None:
    checkpoint, out = tmp_path / "x.ckpt", tmp_path / "out"
    checkpoint.write_bytes(b"weights")
    options = read_options(CorrectOptions)
    new = open_progress(out, str(checkpoint), options, [])
    save(new, out)
    assert open_progress(out, str(checkpoint), options, []) == new
    late = read_options(CorrectOptions, ["delay_s=0.2"])
    with pytest.raises(InputError, match="delay_s=0"):
        open_progress(out, str(checkpoint), late, [])
