"""`drivezoo preview`: draw the images that training feeds to a network."""

from typing import Any

from zoo.base.command import command
from zoo.base.console_progress import loading
from zoo.base.output_files import OUTPUTS, check_output
from zoo.base.terminal import command_line, print_next, print_written

NAMES = ("fed_batch", "steering_histogram")


@command(config=True)
def preview(*overrides: str) -> None:
    """Draw the images that training feeds to a network.

    Writes outputs/preview/fed_batch.png, the first images of an epoch with their labels, and
    outputs/preview/steering_histogram.png, the steering before and after balancing. Takes the keys
    of training, such as data.root=FOLDER and "augment=[brightness,shadow]": see drivezoo train
    --help.

    Args:
        *overrides: keys of a training.
    """
    from omegaconf import OmegaConf
    from rich.console import Console

    from datamodules.recording_format import check_roots
    from zoo.base.compose import compose_config, escape_interpolation, hydra_overrides

    console = Console(soft_wrap=True)
    written = [OUTPUTS / "preview" / f"{name}.png" for name in NAMES]
    for path in written:
        check_output(path, key="")
    config = OmegaConf.create(escape_interpolation(compose_config(hydra_overrides(overrides))))
    check_roots(config.data.get("root"))  # reports a wrong path before torch is imported
    with loading():
        from datamodules.driving import DrivingData
        from zoo.runs import plots
        from zoo.training.build import check_members, load_data
        from zoo.training.run_config import settle_config
        from zoo.training.training_images import FedBatch, figure_of_fed_batch, figure_of_steering
    data: Any = load_data(settle_config(config, console), console)
    check_members("data", data, DrivingData, ("sampler", "training_batches"))
    figures = figure_of_fed_batch(data, FedBatch().count), figure_of_steering(data)
    for path, figure in zip(written, figures, strict=True):
        plots.save_figure(figure, path)
    print_written(written, console=console)
    print_next(command_line(["drivezoo", "train", *overrides]), console=console)


if __name__ == "__main__":
    preview.run()
