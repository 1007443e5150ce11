"""Settings that every command which opens a world has."""

import pytest

from simulator.command_options import ClientOptions
from simulator.drive import DriveOptions
from simulator.record import RecordOptions
from zoo.base.command_keys import keys_of, read_options
from zoo.base.errors import InputError


@pytest.mark.parametrize("kind", [ClientOptions, DriveOptions, RecordOptions])
@pytest.mark.parametrize(
    ("typed", "direction"), [("forward", 1), ("1", 1), ("backward", -1), ("-1", -1)]
)
def test_a_direction_has_a_name_and_a_number(kind: type, typed: str, direction: int) -> None:
    options = read_options(kind, ["out=x"] * (kind is not ClientOptions) + [f"direction={typed}"])
    options.check()
    assert options.direction == direction
    assert "forward" in [key.typed for key in keys_of(kind) if key.name == "direction"]


def test_another_direction_is_refused() -> None:
    with pytest.raises(InputError, match="direction=up: must be forward or backward"):
        read_options(ClientOptions, ["direction=up"]).check()
