"""`drivezoo report`: the contents of the page and the Markdown, and missing parts."""

import base64
import io
import json
import re
import shlex
import shutil
from pathlib import Path

import PIL.Image
import pytest
import torch

from tests.recordings import Written
from tests.refusals import refusal
from tests.zoo.command_runs import only_line, run_here
from zoo.driving.drive_log import read_drive
from zoo.driving.drives_table import mean_and_spread
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.runs.metrics_file import write_metrics_file
from zoo.runs.result_table import Table
from zoo.scoring.blocks import Image, Images, Rows, Section, Text, to_html, to_markdown
from zoo.scoring.track_scores import KeptDrive
from zoo.scoring.write_up import write_report

MISSING = re.compile(r'<p class="missing">(.*?)</p>')
PLACE = re.compile(r"""\b(?:src|href|poster)\s*=\s*["']?([^"'\s>]+)""")


@pytest.fixture(scope="module")
def driven(run_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the report of a finished run with a filmed drive."""
    folder = tmp_path_factory.mktemp("report") / "run"
    shutil.copytree(run_folder, folder)
    forget_drives(folder)
    scenario = Scenario("lake", laps=0.03, speed=25.0, quality="simple")
    keep = KeptDrive(folder / "drives" / "lake-0", film_speed=3.0)
    all_drives(str(folder / "checkpoints" / "best.ckpt"), [scenario], keep)
    scored = {"lake": mean_and_spread([read_drive(folder / "drives" / "lake-0").summary])}
    metrics = json.loads((folder / "metrics.json").read_text()) | {"drive": {"tracks": scored}}
    (folder / "metrics.json").write_text(json.dumps(metrics))
    write_report(folder)
    return folder


@pytest.fixture(scope="module")
def markdown(driven: Path) -> str:
    return (driven / "report" / "report.md").read_text()


@pytest.fixture
def undriven(run_folder: Path, tmp_path: Path) -> Path:
    """Copy a finished run that was not driven, for tests that damage it."""
    folder = Path(shutil.copytree(run_folder, tmp_path / "run"))
    forget_drives(folder)
    return folder


def forget_drives(folder: Path) -> None:
    shutil.rmtree(folder / "drives", ignore_errors=True)
    shutil.rmtree(folder / "report", ignore_errors=True)
    metrics = json.loads((folder / "metrics.json").read_text())
    (folder / "metrics.json").write_text(json.dumps(metrics | {"drive": None}))


def missing_in(folder: Path) -> list[str]:
    return MISSING.findall(write_report(folder).read_text())


def test_the_page_embeds_all_images_and_films(driven: Path) -> None:
    path = driven / "report" / "index.html"
    text = path.read_text()
    places = PLACE.findall(text)
    assert all(link.startswith(("data:", "#")) for link in places)
    assert "url(" not in text
    assert "<script" not in text
    for name in places:
        if name.startswith("#"):
            assert f'id="{name[1:]}"' in text
    encoded = [link.partition(";base64,") for link in places if link.startswith("data:")]
    files = [(kind, base64.b64decode(data)) for kind, _, data in encoded]
    images = [data for kind, data in files if kind.startswith("data:image/")]
    for image in images:
        PIL.Image.open(io.BytesIO(image)).verify()
    # Histogram, batch, curves, two scatter plots, track and error; cameras, recovery, flip, worst.
    assert len(images) >= 7 + 3 + 6 + 2 + 1
    (film,) = [data for kind, data in files if kind == "data:video/mp4"]
    assert film[4:8] == b"ftyp"
    assert path.stat().st_size < 15_000_000
    assert not MISSING.findall(text)


def test_the_markdown_links_each_image_file(driven: Path) -> None:
    folder = driven / "report"
    text = (folder / "report.md").read_text()
    names = set(re.findall(r"!\[[^\]]*\]\(<([^>]+)>\)", text))
    assert names == {path.name for path in folder.iterdir()} - {"index.html", "report.md"}
    (film,) = re.findall(r"\]\(<([^>]+\.mp4)>\)", text)
    assert (folder / film).is_file()
    for line in re.findall(r"^\|.*$", text, re.MULTILINE):
        assert line.endswith("|")


def test_driving_figures_stand_before_open_loop_figures(driven: Path, markdown: str) -> None:
    drive = json.loads((driven / "drives" / "lake-0" / "drive.json").read_text())
    metrics = json.loads((driven / "metrics.json").read_text())
    wanted = [
        f"| Autonomy, lake | {drive['autonomy']:.1%} |",
        f"| Cross-track error, lake | {drive['cte_mean_m']:.2f} m |",
    ]
    places = [markdown.index(row) for row in wanted]
    assert places == sorted(places)
    headline, _, open_loop = markdown.partition("## Open loop")
    assert places[-1] < headline.index("## Data")
    mse = f"{metrics['open_loop']['test']['mse']:.4f}"
    assert mse not in headline.partition("## Driving")[0]
    assert mse in open_loop
    for figure in (metrics["data"]["fingerprint"], f"{metrics['parameters']:,}"):
        assert figure in markdown


def test_the_headline_has_no_whole_path(markdown: str, recorded: Written) -> None:
    headline = markdown.partition("\n## ")[0]
    assert recorded.folder.name in headline
    assert str(recorded.folder.parent) not in headline


def test_the_command_repeats_the_run(markdown: str) -> None:
    (line,) = re.findall(r"^drivezoo train .*$", markdown, re.MULTILINE)
    words = shlex.split(line)
    assert "model=nvidia" in words
    assert "data.batch_size=16" in words
    assert any(word.startswith("data.root=") and word.endswith("lake") for word in words)


def test_the_settings_name_the_recording(markdown: str, recorded: Written) -> None:
    settings = markdown[markdown.index("## Settings") :]
    assert "| data.root |" in settings
    assert "| data |" not in settings, "data=lake was not recorded"
    assert Path(recorded.folder).name in settings[: settings.index("<details>")]


def test_side_cameras_are_shown_with_their_labels(markdown: str) -> None:
    assert re.search(r"recover\\?_s=null", markdown)
    labels = dict(re.findall(r"(left|center|right): label ([+-][\d.]+)", markdown))
    assert float(labels["left"]) == pytest.approx(float(labels["center"]) + 0.275, abs=0.0011)
    assert float(labels["right"]) == pytest.approx(float(labels["center"]) - 0.275, abs=0.0011)


def test_a_run_that_was_not_driven_says_so(undriven: Path) -> None:
    (line,) = missing_in(undriven)
    assert "drivezoo evaluate" in line
    page = (undriven / "report" / "index.html").read_text()
    assert "Unknown whether it drives." in page
    assert "<video" not in page


def test_a_moved_recording_removes_only_its_images(undriven: Path) -> None:
    path = undriven / "checkpoints" / "best.ckpt"
    checkpoint = torch.load(path, weights_only=True)
    checkpoint["drivezoo"]["config"]["data"]["root"] = "/moved/away"
    torch.save(checkpoint, path)
    lines = missing_in(undriven)
    assert sum("/moved/away: no such folder" in line for line in lines) == 1
    names = {path.name for path in (undriven / "report").iterdir()}
    assert {"steering_histogram.png", "fed_batch.jpg", "training_curves.png"} <= names
    assert "camera_left.jpg" not in names


def test_a_changed_recording_is_reported(undriven: Path) -> None:
    metrics = json.loads((undriven / "metrics.json").read_text())
    metrics["data"]["fingerprint"] = "0123456789abcdef"
    metrics["leak"] = {"val": {"seconds": None}}  # of a recording without times
    (undriven / "metrics.json").write_text(json.dumps(metrics))
    page = write_report(undriven).read_text()
    assert "not the one of the training" in page
    assert "nearest training row" not in page


def test_a_failed_run_says_why(undriven: Path) -> None:
    shutil.rmtree(undriven / "checkpoints")
    shutil.rmtree(undriven / "plots")
    (undriven / "metrics.json").unlink()
    (undriven / "status.json").write_text('{"status": "failed", "reason": "the <disk> is full"}')
    lines = missing_in(undriven)
    assert lines[0] == "The run failed: the &lt;disk&gt; is full."
    assert any("no checkpoint" in line for line in lines)
    assert (undriven / "report" / "camera_left.jpg").is_file()


def test_a_section_that_fails_leaves_the_others(undriven: Path) -> None:
    metrics = json.loads((undriven / "metrics.json").read_text())
    metrics["leak"] = {"val": 3}
    (undriven / "metrics.json").write_text(json.dumps(metrics))
    lines = missing_in(undriven)
    assert any("This part could not be written (TypeError" in line for line in lines)
    assert (undriven / "report" / "training_curves.png").is_file()


def test_an_earlier_report_is_replaced_and_other_files_are_kept(undriven: Path) -> None:
    (undriven / "report").mkdir()
    (undriven / "report" / "mine.txt").write_text("mine")
    (undriven / "report" / "index.html").write_text("old")
    page = write_report(undriven)
    assert "Model card" in page.read_text()
    assert (undriven / "report" / "mine.txt").read_text() == "mine"
    assert not list(page.parent.glob(".*.part"))


def test_bad_input_is_one_line(tmp_path: Path, run_folder: Path) -> None:
    line = only_line(run_here(tmp_path, "nowhere", module="zoo.commands.report"))
    assert "nowhere: no such folder" in line
    sweep = tmp_path / "sweep"
    shutil.copytree(run_folder / ".hydra", sweep / "0" / ".hydra")
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "replay").mkdir()
    write_metrics_file(tmp_path / "replay", {"replay": {}})
    for name, message in {
        "sweep": f"name a run's folder, such as {sweep / '0'}",
        "empty": "is no run (no .hydra/config.yaml) and no evaluation (no metrics.json)",
        "file": "is no run",
        "replay": "replay: has no drives on tracks; name one of outputs/evaluations",
    }.items():
        assert message in refusal(write_report, tmp_path / name)


def test_a_report_that_cannot_be_written_is_one_line(undriven: Path) -> None:
    (undriven / "report").write_text("a file in the way")
    assert "cannot be written" in refusal(write_report, undriven)


def test_a_runs_name_cannot_become_markup() -> None:
    evil = '<script>alert("1")</script>|`*_'
    image = Image("a.png", b"", evil, plot=True)
    sections = [Section("Data", [Text(evil), Rows(Table.of([evil], [[evil]])), Images([image])])]
    page = to_html(evil, sections, evil)
    assert "<script" not in page
    assert 'alt="&lt;script' in page
    text = to_markdown(evil, sections)
    assert not re.search(r"(?<!\\)<script", text)
    assert text.count("\n| ") == 3, "a character in a cell has ended it"
