"""`drivezoo doubt`: write a policy that knows how much it doubts."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from zoo.base.command import command
from zoo.base.console_progress import loading
from zoo.base.errors import InputError
from zoo.base.output_files import checked_file
from zoo.base.terminal import print_written
from zoo.base.whole_file import write_output
from zoo.checkpoints.checkpoint_path import find_checkpoint, short_name
from zoo.runs.result_table import Column, Table, number_column
from zoo.runs.table_files import TableFiles

if TYPE_CHECKING:
    from zoo.extras.research.doubt_policy import DropoutPolicy, EnsemblePolicy

TABLE_COLUMNS = ("checkpoint", "network", "parameters", "sees")

# torch, a slow import, comes late: --help and typos answer at once.


@command(outputs=True)
def doubt(
    ckpt: str,
    *ckpts: str,
    out: str = "doubt.ckpt",
    samples: Annotated[int, Field(ge=2, le=100)] = 20,
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1,
    tables: TableFiles,
) -> Path:
    """Write a policy that knows how much it doubts.

    One checkpoint becomes Monte-Carlo dropout: its network runs under several dropout masks.
    Several become an ensemble. The steering is the mean, the spread its standard deviation. Every
    command that drives takes the file.

    Args:
        ckpt: checkpoint: a .ckpt file, a run's folder, or latest.
        *ckpts: further checkpoints.
        out: checkpoint to write.
        samples: number of dropout masks per frame; an ensemble does not use it.
        seed: random seed of the masks; an ensemble does not use it.
        tables: see `TableFiles`.

    Raises:
        InputError: a checkpoint cannot be used or is named twice, or a file cannot be written.
    """
    tables.check_files(TABLE_COLUMNS)
    paths = [find_checkpoint(name) for name in (ckpt, *ckpts)]
    with loading():
        from zoo.checkpoints.new_checkpoint import SUFFIX, checkpoint_bytes
        from zoo.extras.research.doubt_file import doubt_contents, read
        from zoo.scoring.evidence import next_drive

        written = [checked_file(out, (SUFFIX,), inputs=paths, into_folder=True)]
        contents = doubt_contents(paths, samples, seed)
        policy = read(contents, paths[0] if len(paths) == 1 else written[0])
        _check_distinct(paths, [member["state_dict"] for member in contents["members"]])
        write_output(written[0], checkpoint_bytes(contents))
    table = members_table(paths, policy)
    from rich.console import Console
    from rich.text import Text

    title = Text(f"{policy.name}: {policy.parameters:,} parameters")
    Console(emoji=False).print(table.printed(title=title, title_justify="left"))
    written += tables.write_files(table)
    following = ["evaluate", written[0], "track=lake"]
    print_written(written, next_drive(written[0], policy.data, following))
    return written[0]


def members_table(paths: Sequence[Path], policy: "DropoutPolicy | EnsemblePolicy") -> Table:
    """Return a row for each checkpoint: its file, its network, and the view that it sees."""
    members = policy.members
    names, files = [short_name(path) for path in paths], [str(path) for path in paths]
    views = {
        "width": [member.view.shape[1] for member in members],
        "height": [member.view.shape[0] for member in members],
        "colour": [member.view.colour for member in members],
    }
    sees = [f"{wide} x {high} {colour}" for wide, high, colour in zip(*views.values(), strict=True)]
    columns = [
        Column("checkpoint", "checkpoint", names, {"checkpoint": files}),
        Column("network", "network", [member.name for member in members]),
        number_column("parameters", "parameters", [m.parameters for m in members], "{:,}"),
        Column("sees", "sees", sees, views),
    ]
    return Table(columns, f"Networks of {policy.name}")


def _check_distinct(paths: Sequence[Path], states: Sequence[dict]) -> None:
    """Raise InputError for a network that is named twice, as the best and the last of a run."""
    bits = ((tensor.float().numpy().tobytes() for tensor in state.values()) for state in states)
    hashes = [hash(tuple(weights)) for weights in bits]
    for number, digest in enumerate(hashes):
        if digest in hashes[:number]:
            raise InputError(
                f"{paths[number]}: is the same network as {paths[hashes.index(digest)]}; name "
                "checkpoints of different training seeds"
            )


if __name__ == "__main__":
    doubt.run()
