"""`drivezoo list`: list networks, tracks, augmentations, losses, recipes and suites."""

import importlib.util
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from zoo.base.command import command
from zoo.base.command_keys import help_row
from zoo.base.conf_files import choice_files, choices
from zoo.base.console_progress import loading
from zoo.base.console_script import LISTED, written_docstring
from zoo.base.parts import part_of
from zoo.base.terminal import command_line, print_next, printable
from zoo.checkpoints.checkpoint_path import packaged_names, read_facts

if TYPE_CHECKING:
    from rich.table import Table

CHECKPOINTS = "checkpoints"  # networks that come trained
METRICS, MODELS = "metrics", "models"
# The choices are read at run time, where a type checker cannot follow.
Kind: TypeAlias = Literal[tuple(LISTED)]  # type: ignore[valid-type]
OWN = ("zoo", "datamodules")
_USAGE = re.compile(r"(@package|python -m|drivezoo|pip install) ")
_TARGET = re.compile(r"^\s*_target_: *(\S+)", re.MULTILINE)


@command(name="list")
def list_parts(*kind: Kind) -> None:
    """List networks, tracks, augmentations, losses, recipes and suites.

    Prints each choice with a description; `models` alone prints each network's input, parameters,
    multiply-adds and paper. `parts=my_net.py` adds your own.

    Args:
        *kind: models, augmentations, losses, optimizers, schedules, callbacks, recipes, tracks,
            roads, suites, checkpoints or metrics; all but metrics without it.
    """
    for name in kind or [name for name in LISTED if name != METRICS]:
        if name == METRICS:
            from zoo.driving.metrics import metrics_page

            print(metrics_page(), end="")
        elif name == CHECKPOINTS:
            print_checkpoints()
        elif name == MODELS and kind:
            print_models()
        else:
            group, typed = LISTED[name]
            print(f"{name}, {typed}")
            for choice, path in sorted(choice_files(group).items()):
                print(help_row(printable(choice), printable(description(path))))
            print()
    if not kind:
        print_next("drivezoo new model my_net", "write one of your own")


def print_models() -> None:
    """Print a table of the networks in `conf/model`, and the source of each."""
    from rich.console import Console

    console = Console(soft_wrap=True)
    table, sources = zoo_table()
    console.print(table)
    for name, source in sources.items():
        console.print(f"{name}: {source}", highlight=False)
    words = ["drivezoo", "train", "model=NAME", "data.root=FOLDER"]
    print_next(command_line(words), "train one", console)


def zoo_table() -> "tuple[Table, dict[str, str]]":
    """Return a table of the models in `conf/model`, and the source of each model."""
    from rich.table import Table

    from zoo.base.compose import compose_config

    sources = {}
    table = Table(title="the zoo", title_justify="left")
    for column in ("model", "input (CxHxW)", "colour", "parameters", "multiply-adds"):
        table.add_column(column, justify="right" if column[-1] == "s" else "left", overflow="fold")
    with loading("building the networks"):
        from zoo.models.make_network import make_network, multiply_adds, paper, published_view

        for name in choices("model"):
            config = compose_config([f"model={name}"])
            view = published_view(config)
            network = make_network(config["model"], view)
            height, width, channels = view.shape
            parameters = sum(parameter.numel() for parameter in network.parameters())
            operations = multiply_adds(network, (channels, height, width))
            size = f"{channels} x {height} x {width}"
            table.add_row(name, size, view.colour, f"{parameters:,}", f"{operations:,}")
            sources[name] = paper(network)
    return table, sources


def print_checkpoints() -> None:
    """Print the trained networks that come with drivezoo."""
    print(f"{CHECKPOINTS}, trained networks that come with drivezoo: {LISTED[CHECKPOINTS][1]}")
    for name in packaged_names():
        print(help_row(name, packaged_description(read_facts(name))))
    print()


def packaged_description(facts: Mapping[str, Any]) -> str:
    """Describe a trained network: its size, and its drives without an intervention."""
    text = f"{facts['network']}, {facts['parameters']:,} parameters"
    if drives := facts["drives"].get("lake"):
        text += f"; {drives['kept']} of {drives['drives']} laps of the lake without an intervention"
    return text


def description(path: Path) -> str:
    """Return the first sentence on a choice: of its YAML's comment, or its class's docstring."""
    text = path.read_text(encoding="utf-8")
    comment: list[str] = []
    for line in text.splitlines():
        if not line.startswith("# ") or (comment and _USAGE.match(line, 2)):
            break
        if not _USAGE.match(line, 2):
            comment.append(line[2:].strip())
    target = _TARGET.search(text)
    purpose = " ".join(comment) or (class_docstring(target[1]) if target else "")
    return re.split(r"(?<=\.) ", purpose, maxsplit=1)[0].rstrip(".")


def class_docstring(target: str) -> str:
    """Return the docstring of drivezoo's or a part's class, without importing it.

    Other packages' classes have none here: importing them takes seconds.
    """
    module, _, name = target.rpartition(".")
    part = part_of(target)
    if part is None and module.partition(".")[0] not in OWN:
        return ""
    file = part.file if part else None
    if file is None:
        spec = importlib.util.find_spec(module)
        file = Path((spec and spec.origin) or "")
    try:
        return " ".join(written_docstring(file, name).split())
    except (OSError, SyntaxError, ValueError):
        return ""


if __name__ == "__main__":
    list_parts.run()
