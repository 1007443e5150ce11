"""The recipes of `CONTRIBUTING.md`, followed in a copy of the project."""

import csv
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.recordings import Written
from tests.zoo import command_runs as commands
from tests.zoo.trainings import SMALL
from tests.zoo.written_checkpoints import write_constant

BLOCK = re.compile(r"```(?:python|yaml)\n# (?P<path>\S+)\n(?P<text>.*?)```", re.DOTALL)
PACKAGES = ("conf", "datamodules", "hydra_plugins", "zoo")

Run = Callable[..., str]


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy the project and add every part of the page to the copy."""
    copy = tmp_path_factory.mktemp("project")
    for name in PACKAGES:
        skip = shutil.ignore_patterns("__pycache__")
        shutil.copytree(commands.ROOT / name, copy / name, ignore=skip)
    for block in BLOCK.finditer((commands.ROOT / "CONTRIBUTING.md").read_text()):
        with (copy / block["path"]).open("a") as file:
            file.write(f"\n\n{block['text']}" if file.tell() else block["text"])
    return copy


@pytest.fixture
def run(project: Path, tmp_path: Path) -> Run:
    """Return what a command of the copy prints."""

    def run_command(module: str, *arguments: str) -> str:
        return commands.succeed(commands.run(tmp_path, *arguments, module=module, code=project))

    return run_command


def test_each_recipe_writes_a_file_and_a_yaml() -> None:
    page = (commands.ROOT / "CONTRIBUTING.md").read_text()
    folders = [str(Path(block["path"]).parent) for block in BLOCK.finditer(page)]
    assert page.count("```python") + page.count("```yaml") == len(folders)
    for name in ("model", "augment", "loss", "callbacks", "track"):
        assert f"conf/{name}" in folders


def test_the_help_lists_the_choices(run: Run) -> None:
    lines = run("zoo", "--help").splitlines()
    parts = {"model": "strip", "augment": "invert", "loss": "fourth_power"}
    for group, name in (parts | {"callbacks": "weight_norm"}).items():
        (choices,) = [line for line in lines if line.startswith(f"{group}: ")]
        assert name in choices.removeprefix(f"{group}: ").split(", ")


def test_the_zoo_lists_the_model_with_its_source(run: Run) -> None:
    assert "strip: Steering from the mean brightness" in run("zoo.commands.list", "models")


def train(run: Run, recorded: Written, model: str = "strip") -> None:
    parts = (f"model={model}", "augment=[invert]", "loss=fourth_power", "callbacks=weight_norm")
    usual = [key for key in SMALL if not key.startswith(("model=", "callbacks="))]
    places = (f"data.root={recorded.folder}", "data.cache=null", "hydra.run.dir=run")
    run("zoo", *parts, *usual, *places, "trainer.max_epochs=1")


@pytest.mark.parametrize(
    ("model", "parameters"),
    [pytest.param("strip", 33, marks=pytest.mark.slow), ("strip_change", 65)],
)
def test_the_parts_train_together(
    model: str, parameters: int, run: Run, recorded: Written, tmp_path: Path
) -> None:
    train(run, recorded, model)
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert (metrics["model"], metrics["parameters"]) == (model, parameters)
    with (tmp_path / "run" / "metrics.csv").open() as file:
        assert any(row.get("weight_norm") for row in csv.DictReader(file))


@pytest.mark.slow
def test_a_run_of_the_parts_resumes(run: Run, recorded: Written, tmp_path: Path) -> None:
    train(run, recorded)
    run("zoo", "resume=run", "trainer.max_epochs=2")
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["epochs"] == 2


def test_the_format_is_read(run: Run, tmp_path: Path) -> None:
    image = cv2.imencode(".jpg", np.full((160, 320, 3), 90, np.uint8))[1].tobytes()
    for row, steering in enumerate((0.25, 0.0, -0.25)):
        (tmp_path / f"{row:05d}_{steering}.jpg").write_bytes(image)
    printed = run("zoo.commands.check", ".")
    assert "3 rows, centre camera only" in printed
    assert "all images are whole" in printed


def test_the_track_and_the_perturbation_are_known(run: Run, tmp_path: Path) -> None:
    (tmp_path / "printed.py").write_text(
        "import gymnasium, zoo.simulator\n"
        "from zoo.scoring.robustness import perturbations_named\n"
        "print(gymnasium.spec('Oval-v0').kwargs['track'], *perturbations_named('all'))\n"
    )
    words = run("printed").split()
    assert words[0] == "oval"
    assert "aslant" in words


@pytest.mark.slow
def test_the_perturbation_is_driven_on_the_track(run: Run, tmp_path: Path) -> None:
    write_constant(tmp_path / "it.ckpt", 0.0)
    words = ["it.ckpt", "track=oval", "perturb=aslant", "laps=0.1", "out=a", "workers=1"]
    run("zoo.commands.evaluate", *words)
    perturbed = json.loads((tmp_path / "a" / "metrics.json").read_text())["perturbed"]
    assert [row["value"] for row in perturbed["aslant"]] == [-1.5, 0.0, 1.5]
