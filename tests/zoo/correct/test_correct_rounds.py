"""The file that keeps a correction's rounds."""

from pathlib import Path

import pytest

from zoo.base.errors import InputError
from zoo.cli.command_config import read_options
from zoo.correct.correct_options import CorrectOptions
from zoo.correct.correct_rounds import Progress, open_progress

NEW_KEYS = ("delay_s", "frame_rate", "quality")


def test_a_correction_of_an_earlier_version_is_resumed(tmp_path: Path) -> None:
    checkpoint, out = tmp_path / "x.ckpt", tmp_path / "out"
    checkpoint.write_bytes(b"weights")
    options = read_options("correct", CorrectOptions)
    new = open_progress(out, str(checkpoint), options, [])
    earlier = {key: value for key, value in new.options.items() if key not in NEW_KEYS}
    Progress(new.identity, earlier, []).save(out)
    assert open_progress(out, str(checkpoint), options, []).options == earlier
    late = read_options("correct", CorrectOptions, ["delay_s=0.2"])
    with pytest.raises(InputError, match="delay_s=0"):
        open_progress(out, str(checkpoint), late, [])
