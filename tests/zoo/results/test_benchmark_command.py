"""`drivezoo benchmark`: digests, baselines, verification and bad input, on short roads."""

import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import pytest
import torch
import yaml
from rich.console import Console

from tests.refusals import refusal
from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError, StoppedError, UsageError
from zoo.checkpoints.checkpoint_path import PACKAGED
from zoo.commands.benchmark import benchmark
from zoo.results import suite_drives
from zoo.results.benchmarked import PAGE, groups_table, overall, print_result
from zoo.results.checked_result import caveats, read_result
from zoo.results.result import NAME, digest_of_drives, write_result
from zoo.results.suite_drives import UNFINISHED, drive_figures
from zoo.results.summary import drives_of, summarize_drives
from zoo.simulator.track_names import road_folder


def write_family(folder: Path, **changes: object) -> Path:
    """Write a family of roads of 60 m, and return its path."""
    family = yaml.safe_load((road_folder() / "lakeside.yaml").read_text())
    road = folder / "short.yaml"
    road.write_text(yaml.safe_dump(family | {"length": [60, 60], "closed": 0} | changes))
    return road


def write_suite(folder: Path, **changes: object) -> Path:
    """Write a suite with one clean and one shifted drive of 60 m, and return its path."""
    track = f"{write_family(folder)}:1"
    content = {"name": "tiny", "quality": "simple", "mean_steering": 0.1, "speed": 20}
    shifted = {"track": track, "weather": {"fog": 0.4}}
    content["groups"] = {"like": [{"track": track}], "looks": [shifted]}
    path = folder / "tiny.yaml"
    path.write_text(json.dumps(content | changes))
    return path


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_suite(tmp_path_factory.mktemp("suite"))


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_constant(tmp_path_factory.mktemp("run") / "best.ckpt", 0.02, seed=7)


