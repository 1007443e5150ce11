"""Damaged files of a run, drive, sweep or checkpoint: one line each, and the others are read."""

import json
import os
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
import torch

from tests.refusals import refusal
from tests.zoo.command_runs import only_line, run_here
from tests.zoo.sweeps import write_run
from tests.zoo.written_checkpoints import write_constant
from zoo.base.bounded_files import MOST_JSON_BYTES, MOST_YAML_BYTES
from zoo.base.errors import InputError
from zoo.base.plain_files import read_json, read_yaml
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.driving.drive_log import DriveWriter, read_drive, write_summary
from zoo.driving.drive_record import DriveRow
from zoo.results.ranking import rank
from zoo.results.scored import read_scored
from zoo.runs.run_record import Run
from zoo.scoring.reported_run import ReportedRun
from zoo.simulator.track_file import read_track
from zoo.training.sweep_record import new_record, read_record, write_record

Damage = Callable[[Path], object]
LAUGHS = "a: &a [1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"{name}: &{name} [{','.join([f'*{before}'] * 9)}]\n" for before, name in pairwise("abcdefghij")
)
BASE_60 = "1" + ":1" * 400 + ".5"  # PyYAML raises OverflowError for it
METRICS, STATUS, CONFIG = "metrics.json", "status.json", ".hydra/config.yaml"
OVERRIDES, HYDRA = ".hydra/overrides.yaml", ".hydra/hydra.yaml"


def text(content: str) -> Damage:
    return lambda path: path.write_text(content)


def data(content: bytes) -> Damage:
    return lambda path: path.write_bytes(content)


def field(*keys: str, value: object) -> Damage:
    """Set a field of a JSON file, or of a YAML file in JSON syntax."""

    def damage(path: Path) -> None:
        contents = inner = json.loads(path.read_text())
        for key in keys[:-1]:
            inner = inner[key]
        inner[keys[-1]] = value
        path.write_text(json.dumps(contents))

    return damage


def folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def huge(path: Path) -> None:
    """Make it a sparse file of 2 GB."""
    with path.open("r+b") as file:
        file.truncate(2_000_000_000)


