"""Execution of the notebooks in this process."""

import ast
import json
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "notebooks"


def run_notebook(name: str, **parameters: object) -> dict[str, object]:
    """Execute a notebook's code cells in this process; return its variables, and `shown`.

    `shown` holds the value of each cell's last line, which a notebook shows.

    Args:
        name: file name.
        **parameters: values that replace those of the cell tagged `parameters`.
    """
    cells = json.loads((FOLDER / name).read_text())["cells"]
    variables: dict[str, object] = {"__name__": "__main__"}
    shown: list[object] = []
    replaced = False
    for cell in cells:
        if cell["cell_type"] == "code":
            label, code = f"{name}, {cell['id']}", ast.parse("".join(cell["source"]))
            last = code.body.pop() if isinstance(code.body[-1], ast.Expr) else None
            exec(compile(code, label, "exec"), variables)
            if last:
                shown.append(eval(compile(ast.Expression(last.value), label, "eval"), variables))
            if "parameters" in cell["metadata"].get("tags", ()):
                assert set(parameters) <= set(variables)
                variables |= parameters
                replaced = True
    assert replaced
    return variables | {"shown": shown}
