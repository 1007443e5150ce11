"""An object whose pickle runs code when loaded: it creates a folder, which tests look for."""

import os
from pathlib import Path


class Bomb:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple:
        return os.mkdir, (str(self.path),)
