"""Executors of drives: that of another package, and those that there are not."""

from pathlib import Path

import pytest

from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError, UsageError
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


def test_an_executor_of_another_package_runs_the_drives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    about = tmp_path / "site" / "my_cluster-1.dist-info"
    about.mkdir(parents=True)
    (tmp_path / "site" / "my_cluster.py").write_text(CODE)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: my_cluster\nVersion: 1\n")
    group = "[drivezoo.executors]\nmine = my_cluster:opened\nlost = no_such_module:opened\n"
    (about / "entry_points.txt").write_text(group)
    monkeypatch.syspath_prepend(tmp_path / "site")
    checkpoint = str(write_constant(tmp_path / "best.ckpt", 0.05))
    scenario = Scenario("lake", laps=0.005)
    (drive,) = all_drives(checkpoint, [scenario], executor="mine")
    assert len(drive)
    assert "opened outside" in capsys.readouterr().out
    with pytest.raises(InputError, match=r"^no_such_module:opened: the executor lost cannot"):
        all_drives(checkpoint, [scenario], executor="lost")
    with pytest.raises(UsageError, match=r"executor=mina: no such executor; did you mean mine\?"):
        all_drives(checkpoint, [scenario], executor="mina")
