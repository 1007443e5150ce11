"""Recordings of any length for the benchmarks, and configs for them."""

import datetime
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from zoo.cli.compose import compose_config

OUT = Path("outputs/bench")
LAKE = Path("outputs/recordings/lake")
CACHE = str(OUT / "cache")
DRAWN_ROWS = 400
AUGMENT = "augment=[brightness,shadow,shift]"


def pictures() -> dict[str, list[Path]]:
    """Return images by camera, from the lake that `drivezoo train` recorded, or drawn ones."""
    recorded = sorted(LAKE.glob("**/IMG"))
    folder = recorded[0] if recorded else OUT / "drawn" / "IMG"
    if not folder.is_dir():
        from tests.recordings import write_recording

        write_recording(OUT / "drawn", rows=DRAWN_ROWS)
    return {one: sorted(folder.glob(f"{one}_*.jpg")) for one in ("center", "left", "right")}


def linked_recording(rows: int, cameras: tuple[str, ...] = ("center", "left", "right")) -> Path:
    """Return a recording with a number of rows, whose images link to the same few files."""
    folder = OUT / f"{rows}-{len(cameras)}"
    log = folder / "driving_log.csv"
    if log.is_file():
        return folder
    (folder / "IMG").mkdir(parents=True, exist_ok=True)
    there, start = pictures(), datetime.datetime(2020, 1, 1)
    lines = []
    for row in range(rows):
        moment = start + datetime.timedelta(milliseconds=67 * row)
        stem = f"{moment:%Y_%m_%d_%H_%M_%S}_{moment.microsecond // 1000:03d}.jpg"
        names = []
        for camera in there:
            if camera not in cameras:
                names.append("")
                continue
            link = folder / "IMG" / f"{camera}_{stem}"
            link.unlink(missing_ok=True)
            # Hard links cost what a recording's own files cost; a symbolic link is followed first.
            link.hardlink_to(there[camera][row % len(there[camera])])
            names.append(f"IMG/{camera}_{stem}")
        steering = ((row * 37) % 101 - 50) / 100
        lines.append(",".join([*names, f"{steering:.2f}", "0.5", "0", "20.0"]))
    log.write_text("\n".join(lines) + "\n")
    return folder


def config_for(folder: Path, *overrides: str) -> DictConfig:
    """Return the config of `drivezoo train` without driving at the end."""
    ours = (f"data.root={folder}", f"data.cache={CACHE}", "score=none", *overrides)
    config = OmegaConf.create(compose_config(list(ours)))
    OmegaConf.set_struct(config, True)
    return config
