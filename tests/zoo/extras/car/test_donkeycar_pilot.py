"""Donkeycar's pilot from `drivezoo new donkeycar`, with a C file."""

import subprocess
from pathlib import Path

import pytest

from tests.zoo.commands.test_donkeycar_part import FRAMES, checkpoint_of, imported_part
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.extras.car.c_file import c_header, c_source
from zoo.extras.car.compiled_policy import FLAGS, find_compiler


@pytest.mark.skipif(not find_compiler(), reason="no C compiler")
def test_a_c_file_steers_as_its_checkpoint_and_refuses_another_size(tmp_path: Path) -> None:
    checkpoint, library = checkpoint_of("tiny63"), tmp_path / "steer.so"
    library.with_suffix(".c").write_text(c_source(checkpoint, "steer", "float"))
    library.with_suffix(".h").write_text(c_header(checkpoint, "steer", ""))
    source = [str(library.with_suffix(".c")), "-o", str(library)]
    subprocess.run([find_compiler(), *FLAGS, "-shared", "-fPIC", *source], check=True)
    pilot, policy = imported_part(tmp_path).MyPilot(str(library)), CheckpointPolicy(checkpoint)
    for frame in FRAMES:
        assert pilot.run(frame)[0] == pytest.approx(policy(frame, 0.0).steering, abs=1e-5)
    assert pilot.run(None) == (0.0, 0.0)
    with pytest.raises(ValueError, match="IMAGE_W"):
        pilot.run(FRAMES[0, ::2])
    with pytest.raises(ValueError, match="IMAGE_DEPTH"):
        pilot.run(FRAMES[0, :, :, :1])
