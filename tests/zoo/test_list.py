"""Lists of the choices of each kind, with a description of each."""

from pathlib import Path

import pytest

from tests.zoo.base.user_parts import write_network
from tests.zoo.commands import only_line, run
from zoo.cli.conf_files import choice_files
from zoo.cli.console_script import LISTED
from zoo.list import description

FILES = [path for group, _ in LISTED.values() if group for path in choice_files(group).values()]


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_every_choice_has_a_description(path: Path) -> None:
    assert 10 < len(description(path)) < 200


def test_a_part_of_the_users_own_is_listed(tmp_path: Path) -> None:
    write_network(tmp_path)
    result = run(tmp_path, "models", "parts=my_net.py", module="zoo.list")
    assert result.returncode == 0, result.stderr
    assert "my_net: Steering from the mean of each column" in result.stdout
    assert "tracks, " not in result.stdout, "only the named kind"


def test_a_wrong_kind_names_the_right_one(tmp_path: Path) -> None:
    assert "did you mean tracks" in only_line(run(tmp_path, "track", module="zoo.list"))
