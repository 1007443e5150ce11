"""An object whose pickle runs code when it is loaded: it makes a folder, which a test looks for."""

import os
from pathlib import Path


class Bomb:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple:
        return os.mkdir, (str(self.path),)
