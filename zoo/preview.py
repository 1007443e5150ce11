"""`python -m zoo.preview [overrides]`: see what a network will be fed, before training it."""

import sys
from pathlib import Path

from zoo.cli.arguments import is_help
from zoo.cli.run_command import run_command

COUNT = 32
HELP = """usage: python -m zoo.preview [key=value...]

Writes outputs/preview/fed_batch.png, the first pictures of an epoch as the network would be fed
them, labels on them, and steering_histogram.png, the steering before and after balancing.

  data.root=FOLDER             your recording
  augment=[brightness,shadow]  and every other key of python -m zoo, whose --help lists them"""


def preview(arguments: list[str]) -> None:
    """Write `outputs/preview/fed_batch.png` and `steering_histogram.png` for the overrides."""
    if is_help(arguments):
        print(HELP)
        return
    from omegaconf import OmegaConf
    from rich.console import Console

    from zoo.callbacks.training_images import figure_of_fed_batch, figure_of_steering
    from zoo.cli.compose import compose_config, escape_interpolation, quote_paths
    from zoo.runs import plots
    from zoo.training.build import build_data, settle_config

    console = Console(soft_wrap=True)
    config = OmegaConf.create(escape_interpolation(compose_config(quote_paths(arguments))))
    data = build_data(settle_config(config, console))
    data.load(console)
    folder = Path("outputs/preview")
    for name, figure in (
        ("fed_batch", figure_of_fed_batch(data, COUNT)),
        ("steering_histogram", figure_of_steering(data)),
    ):
        path = plots.save_figure(figure, folder / f"{name}.png")
        console.print(str(path), highlight=False, markup=False)


if __name__ == "__main__":
    sys.exit(run_command("zoo.preview", preview, sys.argv[1:]))
