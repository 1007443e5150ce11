"""Files of `drivezoo doubt` that are damaged, or ask for more than they hold."""

from pathlib import Path

import torch

from tests.hostile.crafted_files import contents_of
from tests.hostile.mutations import FEW_AND_MANY, read_damaged
from tests.hostile.test_damaged_networks import damaged_torch_files
from tests.refusals import refusal
from tests.zoo.written_checkpoints import write_constant
from zoo.checkpoints.checkpoint import load_plain
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.extras.research.doubt_file import build_doubt, detect, doubt_contents


@FEW_AND_MANY
def test_a_damaged_file_is_named(count: int, tmp_path: Path) -> None:
    members = [write_constant(tmp_path / f"{number}.ckpt", 0.1 * number) for number in (1, 2)]
    path = tmp_path / "x.ckpt"
    torch.save(doubt_contents(members, samples=2, seed=0), path)

    def read(path: Path) -> None:
        contents = load_plain(path)
        if detect(contents):
            build_doubt(contents, path)

    read_damaged(damaged_torch_files(path), read, path, count)


def test_members_that_share_their_weights_are_refused(tmp_path: Path) -> None:
    path = write_constant(tmp_path / "x.ckpt", 0.1)
    member = contents_of(path)
    doubt = {"drivezoo": {"format": 1, "doubt": {"samples": 2, "seed": 0}}, "members": [member] * 9}
    torch.save(doubt, path)
    assert "x.ckpt: member 2: has the weights of a member" in refusal(load_policy, path)
