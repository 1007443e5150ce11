"""`drivezoo doubt`: the file that it writes, the commands that take it, and its errors."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.zoo.command_runs import only_line, run_here, succeed
from tests.zoo.written_checkpoints import write_constant, write_pilotnet
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.commands.drive import view_line
from zoo.extras.research.doubt import doubt
from zoo.server.input_checks import check_checkpoint

FRAMES = np.random.default_rng(0).integers(0, 256, (3, 160, 320, 3), np.uint8)


@pytest.fixture
def dropout(tmp_path: Path) -> Path:
    """Return a file of one checkpoint; the checkpoint itself is gone."""
    member = write_pilotnet(tmp_path / "member=[1].ckpt")
    doubt.main([str(member), f"out={tmp_path / 'dropout.ckpt'}", "samples=5"])
    member.unlink()
    return tmp_path / "dropout.ckpt"


@pytest.fixture
def ensemble(tmp_path: Path) -> Path:
    """Return a file of three checkpoints with two views; the checkpoints are gone."""
    members = [write_constant(tmp_path / f"{steering}.ckpt", steering) for steering in (0.1, 0.3)]
    members.append(write_pilotnet(tmp_path / "pilotnet.ckpt"))
    doubt.main([*map(str, members), f"out={tmp_path / 'ensemble.ckpt'}"])
    for member in members:
        member.unlink()
    return tmp_path / "ensemble.ckpt"


@pytest.fixture(params=["dropout", "ensemble"])
def file(request: pytest.FixtureRequest) -> Path:
    return request.getfixturevalue(request.param)


def test_several_become_an_ensemble_with_their_own_views(ensemble: Path, tmp_path: Path) -> None:
    policy = load_policy(ensemble)
    third = load_policy(write_pilotnet(tmp_path / "again.ckpt"))(FRAMES[0], 9.0).steering
    command = policy(FRAMES[0], 9.0)
    assert command.steering == pytest.approx(np.mean([0.1, 0.3, third]))
    assert command.spread == pytest.approx(np.std([0.1, 0.3, third]))
    assert view_line(policy).endswith("sees 14 x 1 hsv_s and 200 x 66 rgb")
    inputs = [row.found for row in check_checkpoint(str(ensemble)) if row.what == "input"]
    assert [text.partition(";")[0] for text in inputs] == ["14 x 1 hsv_s", "200 x 66 rgb"]


def test_the_table_has_a_row_for_each_checkpoint(here: Path, capsys: pytest.CaptureFixture) -> None:
    members = [write_constant(Path(f"{steering}.ckpt"), steering) for steering in (0.1, 0.3)]
    members.append(write_pilotnet(Path("[red].ckpt")))
    doubt.main([*map(str, members), "table=networks.csv"])
    rows = list(csv.DictReader(Path("networks.csv").read_text().splitlines()))
    assert [row["checkpoint"] for row in rows] == ["0.1.ckpt", "0.3.ckpt", "[red].ckpt"]
    assert [row["network"] for row in rows] == ["Linear", "Linear", "PilotNet"]
    assert sum(int(row["parameters"]) for row in rows) == load_policy("doubt.ckpt").parameters
    assert [rows[2][column] for column in ("width", "height", "colour")] == ["200", "66", "rgb"]
    printed = capsys.readouterr().out
    assert "[red].ckpt" in printed, "a name is not markup"
    assert "wrote: doubt.ckpt\nwrote: networks.csv\n" in printed


def test_the_file_holds_plain_containers_and_all_that_it_needs(file: Path) -> None:
    contents = torch.load(file, weights_only=True)
    assert contents["drivezoo"] == {
        "format": 1,
        "doubt": {"samples": 5 if "dropout" in file.name else 20, "seed": 1},
    }
    assert {tuple(sorted(member)) for member in contents["members"]} == {("drivezoo", "state_dict")}


@pytest.mark.parametrize(
    ("module", "arguments"),
    [
        ("zoo.commands.export", ["{file}"]),
        ("zoo.extras.research.doubt", ["{file}"]),
        ("zoo", ["model=nvidia", "model.weights={file}", "data.root={recording}", "score=none"]),
    ],
)
def test_a_command_that_needs_one_network_names_the_way(
    module: str, arguments: list[str], ensemble: Path, tmp_path: Path, recorded: object
) -> None:
    words = [argument.format(file=ensemble, recording=recorded.folder) for argument in arguments]
    line = only_line(run_here(tmp_path, *words, module=module))
    assert f"{ensemble}: is a file of drivezoo doubt" in line
    assert "name a checkpoint that it was written from" in line


def test_saliency_is_of_one_network(dropout: Path, ensemble: Path, recorded: object) -> None:
    image, cwd = str(recorded.image(3)), dropout.parent
    succeed(run_here(cwd, str(dropout), image, module="zoo.commands.saliency"))
    again = [str(ensemble), image, "overwrite=true"]
    line = only_line(run_here(cwd, *again, module="zoo.commands.saliency"))
    assert "2 Linear and 1 PilotNet: an ONNX file or an ensemble has no" in line


def test_an_earlier_file_is_replaced_and_a_checkpoint_is_kept(dropout: Path) -> None:
    member = write_pilotnet(dropout.parent / "member.ckpt")
    earlier = member.read_bytes()
    doubt.main([str(member), f"out={dropout}", "samples=7", "overwrite=true"])
    policy = load_policy(dropout)
    assert policy.name == "PilotNet with 7 dropout samples"
    assert policy(FRAMES[0], 9.0).spread > 0
    arguments = [str(member), f"out={member}", "overwrite=true"]
    refused = run_here(dropout.parent, *arguments, module="zoo.extras.research.doubt")
    assert f"out={member}: is an input" in only_line(refused)
    assert member.read_bytes() == earlier


@pytest.mark.parametrize(
    ("words", "fault", "remedy"),
    [
        (["linear.ckpt"], "linear.ckpt: Linear has no dropout", "several checkpoints"),
        (["linear.ckpt", "copy.ckpt"], "copy.ckpt: is the same network", "training seeds"),
        (["linear.ckpt", "lost.ckpt"], "lost.ckpt: no such checkpoint", "name"),
        (["pilotnet.ckpt", "samples=1"], "samples=1", "2..100"),
        (["pilotnet.ckpt", "out=doubt.txt"], "out=doubt.txt", ".ckpt"),
        (["pilotnet.ckpt", "table=doubt.txt"], "table=doubt.txt", ".csv"),
        (["pilotnet.ckpt", "out=no/doubt.ckpt"], "out=no/doubt.ckpt", "name another"),
    ],
)
def test_wrong_input_is_one_line(words: list[str], fault: str, remedy: str, tmp_path: Path) -> None:
    write_pilotnet(tmp_path / "pilotnet.ckpt")
    for epoch, name in enumerate(("linear.ckpt", "copy.ckpt")):
        write_constant(tmp_path / name, 0.1, epoch)
    before = sorted(tmp_path.iterdir())
    line = only_line(run_here(tmp_path, *words, module="zoo.extras.research.doubt"))
    assert fault in line
    assert remedy in line
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda contents: contents.update(members=[]), "members: holds 0"),
        (lambda contents: contents["drivezoo"]["doubt"].update(samples=10**9), "samples"),
        (lambda contents: contents["drivezoo"].update(format=2), "format version 2"),
        (
            lambda contents: contents.update(members=[dict(contents, members=[])]),
            "member 1: is a file of drivezoo doubt",
        ),
        (lambda contents: contents["members"][0]["state_dict"].popitem(), "member 1: lacks"),
        (lambda contents: contents.update(members=["model"]), "member 1: is not a checkpoint"),
    ],
)
def test_a_changed_file_is_one_line(spoil: Callable, words: str, dropout: Path) -> None:
    contents = torch.load(dropout, weights_only=True)
    spoil(contents)
    torch.save(contents, dropout)
    result = run_here(dropout.parent, str(dropout), "track=lake", module="zoo.commands.evaluate")
    assert words in only_line(result)
