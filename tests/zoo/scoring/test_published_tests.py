"""Published tests of other packages, which `drivezoo evaluate challenge=NAME` scores on."""

from pathlib import Path

import pytest

import drivezoo
from tests.contracts.outside_package import installed
from zoo.base import entry_points
from zoo.base.errors import UsageError
from zoo.commands.evaluate import evaluate_or_replay

TEST = """
from zoo.base.command import command


@command
def score(ckpt: str, data: str, *, factor: int = 1) -> str:
    \"\"\"Score on a test.

    Args:
        ckpt: checkpoint.
        data: folder of the test.
        factor: number.
    \"\"\"
    print(ckpt, data, factor)
    return f"{ckpt} on {data}"
"""


def test_a_package_adds_a_test(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    with installed(tmp_path, TEST, "drivezoo.challenges", attribute=":score"):
        evaluate_or_replay(["lenet", "challenge=mine", "factor=3", "data=there"])
        assert capsys.readouterr().out == "lenet there 3\n"
        evaluate_or_replay(["challenge=mine", "--help"])
        assert "factor=1" in capsys.readouterr().out
        assert drivezoo.challenge("lenet", "there", test="mine") == "lenet on there"
        with pytest.raises(UsageError, match=r"challenge=other: no such challenge; .*mine"):
            evaluate_or_replay(["lenet", "challenge=other", "data=there"])


def test_without_a_test_one_line_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(entry_points, "installed_entries", lambda group: [])
    with pytest.raises(UsageError, match="challenge=ch2: no such challenge; none available"):
        evaluate_or_replay(["lenet", "challenge=ch2", "data=there"])
