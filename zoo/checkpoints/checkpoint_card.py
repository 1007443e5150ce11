"""The typed card that a checkpoint holds under the key `drivezoo`, besides its weights."""

from pathlib import Path

from zoo.runs.record_fields import Fields, Number, Whole, check_fields


class Config(Fields):
    """The experiment's config."""

    model: dict[str, object]
    data: dict[str, object] | None = None


class View(Fields):
    """The network's view; `datamodules.view.View` checks the values."""

    crop: list[Whole]
    colour: str
    size: list[Whole] | None
    resize: str


class Data(Fields):
    """The recording's rows."""

    fingerprint: str | None = None
    rows: Whole | None = None
    rows_per_s: Number | None = None
    speed_mph: Number | None = None
    source: str | None = None  # format that it was converted from; None for Udacity's rig


class Part(Fields):
    """A part of the user's that the config names, see `zoo.checkpoints.part_card`."""

    module: str
    name: str
    sha256: str


class Card(Fields):
    """A card, as `zoo.checkpoints.checkpoint.make_card` returns it."""

    config: Config
    view: View
    data: Data
    parts: list[Part] | None = None  # only where there are some


def check_card(card: object, path: Path) -> None:
    """Raise InputError for the first wrong field of a card."""
    check_fields(Card, card, f"{path}: drivezoo")
