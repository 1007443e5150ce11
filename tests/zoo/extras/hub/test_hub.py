"""`drivezoo hub` against a stand-in for the Hub: what is sent, fetched and refused."""

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
import yaml
from hypothesis import given

from tests.hostile.mutations import mutated_bytes
from tests.zoo.command_runs import only_line, run_here, succeed
from tests.zoo.extras.hub.stand_in import StandIn, serving
from tests.zoo.sweeps import write_run
from tests.zoo.written_checkpoints import write_constant
from zoo.checkpoints.checkpoint import load_checkpoint, read_checkpoint_file
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.checkpoints.new_checkpoint import checkpoint_bytes, lean_contents
from zoo.extras.hub.card import described_hash, shared_files

pytest.importorskip("huggingface_hub")

PLACE = "outputs/hub/ann/tiny"


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[StandIn]:
    with serving() as stand_in:
        monkeypatch.setenv("HF_ENDPOINT", stand_in.url)
        monkeypatch.setenv("HF_HOME", str(tmp_path / "hf"))
        monkeypatch.setenv("HF_TOKEN", "hf_of_ann")
        monkeypatch.setenv("NO_PROXY", "127.0.0.1")
        yield stand_in


def hub(cwd: Path, *arguments: str) -> subprocess.CompletedProcess:
    return run_here(cwd, *arguments, module="zoo.extras.hub.hub")


@pytest.fixture
def ran(tmp_path: Path) -> Path:
    """Return a copy of a run, whose config names a folder and a server of the user's."""
    folder = write_run(tmp_path / "run", 0.5)
    path = folder / "checkpoints" / "best.ckpt"
    path.parent.mkdir()
    contents = read_checkpoint_file(find_checkpoint("tiny41"))
    config = contents["drivezoo"]["config"]
    config["data"]["root"] = "/home/ann_private/lake"
    config["logger"] = {"mlflow": {"tracking_uri": "http://ann:secret@host"}}
    contents["drivezoo"]["data"]["curvature_per_m"] = 0.1625  # of no known car
    torch.save(contents, path)
    overrides = folder / ".hydra" / "overrides.yaml"
    overrides.write_text("- model=tiny\n- data.root=/home/ann_private/lake\n")
    return folder


def test_a_network_is_sent_and_fetched_whole(server: StandIn, ran: Path, tmp_path: Path) -> None:
    sent = hub(tmp_path, "push", str(ran), "repo=ann/tiny", "license=mit", "send=true")
    assert f"wrote: {server.url}/ann/tiny" in succeed(sent)
    files = server.repositories["ann/tiny"]
    assert set(files) == {"tiny.ckpt", "README.md"}
    fetched = succeed(hub(tmp_path, "pull", "ann/tiny"))
    assert f"next: drivezoo evaluate {PLACE}/tiny.ckpt track=lake" in fetched
    for name, contents in files.items():
        assert (tmp_path / PLACE / name).read_bytes() == contents
    before = load_checkpoint(ran).network.state_dict()
    after = load_checkpoint(tmp_path / PLACE / "tiny.ckpt").network.state_dict()
    assert all(torch.equal(before[name], after[name]) for name in before)
    again = hub(tmp_path, "pull", "ann/tiny")
    assert "exists already" in only_line(again), "nothing is overwritten"


def test_the_card_says_what_it_is_and_how_it_drives(ran: Path, tmp_path: Path) -> None:
    from huggingface_hub import ModelCard

    printed = succeed(hub(tmp_path, "push", str(ran), "repo=./card", "license=cc-by-4.0"))
    assert "repo=USER/NAME license=cc-by-4.0" in printed
    _, header, text = (tmp_path / "card" / "README.md").read_text().split("---\n", 2)
    header = yaml.safe_load(header)
    assert header["library_name"] == "drivezoo"
    assert header["drivezoo"]["data"] == "d799b34fbcd58066"
    card = ModelCard.load(tmp_path / "card" / "README.md")
    assert card.data.license == "cc-by-4.0"
    metrics = [result.metric_type for result in card.data.eval_results]
    assert metrics == ["autonomy", "interventions"]
    for part in ("41 parameters", "13,938 rows", "drivezoo drive tiny.ckpt", "0 of 1"):
        assert part in text
    for part in ("left; it is the", "25 degrees", "320 x 160 pixels", "Latency: a frame takes"):
        assert part in text