@pytest.fixture(scope="module")
def entry(checkpoint: Path, suite: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a result of two training seeds."""
    other = write_constant(checkpoint.with_name("other.ckpt"), -0.3, seed=8)
    return drive([checkpoint, other], suite, tmp_path_factory.mktemp("out") / "entry")


def drive(drivers: list[object], suite: Path | str, out: Path, *more: str) -> Path:
    benchmark.main([*map(str, drivers), f"suite={suite}", f"out={out}", "workers=1", *more])
    return out


def verify(result: Path, suite: Path, drives: int = 0) -> None:
    benchmark.main(["verify", str(result), f"suite={suite}", "workers=1", f"drives={drives}"])


def changed(entry: Path, folder: Path, change: Callable[[dict], object]) -> Path:
    """Write a copy of a result with a change, and return its path."""
    result = json.loads((entry / NAME).read_text())
    change(result)
    path = folder / NAME
    path.write_text(json.dumps(result))
    return path


def test_a_result_names_what_was_driven(entry: Path, checkpoint: Path) -> None:
    result = read_result(entry)
    assert (result.version, result.suite, result.entry) == (1, "tiny", "linear")
    assert re.fullmatch("[0-9a-f]{16}", result.roads)
    assert [network.training_seed for network in result.checkpoints] == [7, 8]
    assert result.checkpoints[0].file == str(checkpoint)
    assert result.checkpoints[0].data == "0" * 16
    driven = [(record.checkpoint, record.group, record.settings) for record in result.drives]
    fog = {"weather": {"fog": 0.4}}
    assert driven == [(0, "like", {}), (0, "looks", fog), (1, "like", {}), (1, "looks", fog)]
    figures = result.drives[0].figures
    assert figures["driven_m"] == pytest.approx(60, abs=1.5)
    assert "latency_ms" not in figures
    assert set(result.differences["looks"]) == {"autonomy", "cte_mean_m"}


def test_a_terminal_of_60_columns_shows_the_main_figures(entry: Path, console: Console) -> None:
    console.width = 60
    result = read_result(entry)
    print_result(result, console)
    printed = console.file.getvalue()
    for _, *cells in groups_table(result).short().cells:
        for cell in cells:
            figure, _, interval = cell.rstrip(")").partition(" (")
            low, _, high = interval.removesuffix(" or more").partition(" to ")
            assert re.search(rf" {re.escape(figure)}\s", printed)
            assert (f"{low}..{high}" if high else low) in printed


@pytest.fixture
def interrupted(suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a benchmark that was stopped in its second drive."""
    functions = iter([drive_figures])

    def drive_once(*arguments: object) -> object:
        function = next(functions, None)
        if function is None:
            raise KeyboardInterrupt
        return function(*arguments)

    out = tmp_path / "out"
    with monkeypatch.context() as patched:
        patched.setattr("zoo.results.suite_drives.drive_figures", drive_once)
        with pytest.raises(StoppedError, match=f"1 of 2 drives.*out={re.escape(str(out))}"):
            drive(["zero"], suite, out)
    return out


def test_an_interrupted_benchmark_resumes_and_has_the_same_digest(
    interrupted: Path, suite: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    path = interrupted / UNFINISHED
    path.write_text(path.read_text() + '{"job": 1, "dri')  # as a killed process leaves it
    resumed = read_result(drive(["zero"], suite, interrupted))
    assert "1 finished drive" in capsys.readouterr().out
    assert resumed == read_result(drive(["zero"], suite, tmp_path / "whole"))
    assert not path.exists()


@pytest.mark.parametrize("small_disk", ["64k"], indirect=True)
def test_a_full_disk_keeps_the_drives(interrupted: Path, suite: Path, small_disk: Path) -> None:
    out = small_disk / "out"
    shutil.copytree(interrupted, out)
    content = (out / UNFINISHED).read_bytes()
    (small_disk / "full").write_bytes(bytes(shutil.disk_usage(small_disk).free))
    assert f"{UNFINISHED}: No space left" in refusal(drive, ["zero"], suite, out)
    assert (out / UNFINISHED).read_bytes() == content


def test_drives_of_another_driver_are_not_resumed(interrupted: Path, suite: Path) -> None:
    with pytest.raises(InputError, match=r"drivers: differ .* out="):
        drive(["expert"], suite, interrupted)


@pytest.mark.parametrize("line", ["{", "[]", '{"job": 0}', '{"job": "0", "drive": {}}'])
def test_damaged_drives_are_not_resumed(interrupted: Path, suite: Path, line: str) -> None:
    path = interrupted / UNFINISHED
    path.write_text(path.read_text() + line + "\n")
    with pytest.raises(InputError, match=f"{UNFINISHED}.*"):
        drive(["zero"], suite, interrupted)


def test_verify_repeats_drives(entry: Path, suite: Path, capsys: pytest.CaptureFixture) -> None:
    verify(entry, suite)
    printed = capsys.readouterr().out
    assert "4 of 4 drives repeated: all digests are equal; 4 of 4 are clean or failed" in printed
    assert printed.endswith("; all figures are equal\n")


def test_verify_repeats_the_same_drives_each_time(
    entry: Path, suite: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driven = mock.Mock(side_effect=InputError("seen"))
    monkeypatch.setattr(suite_drives, "drive_suite", driven)
    for _ in range(4):
        assert refusal(verify, entry, suite, 2) == "seen"
    first, *others = [call.args[1] for call in driven.call_args_list]
    assert others == [first] * 3


def test_verify_names_why_digests_may_differ(entry: Path) -> None:
    result = read_result(entry)
    assert {driver.tied for driver in result.checkpoints} == {""}
    assert list(caveats(result)) == []
    tied = [driver.model_copy(update={"tied": "in 32 bits"}) for driver in result.checkpoints]
    for update, words in (
        ({"digests": 1}, "computed in single precision"),
        ({"code": {"hash": "a1", "commit": "b-dirty"}}, "of other code (b-dirty a1; here "),
        ({"checkpoints": tied}, "another kind of processor gives other figures: in 32 bits"),
    ):
        (line,) = caveats(result.model_copy(update=update))
        assert words in line


@pytest.mark.parametrize(
    ("update", "words"),
    [({"digest": "0" * 16}, f"digest {'0' * 16} -> "), ({}, "cte_mean_m 0.001 -> ")],
)
def test_verify_prints_how_a_drive_differs(
    suite: Path, tmp_path: Path, capsys: pytest.CaptureFixture, update: dict, words: str
) -> None:
    """All sums of the changed result fit its drives."""
    result = read_result(drive(["expert"], suite, tmp_path / "honest"))
    first, *others = result.drives
    figures = first.figures | {"cte_mean_m": 0.001}
    drives = [first.model_copy(update={"figures": figures, **update}), *others]
    sums = vars(summarize_drives(drives)) | {"digest": digest_of_drives(drives)}
    write_result(tmp_path, result.model_copy(update={"drives": drives, **sums}))
    assert "1 with another digest or other figures" in refusal(verify, tmp_path, suite)
    printed = capsys.readouterr().out
    most = "2 of 2 are clean or failed as before; figures differ by at most: cte_mean_m"
    for text in (words, "(by 0.0", most):
        assert text in printed


@pytest.mark.parametrize(
    ("keys", "value", "words"),
    [
        ("version", 2, "version 2, this drivezoo reads 1"),
        ("roads", "0" * 16, "roads: 0000000000000000 is not that of"),
        ("suite", "v0", "suite: v0 is not included.*suite=PATH"),
        ("digest", "0" * 16, "digest: is not that of its drives"),
        ("groups/all but laps/autonomy/value", 0.5, "all but laps.autonomy: is not that of its"),
        ("groups/like/autonomy/low", 0.99, "like.autonomy: is not that of its drives"),
        ("groups/like", {}, "groups.like.interventions_per_km: is not that of its"),
        ("drives/0/settings", {"speed": 9.0}, "each checkpoint must have it once"),
        ("drives/0/checkpoint", 5, "drives.0.checkpoint: is 5"),
        ("drives/0/figures", {}, "drives.0.figures.autonomy: is missing"),
        ("checkpoints/0/sha256", "0" * 64, "another file than the one"),
        ("checkpoints/0/file", "/{}".format, "best.ckpt: no such"),  # on Windows, a server's
        ("drives/0/figures/interventions", -1, "is -1, not in 0..1e.06"),
        ("checkpoints/0/training_seed", 1, "training_seed: is 1, but"),
        ("entry", 3, "entry: should be text"),
        ("checkpoints", lambda drivers: 2 * drivers[:1], "named twice"),
        ("checkpoints/0/training_seed", 8, "other.ckpt: has the training seed 8 and the rec"),
    ],
)
def test_verify_refuses_a_changed_result(
    entry: Path, suite: Path, tmp_path: Path, keys: str, value: object, words: str
) -> None:
    def change(content: dict) -> None:
        *above, last = keys.split("/")
        for key in above:
            content = content[0 if key == "0" else key]
        content[last] = value(content[last]) if callable(value) else value

    assert re.search(words, refusal(verify, changed(entry, tmp_path, change), suite))


def test_figures_of_an_older_analysis_are_computed_again(entry: Path, tmp_path: Path) -> None:
    def age(result: dict) -> None:
        del result["analysis"]
        result |= {"headline": {"value": 1.0, "low": 1.0, "high": 1.0}}
        result["groups"]["like"]["autonomy"]["low"] = 1.0

    assert read_result(changed(entry, tmp_path, age)).groups == read_result(entry).groups


def test_a_checkpoint_is_found_in_the_results_folder(
    entry: Path, suite: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    files = [Path(network.file) for network in read_result(entry).checkpoints]
    hashes = [network.sha256 for network in read_result(entry).checkpoints]
    shutil.copy(files[0], tmp_path / "best.ckpt")
    shutil.copy(files[1], tmp_path / f"{hashes[1][:16]}.ckpt")
    os.mkfifo(tmp_path / "another.ckpt")  # is not opened
    (tmp_path / "endless.onnx").symlink_to("/dev/zero")

    def move(content: dict) -> None:
        content["checkpoints"][0]["file"] = "/another machine/checkpoints/best.ckpt"
        content["checkpoints"][1]["file"] = r"C:\another machine\checkpoints\best.ckpt"

    changed(entry, tmp_path, move)
    verify(tmp_path, suite, drives=1)
    assert "1 of 4 drives repeated" in capsys.readouterr().out


def test_the_baselines_have_their_order(tmp_path: Path) -> None:
    """Zero and mean lose, the expert completes every road, late commands cost smoothness."""
    groups = {
        "like": [{"track": "lakeside:501"}],
        "sharp": [{"track": "alpine:701"}],
        "dynamics": [{"track": "country:613", "speed": 25}],
    }
    suite = write_suite(tmp_path, groups=groups)
    results = {
        name: read_result(drive([name], suite, tmp_path / name))
        for name in ("zero", "mean", "expert", "expert_late")
    }
    for name in ("zero", "mean"):
        assert overall(results[name])["autonomy"].value < 0.5
        assert not any(record.figures["interventions"] == 0 for record in results[name].drives)
    assert all(record.figures["interventions"] == 0 for record in results["expert"].drives)
    autonomy = overall(results["expert"])["autonomy"]
    assert autonomy.value == 1
    assert autonomy.low < 1  # no failure in four drives is no certainty
    for good, late in zip(results["expert"].drives, results["expert_late"].drives, strict=True):
        assert late.figures["autonomy"] <= good.figures["autonomy"]
        assert late.figures["steering_per_s"] > good.figures["steering_per_s"]
    names = ("expert", "expert_late")
    (good,), (late,) = (drives_of(results[name].drives, "dynamics") for name in names)
    assert late.figures["cte_mean_m"] > 2 * good.figures["cte_mean_m"]


def test_the_page_shows_names_as_text(suite: Path, tmp_path: Path) -> None:
    out = drive(["zero"], suite, tmp_path / "page", "entry=<script>hacked=1</script>")
    page = (out / PAGE).read_text()
    assert "<script" not in page
    assert "&lt;script&gt;hacked" in page
    assert "default-src &#39;none&#39;" in page
    assert str(read_result(out).digest) in page


def test_a_missed_mark_fails_after_all_files_are_written(tmp_path: Path) -> None:
    mark = {"autonomy": 0.9}
    suite = write_suite(tmp_path, marks={"like": mark, "../../looks": mark})
    suite.write_text(suite.read_text().replace('"looks"', '"../../looks"'))  # a stranger's
    assert "marks not reached" in refusal(drive, ["mean"], suite, tmp_path / "mean")
    names = {path.name for path in (tmp_path / "mean").iterdir() if path.name[0] != "."}
    assert names == {NAME, PAGE, "marks.json", "marks.html", "failures"}
    folders = sorted(path.name for path in (tmp_path / "mean" / "failures").iterdir())
    assert folders == ["______looks", "like"]
    assert "data:image/jpeg" in (tmp_path / "mean" / "marks.html").read_text()
    drive(["expert"], suite, tmp_path / "expert")


def test_steering_nan_has_no_marks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    suite = write_suite(tmp_path, marks={"like": {"autonomy": 0}})
    nan = {"nan_frames": 1}
    monkeypatch.setattr(suite_drives, "drive_figures", lambda drive: drive_figures(drive) | nan)
    with pytest.raises(InputError, match="the network steered NaN in 2 frames"):
        drive(["zero"], suite, tmp_path / "nan")
    names = {path.name for path in (tmp_path / "nan").iterdir() if path.name[0] != "."}
    assert names == {NAME, PAGE}


@pytest.mark.parametrize(
    ("drivers", "words"),
    [
        (["zero", "expert"], "zero: a baseline is an entry of its own"),
        (["CKPT", "CKPT"], "named twice"),
        (["CKPT", "LAST"], "last.ckpt: has the training seed 7 and the recordings of .*best.ckpt"),
        (["no.ckpt"], "no.ckpt: no such checkpoint"),
        (["CKPT", "LENET"], "is a LeNet, but"),
        (["WRONG"], "head.weight is .* in the file"),
    ],
)
def test_wrong_drivers_get_one_line(
    checkpoint: Path, suite: Path, tmp_path: Path, drivers: list[str], words: str
) -> None:
    contents = torch.load(checkpoint, weights_only=True)
    contents["state_dict"]["network.head.weight"] = torch.zeros(1, 99)  # of another image size
    torch.save(contents, tmp_path / "wrong.ckpt")
    places = {
        "CKPT": str(checkpoint),
        "LAST": str(write_constant(tmp_path / "last.ckpt", 0.03, epoch=9, seed=7)),
        "WRONG": str(tmp_path / "wrong.ckpt"),
        "LENET": str(PACKAGED / "lenet.ckpt"),
    }
    drivers = [places.get(driver, driver) for driver in drivers]
    assert re.search(words, refusal(drive, drivers, suite, tmp_path / "out"))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"group": {}}, "group: no such key"),
        ({"groups": {"like": [{"trak": "alpine:1"}]}}, "groups.like.0.trak: no such key"),
        ({"groups": {"like": [{"track": "alpin:1"}]}}, "groups.like: alpin:1: there is no family"),
        ({"groups": {"like": []}}, "groups: has no drive"),
        ({"groups": {"like": [{"track": "alpine:1"}] * 2}}, "alpine:1 stands twice"),
        ({"groups": {"a": [{"track": "alpine:1", "delay_s": 9}]}}, r"delay_s=9\.0: .*0\.\.2"),
        ({"groups": {"a": [{"track": "alpine:1", "weather": {"fogg": 1}}]}}, "fogg: no such key"),
        ({"speed": 99}, "speed: .*30"),
        ({"mean_steering": None}, "mean: the suite tiny has no mean_steering"),
    ],
)
def test_a_wrong_suite_gets_one_line(tmp_path: Path, changes: dict, words: str) -> None:
    suite = write_suite(tmp_path, **changes)
    assert re.search(words, refusal(drive, ["mean"], suite, tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_an_unknown_suite_is_wrong_use(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"suite=quik: no such suite; did you mean quick\?"):
        drive(["zero"], "quik", tmp_path / "out")


@pytest.mark.parametrize("arguments", [["verify"], ["verify", "result.json", "out=x"]])
def test_verify_takes_one_result_and_writes_nothing(arguments: list[str]) -> None:
    with pytest.raises(UsageError, match="verify: "):
        benchmark.main(arguments)


def test_the_dev_roads_are_a_suite_of_their_own(tmp_path: Path) -> None:
    suite = write_suite(tmp_path, dev=["lakeside:301"])
    result = read_result(drive(["zero"], suite, tmp_path / "out", "split=dev"))
    assert result.suite == "tiny-dev"
    assert [(record.group, record.track) for record in result.drives] == [("dev", "lakeside:301")]
    verify(tmp_path / "out", suite)
