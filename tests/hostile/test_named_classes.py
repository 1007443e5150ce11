"""Classes of other packages that a saved config may name: none does more than compute.

Each is constructed from hostile values, and each augmentation is applied. Python's audit events
report every file, process and connection.
"""

import inspect
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import albumentations
import cv2
import numpy as np
import pytest
import torch

from tests.slow_members import slow_but
from zoo.runs.allowed_classes import ALLOWED, is_allowed, public_classes

WATCHED = ("open", "os.", "shutil.", "socket.", "subprocess.", "exec", "compile", "marshal.")
HARMLESS = ("os.listdir", "os.scandir", "os.putenv", "os.unsetenv")
_reported: list[tuple[str, str]] | None = None


def _report(event: str, values: tuple) -> None:
    if _reported is not None and event.startswith(WATCHED) and event not in HARMLESS:
        _reported.append((event, repr(values)[:200]))


sys.addaudithook(_report)


@contextmanager
def watched(bait: Path) -> Iterator[list[tuple[str, str]]]:
    """Yield the audit events within this context that concern the bait, or that run anything."""
    global _reported
    _reported = events = []
    try:
        yield events
    finally:
        _reported = None
        # A first use imports modules, which opens their files.
        events[:] = [(name, at) for name, at in events if str(bait.parent) in at or _runs(name)]


def _runs(event: str) -> bool:
    return event.startswith(("subprocess.", "socket.connect", "os.system", "os.exec", "os.fork"))


def hostile_values(bait: Path) -> list[object]:
    path = str(bait)
    code = f"__import__('pathlib').Path({str(bait.with_name('ran'))!r}).touch()"
    called = {"_target_": "os.system", "_args_": [f"touch {bait.with_name('ran')}"]}
    return [path, [path], [path, path], {"path": path, "image_path": path}, code, [code], called]


def constructed(kind: type, bait: Path) -> Iterator[object]:
    """Yield what a class accepts: with one hostile value at a time, and with it everywhere."""
    names = [
        name
        for name, param in inspect.signature(kind.__init__).parameters.items()
        if name != "self" and param.kind not in (param.VAR_POSITIONAL, param.VAR_KEYWORD)
    ]
    for value in hostile_values(bait):
        for chosen in [*([name] for name in names), names]:
            try:
                yield kind(**dict.fromkeys(chosen, value))
            except Exception:  # refusing is right, by any error
                continue


@pytest.fixture
def bait(tmp_path: Path) -> Path:
    path = tmp_path / "bait.png"
    cv2.imwrite(str(path), np.full((20, 20, 3), 99, np.uint8))
    return path


def use(key: str, instance: object) -> None:
    """Use an object as a training would, where that needs no training."""
    if key == "data.augment.*":
        instance.p = 1.0
        instance(image=np.full((32, 64, 3), 128, np.uint8))
    elif key == "loss":
        instance(torch.zeros(2, 1), torch.ones(2, 1))


def touched(key: str, kind: type, bait: Path, monkeypatch: pytest.MonkeyPatch) -> list:
    """Return what a class opened, started or connected to, constructed from hostile values."""
    read: list[object] = []  # OpenCV opens files in C++, without an audit event
    monkeypatch.setattr(cv2, "imread", lambda path, *_: read.append(path))
    with warnings.catch_warnings(), watched(bait) as events:
        warnings.simplefilter("ignore")
        for instance in constructed(kind, bait):
            try:
                use(key, instance)
            except Exception:
                continue
    return events + read


class ReadsImage(albumentations.ImageOnlyTransform):
    def __init__(self, path: str = "") -> None:
        super().__init__()
        self.path = path

    def apply(self, img: np.ndarray, **_: object) -> np.ndarray:
        return cv2.imread(self.path)


class ReadsFile:
    def __init__(self, path: str) -> None:
        self.text = Path(path).read_bytes()


@pytest.mark.parametrize(("key", "kind"), [("data.augment.*", ReadsImage), ("optim", ReadsFile)])
def test_a_class_that_reads_a_file_is_noticed(
    key: str, kind: type, bait: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert touched(key, kind, bait, monkeypatch)


KEYS = [".".join(pattern) for pattern, allowed in ALLOWED.items() if allowed.package]


# A trainer looks for every accelerator when it is constructed, which takes seconds.
@pytest.mark.parametrize("key", slow_but({*KEYS} - {"trainer"}, KEYS))
def test_no_class_touches_a_file_a_process_or_the_network(
    key: str, bait: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = sorted(bait.parent.iterdir())
    classes = public_classes(ALLOWED[tuple(key.split("."))])
    assert classes
    for name, kind in classes.items():
        assert not touched(key, kind, bait, monkeypatch), name
    assert sorted(bait.parent.iterdir()) == before


@pytest.mark.parametrize(
    ("key", "target", "allowed"),
    [
        ("data.augment.x", "albumentations.RandomToneCurve", True),
        ("data.augment.x", "albumentations.GridDropout", True),
        ("loss", "torch.nn.PoissonNLLLoss", True),
        ("schedule", "torch.optim.lr_scheduler.CyclicLR", True),
        ("callbacks.x", "zoo.training.closed_loop.ClosedLoop", True),
        ("callbacks.x", "zoo.training.steering_module.SteeringModule", False),
        ("data.augment.x", "albumentations.FDA", False),
        ("data.augment.x", "albumentations.Compose", False),
        ("data.augment.x", "albumentations.core.utils.os.system", False),
        ("loss", "torch.nn.Linear", False),
        ("loss", "torch.nn.modules.loss.MSELoss", False),
        ("loss", "torch.load", False),
        ("optim", "torch.optim.lr_scheduler.StepLR", False),
        ("callbacks.x", "lightning.pytorch.callbacks.Any", False),
        ("logger.x", "lightning.pytorch.loggers.MLFlowLogger", False),
    ],
)
def test_a_named_class_needs_only_yaml(key: str, target: str, allowed: bool) -> None:
    assert is_allowed(tuple(key.split(".")), target) == allowed
