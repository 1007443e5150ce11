"""The card that a checkpoint carries beside its weights, under the key `drivezoo`."""

from pathlib import Path

from zoo.runs.record_fields import Fields, Whole, check_fields


class Config(Fields):
    """The experiment's config."""

    model: dict[str, object]
    data: dict[str, object] | None = None


class View(Fields):
    """What the network is fed; `datamodules.view.View` checks the values."""

    crop: list[Whole]
    colour: str
    size: list[Whole] | None


class Data(Fields):
    """The recording's rows."""

    fingerprint: str | None = None
    rows: Whole | None = None


class Card(Fields):
    """What `zoo.checkpoints.checkpoint.make_card` returns."""

    config: Config
    view: View
    data: Data


def check_card(card: object, path: Path) -> None:
    """Raise InputError for the first field of a card that is wrong."""
    check_fields(Card, card, f"{path}: drivezoo")
