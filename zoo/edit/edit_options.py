"""Options of `drivezoo edit`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field


@dataclass(frozen=True, kw_only=True)
class EditOptions:
    """Options of the command; `conf/edit.yaml` has their meanings and defaults."""

    ckpt: str | None
    images: str | None
    drop: str | None
    keep: str | None
    mirror: str | None
    split: str | None
    out: Path | None
    page: bool
    port: Annotated[int, Field(ge=0, le=65535)]
