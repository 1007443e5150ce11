"""Donkeycar's pilot from `drivezoo new donkeycar`, with a C file."""

import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.zoo.commands.test_donkeycar_part import FRAMES, checkpoint_of, imported_part
from zoo.base.rig import MPS_PER_MPH
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.extras.car.c_file import c_header, c_source
from zoo.extras.car.compiled_policy import FLAGS, find_compiler

pytestmark = pytest.mark.skipif(not find_compiler(), reason="no C compiler")


def compiled_pilot(checkpoint: Checkpoint, folder: Path) -> Any:
    """Return the part with a checkpoint's C file."""
    library = folder / "steer.so"
    library.with_suffix(".c").write_text(c_source(checkpoint, "steer", "float"))
    library.with_suffix(".h").write_text(c_header(checkpoint, "steer", ""))
    source = [str(library.with_suffix(".c")), "-o", str(library)]
    subprocess.run([find_compiler(), *FLAGS, "-shared", "-fPIC", *source], check=True)
    return imported_part(folder).MyPilot(str(library))


def test_a_c_file_steers_as_its_checkpoint_and_refuses_another_size(tmp_path: Path) -> None:
    checkpoint = checkpoint_of("tiny63")
    pilot, policy = compiled_pilot(checkpoint, tmp_path), CheckpointPolicy(checkpoint)
    for frame in FRAMES:
        assert pilot.run(frame)[0] == pytest.approx(policy(frame, 0.0).steering, abs=1e-5)
    assert pilot.run(None) == (0.0, 0.0)
    with pytest.raises(ValueError, match="IMAGE_W"):
        pilot.run(FRAMES[0, ::2])
    with pytest.raises(ValueError, match="IMAGE_DEPTH"):
        pilot.run(FRAMES[0, :, :, :1])


def test_a_c_file_of_a_network_that_takes_the_speed_refuses_a_missing_one(tmp_path: Path) -> None:
    checkpoint = checkpoint_of("nvidia_speed", "model.width=0.1", "model.activation=relu")
    pilot, policy = compiled_pilot(checkpoint, tmp_path), CheckpointPolicy(checkpoint)
    expected = pytest.approx(tuple(policy(FRAMES[0], 9.0)), abs=1e-5)
    assert pilot.run(FRAMES[0], 9 * MPS_PER_MPH) == expected
    with pytest.raises(ValueError, match="enc/speed"):
        pilot.run(FRAMES[0])
