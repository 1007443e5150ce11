"""What an entry point of another package must name, and what a broken one may not break."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from datamodules.known_formats import formats
from tests.contracts.outside_package import installed, write_package
from zoo.base.entry_points import load_named
from zoo.base.errors import InputError
from zoo.checkpoints.network_files import describe_network
from zoo.checkpoints.policy_kinds import policy_kind
from zoo.commands.compare import compare, compare_files, comparison_of
from zoo.commands.leaderboard import paper_writers
from zoo.commands.simulator import COMMANDS, simulator
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.scoring.exported_file import export_names, exports
from zoo.server.driven_simulator import SIMULATORS, DrivenSimulator

USES: dict[str, Callable[[], object]] = {
    "executors": lambda: all_drives("a.ckpt", [Scenario("lake")], executor="mine"),
    "exports": lambda: list(exports("mine")),
    "formats": formats,
    "papers": lambda: paper_writers("paper"),
    "policies": lambda: policy_kind({}),
    "simulators": lambda: load_named(SIMULATORS, "mine", DrivenSimulator),
    "weights": lambda: describe_network(Path("nowhere.h5")),
}


@pytest.mark.parametrize("group", USES)
def test_what_is_of_another_kind_is_named(group: str, tmp_path: Path) -> None:
    words = r"^outside_part:number: the \w+ mine is no [\w.]+; correct its package$"
    with (
        installed(tmp_path, "number = 5", f"drivezoo.{group}", attribute=":number"),
        pytest.raises(InputError, match=words),
    ):
        USES[group]()


OURS = [("formats", "table"), ("formats", "lerobot"), ("exports", "c")]
OURS = [(group, name) for group, name in OURS if name in {*formats(), *export_names()}]


@pytest.mark.parametrize("ours", OURS)  # of the extras that are there
def test_a_name_of_ours_is_not_anothers(
    ours: tuple, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    group, name = ours
    package = f"hidden_{group}_{name}"
    write_package(tmp_path, package, "number = 5", f"[drivezoo.{group}]\n{name} = {package}\n")
    before = USES[group]() if group == "formats" else list(exports(name))
    monkeypatch.syspath_prepend(tmp_path)  # Python finds the package first
    for _ in range(2):
        assert (USES[group]() if group == "formats" else list(exports(name))) == before
    line = rf"{package}: the {group[:-1]} {name} is not used: .* has that name; rename it\n"
    assert re.fullmatch(line, capsys.readouterr().err)


def test_a_broken_one_leaves_the_commands_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    entries = "[drivezoo.comparisons]\nmine = broken_ends:number\n"
    entries += "[drivezoo.commands]\nsimulator.mine = broken_ends:number\n"
    write_package(tmp_path, "broken_ends", "number = 5", entries)
    monkeypatch.syspath_prepend(tmp_path)
    simulator(["--help"])
    compare_files(["--help"])
    printed = capsys.readouterr()
    assert all(command.purpose in printed.out for command in (compare, *COMMANDS.values()))
    for group in ("command simulator.mine", "comparison mine"):
        assert f"broken_ends:number: the {group} is no zoo.base.command.Com" in printed.err
    assert comparison_of([tmp_path]) is compare


@pytest.mark.parametrize("name", ["result.json", "lenet.json"])
def test_no_package_is_asked_about_results_of_the_benchmark(name: str, tmp_path: Path) -> None:
    entries = "[drivezoo.comparisons]\nmine = broken_asks:ours\n"
    code = """from zoo.commands.compare import compare
class Ours:
    compare = compare
    def detect(self, files):
        raise TypeError("no file of ours")
ours = Ours()
"""
    write_package(tmp_path, "broken_asks", code, entries)
    (tmp_path / name).write_text('{"version": 1, "suite": "v1"}')
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(tmp_path)
        assert comparison_of([tmp_path / name, tmp_path / name]) is compare
        with pytest.raises(TypeError, match="no file of ours"):
            comparison_of([tmp_path / name, tmp_path / "broken_asks-1.dist-info"])