LAKE = ("drive", "tracks", "lake")
DAMAGE = {
    "empty": (METRICS, text(""), "JSON"),
    "list": (METRICS, text("[]"), "keys"),
    "not UTF-8": (METRICS, data(b'{"model": "\xff"}'), "UTF-8"),
    "NUL in text": (METRICS, field("model", value="a\0b"), "NUL"),
    "half a character": (METRICS, text('{"model": "\\ud800"}'), "character"),
    "deep": (METRICS, text("[" * 100_000), "64"),
    "many": (METRICS, text(f'{{"x": [{"[]," * 1_000_000}0]}}'), "1,000,000 values"),
    "rather deep": (METRICS, text('{"x":' + "[" * 80 + "]" * 80 + "}"), "64"),
    "5,000 digits": (METRICS, text(f'{{"parameters": {"9" * 5000}}}'), "JSON"),
    "folder": (METRICS, folder, "directory"),
    "pipe": (METRICS, pipe, "no regular file"),
    "2 GB": (METRICS, huge, "2,000,000,000"),
    "missing": (METRICS, Path.unlink, "o such file"),
    "text for figure": (METRICS, field(*LAKE, "autonomy", value="good"), "lake.autonomy: "),
    "NaN": (METRICS, field(*LAKE, "autonomy", value=[float("nan"), 0]), "lake.autonomy.0: "),
    "list of tracks": (METRICS, field("drive", "tracks", value=[1]), "drive.tracks: "),
    "infinite": (METRICS, field("wall_s", value=float("inf")), "wall_s: "),
    "400 digits": (METRICS, field("wall_s", value=10**400), "wall_s: "),
    "no cte_mean_m": (METRICS, field(*LAKE, value={"autonomy": [1, 0]}), "lake.cte_mean_m"),
    "negative count": (METRICS, field(*LAKE, "drives", value=-1), "lake.drives: "),
    "alias bomb": (CONFIG, text(LAUGHS), "alias"),
    "deep config": (CONFIG, text("a: " + "[" * 50_000), "nest"),
    "config's digits": (CONFIG, text(f"seed: {'9' * 5000}"), "5,000 digits"),
    "sexagesimal": (CONFIG, text("seed: " + "1:" * 300_000 + "1"), "number"),
    "no date": (CONFIG, text("when: 2001-99-99"), "YAML"),
    "base 60": (CONFIG, text(f"seed: {BASE_60}"), "digits"),
    "code": (CONFIG, text("a: !!python/object/apply:os.mkdir [ran]"), "YAML"),
    "empty config": (CONFIG, text(""), "keys"),
    "list for data": (CONFIG, field("data", value=[1]), "data: "),
    "dict of overrides": (OVERRIDES, text("a: 1"), "list"),
    "no hydra": (HYDRA, text("{}"), "hydra: "),
    "text for runtime": (HYDRA, field("hydra", "runtime", value="x"), "hydra.runtime: "),
    "list for status": (STATUS, text("[]"), "keys"),
    "text for pid": (STATUS, field("pid", value="x"), "pid: "),
    "curves": ("metrics.csv", text("epoch,val/mse\nx,0.1\n"), "row 2"),
    "curves' NUL": ("metrics.csv", data(b"epoch,val/mse\n0,\0\n"), "row 2"),
    "curves' pipe": ("metrics.csv", pipe, "no regular file"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_field_is_named_and_the_other_runs_are_ranked(name: str, tmp_path: Path) -> None:
    file, damage, words = DAMAGE[name]
    good = write_run(tmp_path / "good", 0.9, overrides=("x=1",))
    bad = write_run(tmp_path / "bad", 1.0, overrides=("x=2",))
    damage(bad / file)

    runs, unranked = read_scored([bad, good])

    assert [ranked.folder for ranked in runs] == [good]
    assert len(rank(runs)) == 1
    (damaged,) = unranked
    assert (damaged.folder, damaged.why) == (bad, "damaged")
    assert damaged.reason.startswith(file)
    assert words in damaged.reason
    assert "\n" not in damaged.reason
    assert len(damaged.reason) < 300


def test_files_with_fewer_and_other_keys_are_read(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", 0.9)
    metrics = json.loads((folder / METRICS).read_text())
    for key in ("parameters", "data", "wall_s"):
        del metrics[key]
    metrics["whatever"] = {"else": [1, None, "x"]}
    (folder / METRICS).write_text(json.dumps(metrics))
    (folder / STATUS).write_text(json.dumps({"status": "finished", "mood": "good"}))
    (run_read,), unranked = read_scored([folder])
    assert not unranked
    assert (run_read.mean("autonomy"), run_read.wall_s) == (0.9, 0.0)


def test_a_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    for read, limit in ((read_json, MOST_JSON_BYTES), (read_yaml, MOST_YAML_BYTES)):
        path = tmp_path / "file"
        path.write_text('"' + "x" * (limit - 2) + '"')
        assert len(read(path)) == limit - 2
        path.write_text('"' + "x" * (limit - 1) + '"')
        assert f"{limit:,}" in refusal(read, path)


def test_an_anchor_without_an_alias_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("a: &a 1\n")
    assert read_yaml(tmp_path / "a.yaml") == {"a": 1}


@pytest.fixture
def trained(tmp_path: Path) -> Path:
    """Write the folder of a finished run of `linear`."""
    folder = write_run(tmp_path / "run", 0.9)
    config = {"seed": 1, "data": {"root": None}, "model": {"name": "linear"}}
    (folder / CONFIG).write_text(json.dumps(config))
    write_constant(folder / "checkpoints" / "best.ckpt", 0.0)
    return folder


@pytest.mark.parametrize("name", ["alias bomb", "deep", "text for pid", "list for data"])
@pytest.mark.parametrize("module", ["zoo.commands.report", "zoo.commands.rerun", "zoo"])
def test_a_command_names_the_file_and_the_field(module: str, name: str, trained: Path) -> None:
    file, damage, words = DAMAGE[name]
    if (module, name) == ("zoo.commands.rerun", "text for pid"):
        pytest.skip("the repeated run writes its own status")
    damage(trained / file)
    before = sorted(trained.rglob("*"))
    argument = f"resume={trained}" if module == "zoo" else str(trained)
    line = only_line(run_here(trained.parent, argument, module=module))
    assert file in line
    assert words in line
    assert sorted(trained.rglob("*")) == before


def write_drive(folder: Path) -> Path:
    writer = DriveWriter(folder)
    writer.add([DriveRow(0.1 * row, frame="frames/1.jpg") for row in range(3)])
    writer.close()
    write_summary(folder, {"track": "lake", "seed": 0, "autonomy": 1.0, "cte_max_m": 0.3})
    return folder


END = ",,,,,0,,,\n"  # of a row after its frame
DRIVES = {
    "summary's text": ("drive.json", field("autonomy", value="x"), "autonomy: "),
    "rows not UTF-8": ("drive.csv", lambda path: path.open("ab").write(b"\xff\n"), "row 5"),
    "row's NUL": ("drive.csv", lambda path: path.open("a").write("0,1,x,\0,,,,,,,,\n"), "row 5"),
    "frame above": ("drive.csv", lambda path: path.open("a").write(f"0,1,x,a/../../b{END}"), "b'"),
    "server's": ("drive.csv", lambda path: path.open("a").write(f"0,1,x,//host/b{END}"), "host/b'"),
    "client": ("drive.csv", lambda path: path.open("a").write("0,1e999,x,,,,,,0,,,\n"), "client"),
    "text": ("drive.csv", lambda path: path.open("a").write("x,1,x,,,,,,0,,,\n"), "time_s"),
    "infinite": ("drive.csv", lambda path: path.open("a").write("inf,1,x,,,,,,0,,,\n"), "time_s"),
    "log's folder": ("drive.csv", folder, "directory"),
    "log's pipe": ("drive.csv", pipe, "no regular file"),
    "log of 2 GB": ("drive.csv", huge, "2,000,000,000"),
}


@pytest.mark.parametrize(("file", "damage", "words"), DRIVES.values(), ids=DRIVES)
def test_a_damaged_drive_is_named(file: str, damage: Damage, words: str, tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "drive")
    assert len(read_drive(drive)) == 3
    damage(drive / file)
    with pytest.raises(InputError, match=words) as caught:
        read_drive(drive)
    assert str(drive / file) in str(caught.value)
    assert len(str(caught.value)) < 300 + len(str(drive))


def test_a_damaged_drive_is_named_by_the_report(trained: Path) -> None:
    field("autonomy", value="x")(write_drive(trained / "drives" / "lake-0") / "drive.json")
    run_read = ReportedRun.open(trained)
    assert run_read.drives == []
    (line,) = run_read.damaged_drives
    assert "drive.json: autonomy: " in line


@pytest.mark.parametrize("name", ["drive.csv", "driving_log.csv"])
def test_film_names_a_log_that_is_no_regular_file(name: str, tmp_path: Path) -> None:
    log = tmp_path / name
    os.mkfifo(log)
    for path in (tmp_path, log):
        line = only_line(run_here(tmp_path, str(path), module="zoo.commands.film"))
        assert f"{log}: " in line
        assert "no regular file" in line


SWEEPS = {
    "text for jobs": (field("jobs", value="x"), "jobs: "),
    "number for argument": (field("arguments", value=[1]), "arguments.0: "),
    "text for format": (field("format", value="1"), "format: "),
    "no arguments": (text('{"format": 1}'), "arguments: "),
}


@pytest.mark.parametrize(("damage", "words"), SWEEPS.values(), ids=SWEEPS)
def test_a_damaged_sweep_is_named(damage: Damage, words: str, tmp_path: Path) -> None:
    write_record(tmp_path, new_record(["seed=1,2"]))
    assert read_record(tmp_path).arguments == ["seed=1,2"]
    damage(tmp_path / "sweep.json")
    with pytest.raises(InputError, match=rf"sweep\.json: .*{words}"):
        read_record(tmp_path)


CARDS = {
    "view's list": (("view",), [1], "view: "),
    "crop's text": (("view", "crop"), "x", "view.crop: "),
    "crop's NaN": (("view", "crop"), [float("nan"), 1], "view.crop.0"),
    "resize": (("view", "resize"), ["area"], "view.resize: "),
    "config's text": (("config",), "x", "config: "),
    "model's list": (("config", "model"), [1], "config.model: "),
    "rows": (("data", "rows"), "many", "data.rows: "),
}


@pytest.mark.parametrize(("keys", "value", "words"), CARDS.values(), ids=CARDS)
def test_a_damaged_card_is_named(keys: tuple, value: object, words: str, tmp_path: Path) -> None:
    path = write_constant(tmp_path / "x.ckpt", 0.0)
    contents = torch.load(path, weights_only=True)
    inner = contents["drivezoo"]
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    torch.save(contents, path)
    assert f"x.ckpt: drivezoo: {words}" in refusal(load_checkpoint, path)


def test_curves_in_files_of_other_names_are_ignored(tmp_path: Path) -> None:
    (tmp_path / "metrics.old.csv").write_text("epoch,val/mse\n0,0.5\n")
    (tmp_path / "metrics.csv").write_text("epoch,val/mse\n0,0.1\n")
    assert Run(tmp_path).curves(["val/mse"]) == {"val/mse": {1: 0.1}}


@pytest.mark.parametrize(("key", "name"), [("points", "mine.yaml"), ("length", "mine.yaml:17")])
def test_a_track_of_base_60_numbers_is_refused(key: str, name: str, tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(f"closed: true\n{key}: {BASE_60}\n")
    with pytest.raises(InputError, match=r"mine\.yaml.*line 2.*digits"):
        read_track(str(tmp_path / name))


def test_a_tag_chooses_no_constructor(tmp_path: Path) -> None:
    for tagged in ("!!int ''", "!!bool maybe", "!!timestamp x", "!!set {a}", "!mine 1"):
        (tmp_path / "a.yaml").write_text(f"a: {tagged}\n")
        with pytest.raises(InputError, match=r"a\.yaml.*line 1.*tag"):
            read_yaml(tmp_path / "a.yaml")
