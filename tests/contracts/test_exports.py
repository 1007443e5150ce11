"""What every kind of exported file promises, over all kinds, one of another package among them."""

import re
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from rich.console import Console

from tests.contracts.outside_package import installed, manual_example
from tests.recordings import Written
from tests.zoo.written_checkpoints import write_pilotnet
from zoo.base.errors import InputError, UsageError
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.scoring import parity
from zoo.scoring.checked_export import export_checkpoint
from zoo.scoring.exported_file import FLOAT, GROUP, ExportedFile, export_names, exports
from zoo.scoring.parity import Parity, take_frames

Export = Callable[..., Path]
Kind = type[ExportedFile]
KINDS = [(name, weights) for weights in (FLOAT, "int8") for name, _ in exports(weights=weights)]
KINDS.append(("mine", FLOAT))


@pytest.fixture(scope="module", autouse=True)
def _outside(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Install a package outside the checkout."""
    folder, code = tmp_path_factory.mktemp("site"), manual_example("my_exports.py")
    with installed(folder, code, GROUP, attribute=":ArraysFile"):
        yield


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write_pilotnet(tmp_path_factory.mktemp("network") / "best.ckpt"))


@pytest.fixture(params=KINDS, ids=".".join)
def names(request: pytest.FixtureRequest) -> tuple[str, str]:
    return request.param


@pytest.fixture
def kind(names: tuple[str, str]) -> Kind:
    ((_, kind),) = exports(*names)
    if missing := [package for package in kind.packages if not find_spec(package)]:
        pytest.skip(f"needs {' and '.join(missing)}")
    return kind


@pytest.fixture
def export(names: tuple[str, str], checkpoint: str, recorded: Written) -> Export:
    """Return a function that exports the checkpoint to a path."""
    options = (str(recorded.folder), Console(soft_wrap=True), *names)
    return lambda out, **keys: export_checkpoint(checkpoint, str(out), *options, **keys)


def test_the_file_steers_as_its_checkpoint(
    kind: Kind, export: Export, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    out = tmp_path / kind.default
    assert export(out) == out
    printed = capsys.readouterr().out
    assert kind.engine in printed or kind.not_run in printed
    endings = [*kind.beside, out.suffix]
    for ending in endings:
        assert out.with_suffix(ending).stat().st_size
        assert f"wrote: {out.with_suffix(ending)}" in printed
    assert len([*tmp_path.glob("[!.]*")]) == len(endings)
    assert ("next: drivezoo drive" in printed) == kind.drives
    with pytest.raises(UsageError, match=r"exists; .*overwrite=true"):
        export(out)


def test_the_network_stays(kind: Kind, checkpoint: str, recorded: Written, tmp_path: Path) -> None:
    loaded = load_checkpoint(checkpoint)
    before = {name: tensor.clone() for name, tensor in loaded.network.state_dict().items()}
    exported = kind(loaded, tmp_path / kind.default, str(recorded.folder))
    assert {*exported.files("# card")} == {Path(kind.default).suffix, *kind.beside}
    exported.changes(loaded, exported.shown(take_frames(str(recorded.folder), loaded, 2)))
    assert all(tensor.equal(before[name]) for name, tensor in loaded.network.state_dict().items())


def test_a_file_that_steers_differently_is_not_written(
    kind: Kind, checkpoint: str, export: Export, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parity, "compare", lambda *_: Parity(0.5, 0.5, 1.0, 1.0))
    monkeypatch.setattr(kind, "policy", lambda *_: load_policy(checkpoint))
    endings = (Path(kind.default).suffix, *kind.beside)
    monkeypatch.setattr(kind, "files", lambda *_: dict.fromkeys(endings, b"not read"))
    with pytest.raises(InputError, match=re.escape(kind.remedy)):
        export(tmp_path / kind.default)
    assert kind.drives != ("out=model.onnx" in kind.remedy)
    assert not [*tmp_path.iterdir()]


def test_a_file_of_a_diverged_network_is_not_written(
    checkpoint: str, recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nan = float("nan")
    files = (str(tmp_path / "model.onnx"), str(recorded.folder), Console(quiet=True))
    monkeypatch.setattr(parity, "compare", lambda *_: Parity(nan, nan, 1.0, 1.0))
    with pytest.raises(InputError, match=r"optim\.lr"):
        export_checkpoint(checkpoint, *files, "onnx")
    assert not [*tmp_path.iterdir()]


def test_a_users_file_is_kept(kind: Kind, export: Export, tmp_path: Path) -> None:
    for ending in (Path(kind.default).suffix, *kind.beside):
        folder = tmp_path / ending.removeprefix(".")
        path = folder.joinpath(kind.default).with_suffix(ending)
        folder.mkdir()
        path.write_text("mine")
        with pytest.raises(InputError, match=f"{path.name}: exists"):
            export(folder / kind.default)
        assert [*folder.iterdir()] == [path]
        assert path.read_text() == "mine"


def test_a_foreign_key_is_refused(kind: Kind, export: Export, tmp_path: Path) -> None:
    for key, value in {"calibration": "a", "throttle": 0.2}.items():
        if key not in kind.keys:
            with pytest.raises(UsageError, match=f"{key}: belongs to .*; leave it out"):
                export(tmp_path / kind.default, **{key: value})


def test_a_missing_package_is_named_with_its_command(
    kind: Kind, export: Export, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kind, "packages", ("nowhere", *kind.packages))
    with pytest.raises(InputError, match=rf"nowhere.*: {re.escape(kind.install)}"):
        export(tmp_path / kind.default)


def test_another_kind_is_named_with_those_that_there_are(checkpoint: str, tmp_path: Path) -> None:
    files = (str(tmp_path / "a"), None, Console(quiet=True))
    with pytest.raises(UsageError, match=r"to=onxx: no such kind of file; .*onnx"):
        export_checkpoint(checkpoint, *files, to="onxx")
    with pytest.raises(UsageError, match=r"weights=int8: belongs to .*; leave it out"):
        export_checkpoint(checkpoint, str(tmp_path / "a.npz"), None, files[2], weights="int8")
    assert {"onnx", "mine"} <= {*export_names()}


def test_a_kind_that_cannot_be_imported_is_one_line(checkpoint: str, tmp_path: Path) -> None:
    with installed(tmp_path / "site", "import nowhere", GROUP, name="broken_export"):
        with pytest.raises(InputError, match=r"broken_export: .* mine .*install its package"):
            list(exports())
        (tmp_path / "here").mkdir()
        out = tmp_path / "here" / "model.onnx"
        export_checkpoint(checkpoint, str(out), None, Console(quiet=True))  # ours does not need it
