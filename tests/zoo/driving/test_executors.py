"""Executors of drives: that of another package, and those that there are not."""

from pathlib import Path

import pytest

from tests.contracts.outside_package import installed
from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError, UsageError
from zoo.base.process_pool import EXECUTORS
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario

CODE = """
from contextlib import contextmanager
from zoo.base.process_pool import ThisProcess

@contextmanager
def opened():
    print("opened outside")
    yield ThisProcess()
"""


def test_an_executor_of_a_package_drives(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    checkpoint = str(write_constant(tmp_path / "best.ckpt", 0.05))
    scenario = Scenario("lake", laps=0.005)
    with installed(tmp_path / "site", CODE, EXECUTORS, attribute=":opened"):
        (drive,) = all_drives(checkpoint, [scenario], executor="mine")
        assert len(drive)
        assert "opened outside" in capsys.readouterr().out
        with pytest.raises(UsageError, match=r"executor=mina: no such .*; did you mean mine\?"):
            all_drives(checkpoint, [scenario], executor="mina")
    with (
        installed(tmp_path / "lost", "import no_such_module", EXECUTORS, attribute=":opened"),
        pytest.raises(InputError, match=r"^outside_part:opened: the executor mine cannot"),
    ):
        all_drives(checkpoint, [scenario], executor="mine")
