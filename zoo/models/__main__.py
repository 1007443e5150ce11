"""`drivezoo models`: list the zoo's networks.

Prints each network's input, parameters, multiply-adds and paper.
"""

import sys

from rich.console import Console
from rich.table import Table

from zoo.cli.closing_lines import print_next
from zoo.cli.command import Command
from zoo.cli.compose import choices, compose_config
from zoo.cli.console_progress import loading
from zoo.cli.run_command import run_command

COMMAND = Command(__doc__)


def zoo_table() -> tuple[Table, dict[str, str]]:
    """Return a table of the models in `conf/model`, and the source of each model."""
    # torch, a slow import, comes late: --help answers at once.
    from zoo.models.make_network import make_network, published_view
    from zoo.models.network_facts import multiply_adds, paper

    sources = {}
    table = Table(title="the zoo", title_justify="left")
    for column in ("model", "input (CxHxW)", "colour", "parameters", "multiply-adds"):
        table.add_column(column, justify="right" if column[-1] == "s" else "left")
    for name in choices("model"):
        config = compose_config([f"model={name}"])
        view = published_view(config)
        network = make_network(config["model"], view)
        height, width, channels = view.shape
        parameters = sum(parameter.numel() for parameter in network.parameters())
        table.add_row(
            name,
            f"{channels} x {height} x {width}",
            view.colour,
            f"{parameters:,}",
            f"{multiply_adds(network, (channels, height, width)):,}",
        )
        sources[name] = paper(network)
    return table, sources


def print_zoo(arguments: list[str]) -> None:
    """Print the table and the sources."""
    COMMAND.split(arguments)
    with loading("building the networks"):
        table, sources = zoo_table()
    console = Console(soft_wrap=True)
    console.print(table)
    for name, source in sources.items():
        console.print(f"{name}: {source}", highlight=False)
    print_next("drivezoo train model=NAME data.root=FOLDER", "train one", console)


if __name__ == "__main__":
    sys.exit(run_command("zoo.models", print_zoo, sys.argv[1:]))
