"""The notebooks: they run from top to bottom with small values, and hold no outputs."""

import json
from pathlib import Path

import matplotlib as mpl
import pytest

from tests.recordings import Written
from tests.zoo.benchmark.test_benchmark_command import write_suite

FOLDER = Path(__file__).parents[1] / "notebooks"


def run_notebook(name: str, **parameters: object) -> dict[str, object]:
    """Execute a notebook's code cells in this process; return its variables.

    Args:
        name: file name.
        **parameters: values that replace those of the cell tagged `parameters`.
    """
    cells = json.loads((FOLDER / name).read_text())["cells"]
    variables: dict[str, object] = {"__name__": "__main__"}
    replaced = False
    for cell in cells:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"{name}, {cell['id']}", "exec"), variables)
            if "parameters" in cell["metadata"].get("tags", ()):
                assert set(parameters) <= set(variables)
                variables |= parameters
                replaced = True
    assert replaced
    return variables


@pytest.fixture(autouse=True)
def in_a_folder_without_display(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    mpl.use("Agg")


def test_the_quickstart_trains_and_drives(recorded: Written, tmp_path: Path) -> None:
    tiny = {"RECORDING": str(recorded.folder), "EPOCHS": 0, "LAPS": 0.01, "SEEDS": 1}
    found = run_notebook("quickstart.ipynb", **tiny)
    assert found["rows"][0]["drives"] == 1
    assert found["run"].checkpoint.is_file()
    assert (tmp_path / "driving.tex").read_text().count(r"\\") > 10


def test_the_study_compares_networks_and_resumes(recorded: Written, tmp_path: Path) -> None:
    tiny = {
        "RECORDING": str(recorded.folder),
        "MODELS": ["linear", "tiny"],
        "SEEDS": [1, 2],
        "EPOCHS": 0,
        "SUITE": str(write_suite(tmp_path)),
        "WORKERS": 1,
    }
    first, second = (run_notebook("study.ipynb", **tiny) for _ in range(2))
    assert [row["training seeds"] for row in first["rows"]] == [2, 2]
    assert second["rows"] == first["rows"]
    assert len(first["comparisons"]) == 1
    assert (tmp_path / "study" / "study.pdf").stat().st_size > 1000
    assert "linear & 15 & 2 &" in (tmp_path / "study" / "study.tex").read_text()


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.ipynb")), ids=lambda path: path.name)
def test_a_notebook_has_no_outputs(path: Path) -> None:
    for cell in json.loads(path.read_text())["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None
