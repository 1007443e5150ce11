"""Executors of drives: that of another package, those that there are not, and a user's threads."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import torch

from tests.contracts.outside_package import installed
from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError, UsageError
from zoo.base.process_pool import EXECUTORS
from zoo.driving.run_drives import all_drives, one_thread
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


def test_overlapping_drives_of_threads_keep_torchs_number_of_threads() -> None:
    torch.set_num_threads(2)
    first, second = one_thread(), one_thread()
    with ThreadPoolExecutor(1) as a, ThreadPoolExecutor(1) as b, ThreadPoolExecutor(1) as later:
        for thread, drive in ((a, first), (b, second)):
            thread.submit(drive.__enter__).result()
        for thread, drive in ((a, first), (b, second)):
            thread.submit(drive.__exit__, None, None, None).result()
        assert later.submit(torch.get_num_threads).result() == 2
