"""A user's own network in a folder outside the checkout."""

from pathlib import Path

NETWORK = '''"""Steering from the mean of each column."""

from torch import Tensor, nn


class MyNet(nn.Module):
    """A linear network."""

    takes_speed = False
    outputs = 1

    def __init__(self, shape: tuple[int, int, int], bias: bool = True) -> None:
        super().__init__()
        self.head = nn.Linear(shape[0] * shape[2], 1, bias)

    def forward(self, images: Tensor) -> Tensor:
        return self.head((images / 255).mean(2).flatten(1))
'''
YAML = """# drivezoo train parts=my_net.py model=my_net data.root=FOLDER
name: my_net
colour: gray
size: [16, 32]
weights: null
_target_: my_net.MyNet
bias: true
"""


def write_network(folder: Path, code: str = NETWORK) -> Path:
    """Write `my_net.py` and `conf/model/my_net.yaml`, and return the file of code."""
    (folder / "conf" / "model").mkdir(parents=True, exist_ok=True)
    (folder / "conf" / "model" / "my_net.yaml").write_text(YAML)
    (folder / "my_net.py").write_text(code)
    return folder / "my_net.py"
