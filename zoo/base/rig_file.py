"""A car's rig by its name or in a file: `rig.yaml` beside a recording, or `data.rig=`."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from zoo.base.errors import InputError, hint
from zoo.base.plain_files import read_yaml
from zoo.base.rig import RIGS, Camera, Rig, centred, single_camera_rig

RIG_NAME = "rig.yaml"

Pixels = Annotated[int, Field(ge=8, le=8192)]
Angle = Annotated[float, Field(ge=-90, le=90)]
Coordinate = Annotated[float, Field(ge=0, le=8192)]
Corners = Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=3, max_length=100)]


class _Fields(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class CameraFields(_Fields):
    """The camera that looks ahead; see `zoo.base.rig.Camera`."""

    size: Annotated[list[Pixels], Field(min_length=2, max_length=2)]
    vertical_fov_deg: Annotated[float, Field(gt=1, lt=170)]
    up_m: Annotated[float, Field(gt=0, le=5)]
    ahead_m: Annotated[float, Field(ge=-10, le=10)] = 0.0
    right_m: Annotated[float, Field(ge=-5, le=5)] = 0.0
    pitch_down_deg: Angle = 0.0
    yaw_right_deg: Angle = 0.0
    roll_deg: Angle = 0.0
    own_car: Annotated[tuple[Corners, ...], Field(max_length=20)] = ()


class RigFields(_Fields):
    """A car.

    Attributes:
        steering_deg: angle of the front wheels at a steering of 1.
        side_m: distance of the left and of the right camera from the centre one; None without them.
    """

    name: Annotated[str, Field(max_length=80)] = "rig.yaml"
    camera: CameraFields
    wheelbase_m: Annotated[float, Field(gt=0, le=20)]
    steering_deg: Annotated[float, Field(gt=0, lt=90)]
    side_m: Annotated[float, Field(gt=0, le=5)] | None = None
    guesses: Annotated[list[str], Field(max_length=20)] = []


def named_rig(name: str) -> Rig:
    """Return the rig of a name, or of a file.

    Raises:
        InputError: there is neither, or see `read_rig`.
    """
    path = Path(name).expanduser()
    if path.exists():
        return read_rig(path)
    if name not in RIGS:
        write = f"{hint(name, RIGS)}, or describe the car: drivezoo new rig my_car"
        raise InputError(f"rig={name}: no such file, and no rig's name; {write}")
    return RIGS[name]


def read_rig(path: Path) -> Rig:
    """Return the rig in a file.

    Raises:
        InputError: the file is missing or damaged, or a number is impossible for a car.
    """
    return make_rig(read_yaml(path), path)


def make_rig(content: Any, path: object) -> Rig:
    """Return the rig of a file's contents; see `read_rig`."""
    try:
        fields = RigFields.model_validate(content)
    except ValidationError as error:
        faults = {".".join(map(str, fault["loc"])): fault for fault in error.errors()}
        if nulls := ", ".join(key for key, fault in faults.items() if fault["input"] is None):
            raise InputError(f"{path}: still null: {nulls}; fill them in") from None
        key, text = next((key or "the file", fault["msg"]) for key, fault in faults.items())
        raise InputError(f"{path}: {key}: {text.lower()}; correct it") from None
    width, height = fields.camera.size
    camera = Camera(**{**fields.camera.model_dump(), "size": (width, height)})
    rig = single_camera_rig(
        fields.name, camera, fields.wheelbase_m, fields.steering_deg, tuple(fields.guesses)
    )
    if aside_m := fields.side_m:
        for side, right_m in (("left", -aside_m), ("right", aside_m)):
            rig.cameras[side] = camera.changed(right_m=camera.right_m + right_m)
    return rig


def rig_fields(rig: Rig) -> dict[str, Any]:
    """Return the contents of a rig's file."""
    rig = centred(rig)
    centre, right = rig.cameras["center"], rig.cameras.get("right")
    return {
        "name": rig.name,
        "camera": asdict(centre),
        "wheelbase_m": rig.wheelbase_m,
        "steering_deg": rig.steering_deg,
        "side_m": right and right.right_m - centre.right_m,
        "guesses": rig.guesses,
    }


def write_rig(folder: Path, rig: Rig) -> None:
    """Write the rig's file beside a recording; JSON is YAML."""
    (folder / RIG_NAME).write_text(json.dumps(rig_fields(rig), indent=2) + "\n", encoding="utf-8")


def find_rig(folder: Path) -> Rig | None:
    """Return the rig of the file beside a recording, or None without one."""
    path = folder / RIG_NAME
    return read_rig(path) if path.exists() else None
