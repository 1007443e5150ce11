"""Exit statuses of every command: 1 for unusable input, 2 for a mistyped command."""

from pathlib import Path

import pytest

from tests.zoo.commands import run

FAILED, WRONG_USE = 1, 2


@pytest.mark.parametrize(
    ("status", "command", "remedy"),
    [
        (WRONG_USE, "zoo model=lenett", "did you mean lenet"),
        (WRONG_USE, "zoo.evaluate", "usage"),
        (WRONG_USE, "zoo.drive drive.port=1", "drivezoo drive CKPT"),
        (WRONG_USE, "zoo.doctor port=0", "1..65535"),
        (WRONG_USE, "zoo.demo x", "no arguments"),
        (WRONG_USE, "zoo.report", "usage"),
        (WRONG_USE, "zoo.results", "usage"),
        (WRONG_USE, "simulator recrd", "did you mean record"),
        (WRONG_USE, "datamodules.check", "usage"),
        (FAILED, "zoo data.root=nowhere", "nowhere"),
        (FAILED, "zoo.evaluate no.ckpt", "no.ckpt"),
        (FAILED, "zoo.drive no.ckpt", "no.ckpt"),
        (FAILED, "zoo.report nowhere", "nowhere"),
        (FAILED, "zoo.leaderboard nowhere", "nowhere"),
        (FAILED, "simulator record out=x track=nowhere", "nowhere"),
        (FAILED, "datamodules.check nowhere", "nowhere"),
    ],
)
def test_the_exit_status_tells_wrong_use_from_failure(
    status: int, command: str, remedy: str, tmp_path: Path
) -> None:
    module, *arguments = command.split()
    result = run(tmp_path, *arguments, module=module)
    assert result.returncode == status, result.stderr
    assert remedy in result.stderr
