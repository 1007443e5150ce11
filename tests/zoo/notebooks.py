"""Execution of the notebooks in this process."""

import json
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "notebooks"


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
