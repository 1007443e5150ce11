"""`drivezoo new`: write a part of your own (class, YAML file, test), a rig or a notebook."""

from pathlib import Path

from zoo.base.command import command
from zoo.base.terminal import print_next, print_written


@command
def new(kind: str, name: str) -> None:
    """Write a part of your own (class, YAML file, test), a rig or a notebook.

    Writes them from a template into the current folder, which needs no checkout of drivezoo, and
    prints what to type next.

    Args:
        kind: model, augmentation, loss, callback, metric, perturbation, track, rig (camera and car
            of a recording, to fill in), donkeycar (the pilot of a Donkeycar), notebook (train a
            network and let it drive) or study (a notebook that compares networks).
        name: name in small letters, such as my_net.

    Raises:
        InputError: see `zoo.new.part_files.write_part`.
    """
    from zoo.new.part_files import write_part

    written, following = write_part(kind, name, Path())
    print_written(written)
    for line, purpose in following:
        print_next(line, purpose)


if __name__ == "__main__":
    new.run()
