"""The included suites, which are frozen: another road or setting is another suite."""

import hashlib
from pathlib import Path

import pytest
import yaml

from zoo.base.errors import InputError
from zoo.benchmark.suite import find_suite, read_suite

DIGESTS = {  # of the drawn roads, and of the names and settings of the drives
    "v1": ("b8f0de7e4cb5bb10", "a7a5168db3e8dbcf"),
    "quick": ("8f37ed4042b2ca79", "101722f58c26a9bf"),
    "latency": ("cfd5a8509447fba6", "9ca47358a6d079ba"),
}


@pytest.mark.parametrize("name", DIGESTS)
def test_a_suite_is_frozen(name: str) -> None:
    suite = read_suite(name)
    keys = hashlib.sha256(repr([tuple(one.key) for one in suite.drives]).encode()).hexdigest()[:16]
    assert (suite.roads, keys) == DIGESTS[name]


def test_v1_pairs_each_shifted_drive_with_a_clean_one() -> None:
    suite = read_suite("v1")
    counts = {
        group: sum(one.group == group for one in suite.drives)
        for group in ("like", "sharp", "looks", "dynamics", "laps")
    }
    assert counts == {"like": 22, "sharp": 8, "looks": 8, "dynamics": 8, "laps": 2}
    clean = {one.track for one in suite.drives if one.group == "like"}
    assert {one.track for one in suite.drives if one.settings} <= clean
    assert len({one.key for one in suite.drives}) == len(suite.drives)


def test_quick_is_a_part_of_v1() -> None:
    keys = {one.key for one in read_suite("v1").drives}
    quick = read_suite("quick")
    assert quick.name == "v1-quick"
    assert {one.key for one in quick.drives} < keys


@pytest.mark.parametrize(
    ("name", "found"),
    [("v1", ("v1", "test")), ("v1-dev", ("v1", "dev")), ("v1-quick", ("quick", "test"))],
)
def test_a_results_suite_is_found_by_its_name(name: str, found: tuple[str, str]) -> None:
    assert find_suite(name, "v1") == found


def test_a_suite_of_too_many_drives_is_refused_before_its_roads_are_drawn(tmp_path: Path) -> None:
    path = tmp_path / "many.yaml"
    drives = [{"track": f"alpine:{number}"} for number in range(20_000)]
    path.write_text(yaml.safe_dump({"name": "many", "groups": {"like": drives}}))
    with pytest.raises(InputError, match=r"many\.yaml: groups: has 20,000 drives"):
        read_suite(str(path))