def test_the_card_of_a_packaged_network_has_its_drives(tmp_path: Path) -> None:
    succeed(hub(tmp_path, "push", "lenet", "repo=./card"))
    text = (tmp_path / "card" / "README.md").read_text()
    for part in ("3 of 3 laps", "12 of 13 drives", "drivezoo train"):
        assert part in text


def test_no_private_name_and_no_optimizer_is_in_the_files(ran: Path, tmp_path: Path) -> None:
    hub(tmp_path, "push", str(ran), "repo=./card")
    for path in (tmp_path / "card").iterdir():
        assert b"ann_private" not in path.read_bytes()
        assert b"secret" not in path.read_bytes()
    assert set(read_checkpoint_file(tmp_path / "card" / "tiny.ckpt")) == {"drivezoo", "state_dict"}


def test_nothing_is_sent_before_it_is_asked_for(server: StandIn, ran: Path, tmp_path: Path) -> None:
    shown = succeed(hub(tmp_path, "push", str(ran), "repo=ann/tiny"))
    assert "library_name: drivezoo" in shown
    assert shown.strip().endswith("repo=ann/tiny send=true")
    assert server.requests == []


def test_without_a_token_one_line_says_what_to_do(
    server: StandIn, ran: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("HF_TOKEN")
    # The library has read HF_HOME at its import: the tester may have a token.
    monkeypatch.setattr("huggingface_hub.constants.HF_TOKEN_PATH", str(tmp_path / "no token"))
    result = hub(tmp_path, "push", str(ran), "repo=ann/tiny", "send=true")
    assert "hf auth login" in only_line(result)
    assert server.requests == []


@pytest.fixture
def shared(server: StandIn) -> StandIn:
    """Serve `ann/tiny` with one checkpoint, without a card."""
    contents = lean_contents(read_checkpoint_file(find_checkpoint("tiny41")))
    server.repositories["ann/tiny"] = {"tiny.ckpt": checkpoint_bytes(contents)}
    return server


def test_no_track_is_suggested_for_another_cars_network(shared: StandIn, tmp_path: Path) -> None:
    contents = lean_contents(read_checkpoint_file(find_checkpoint("tiny41")))
    contents["drivezoo"]["data"]["source"] = "donkeycar"
    shared.repositories["ann/tiny"]["tiny.ckpt"] = checkpoint_bytes(contents)
    fetched = hub(tmp_path, "pull", "ann/tiny")
    assert f"next: drivezoo replay {PLACE}/tiny.ckpt FOLDER" in fetched.stdout


def refused(server: StandIn, tmp_path: Path, *more: str) -> str:
    """Return the line of a pull that is refused; it must leave no file."""
    line = only_line(hub(tmp_path, "pull", "ann/tiny", *more))
    assert not (tmp_path / PLACE).exists()
    return line


def test_a_checkpoint_with_code_is_not_kept(shared: StandIn, tmp_path: Path) -> None:
    path = tmp_path / "bad.ckpt"
    torch.save({"drivezoo": Path("/"), "state_dict": {}}, path)
    shared.repositories["ann/tiny"]["tiny.ckpt"] = path.read_bytes()
    assert "ann/tiny: tiny.ckpt: is damaged or contains code" in refused(shared, tmp_path)


def test_a_file_of_another_size_or_hash_is_not_kept(shared: StandIn, tmp_path: Path) -> None:
    shared.announced["tiny.ckpt"] = 100
    assert "larger than 100 bytes" in refused(shared, tmp_path)
    shared.announced.clear()
    files = shared.repositories["ann/tiny"]
    files["README.md"] = b"---\ndrivezoo:\n  sha256: " + b"0" * 64 + b"\n---\n"
    assert "its card describes" in refused(shared, tmp_path)
    del files["README.md"]
    shared.listed_hashes["tiny.ckpt"] = "0" * 64
    assert "the repository's list describes" in refused(shared, tmp_path)


def test_only_names_in_the_top_folder_are_fetched(shared: StandIn, tmp_path: Path) -> None:
    files = shared.repositories["ann/tiny"]
    files["../../evil.ckpt"] = files.pop("tiny.ckpt")
    assert "no .ckpt file" in refused(shared, tmp_path)
    assert "no .ckpt file" in refused(shared, tmp_path, "file=../../evil.ckpt")


def test_one_of_several_checkpoints_is_named(shared: StandIn, tmp_path: Path) -> None:
    path = write_constant(tmp_path / "other.ckpt", 0.5)
    shared.repositories["ann/tiny"]["other.ckpt"] = path.read_bytes()
    assert "other.ckpt, tiny.ckpt; name one with file=" in refused(shared, tmp_path)
    succeed(hub(tmp_path, "pull", "ann/tiny", "file=other.ckpt", "out=mine"))
    assert (tmp_path / "mine" / "other.ckpt").is_file()


def test_errors_of_the_hub_are_one_line(shared: StandIn, tmp_path: Path) -> None:
    assert "no such repository" in only_line(hub(tmp_path, "pull", "ann/none"))
    shared.refusal = 403
    assert "403" in refused(shared, tmp_path)


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("fetch", "ann/tiny"), "available: push, pull"),
        (("pus", "x"), "did you mean push"),
        (("pull", "tiny"), "write user/name"),
        (("pull", "../tiny"), "write user/name"),
        (("pull", "ann/tiny", "send=true"), "send: belongs to push"),
        (("push", "CKPT"), "repo=user/name"),
        (("push", "CKPT", "repo=tiny"), "write user/name"),
        (("push", "CKPT", "repo=./card", "license=MIT License"), "abbreviation"),
        (("push", "CKPT", "repo=./card", "send=true"), "send: nothing is sent to the folder"),
        (("push", "lenet.onnx", "repo=./card"), "name the checkpoint that it was exported from"),
    ],
)
def test_wrong_words_are_one_line(words: tuple[str, ...], part: str, tmp_path: Path) -> None:
    (tmp_path / "lenet.onnx").touch()
    assert part in only_line(hub(tmp_path, *words), 2)


def test_a_folder_of_the_repository_s_name_is_not_guessed(ran: Path, tmp_path: Path) -> None:
    (tmp_path / "ann" / "tiny").mkdir(parents=True)
    assert "also a folder" in only_line(hub(tmp_path, "push", str(ran), "repo=ann/tiny"))


@given(mutated_bytes(b"---\nlicense: mit\n---\n| `x.ckpt` | SHA-256 `" + b"0" * 64 + b"` |\n"))
def test_a_damaged_card_of_the_hub_has_a_hash_or_none(data: bytes) -> None:
    digest = described_hash(data.decode(errors="replace"))
    assert digest is None or len(digest) == 64


def test_a_card_suggests_no_track_for_another_cars_network(tmp_path: Path) -> None:
    path = write_constant(tmp_path / "tiny.ckpt", steering=0.0)
    contents = read_checkpoint_file(path)
    contents["drivezoo"]["data"]["source"] = "my car"
    torch.save(contents, path)
    card = shared_files(path, "ann/tub", None)["README.md"].decode()
    assert re.search(r"drivezoo replay outputs/hub/ann/tub/\S+ FOLDER", card)
    assert "sim=lake" not in card
