"""The reply to a telemetry: its event, its values as text, the row of the drive."""

from dataclasses import dataclass

from zoo.drives.drive_record import DriveRow

PUT_BACK = "put_back"  # key of a reply: speed of the car that is put back on the centre


@dataclass(frozen=True)
class Reply:
    """Reply to a telemetry.

    Attributes:
        event: name of the event to send.
        values: argument of the event.
        row: row of the drive.
        image: image to record, as the client sent it; None to record none.
    """

    event: str
    values: dict[str, str]
    row: DriveRow
    image: bytes | None = None


def reply_values(steering: float, throttle: float, decimal: str) -> dict[str, str]:
    """Return the argument of a `steer` event, with the client's own decimal sign.

    >>> reply_values(0.05, 0.2, ",")
    {'steering_angle': '0,0500', 'throttle': '0,2000'}
    """
    pair = {"steering_angle": steering, "throttle": throttle}
    return {name: number_text(value, decimal) for name, value in pair.items()}


def number_text(value: float, decimal: str) -> str:
    """Return a number with four decimals and the client's decimal sign."""
    return f"{value:.4f}".replace(".", decimal)
