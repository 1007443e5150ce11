"""A run's checkpoint files: written whole or not at all, read wherever the folder was moved to."""

import io
from pathlib import Path, PurePath
from typing import Any

import torch
from lightning.fabric.plugins import TorchCheckpointIO

from datamodules.errors import InputError
from zoo.runs.whole_file import write_whole


class CheckpointFiles(TorchCheckpointIO):
    """What Lightning writes and reads checkpoints with.

    Lightning's own writes a temporary file in /tmp and copies that over the old checkpoint where
    /tmp is another disk: a full disk then destroys both.
    """

    def save_checkpoint(
        self, checkpoint: dict, path: str | Path, storage_options: object = None
    ) -> None:
        """Replace the file at once; a run's folder that was removed is not created again.

        Raises:
            OSError: cannot write it; the file that was there before is kept.
        """
        path = Path(path)
        contents = io.BytesIO()
        torch.save(checkpoint, contents)
        path.parent.mkdir(exist_ok=True)
        write_whole(path, contents.getbuffer())

    def load_checkpoint(self, path: str | Path, *args: Any, **more: Any) -> dict:
        """Read a checkpoint; the paths in its callbacks' states are those of its folder now.

        Lightning keeps absolute paths, and forgets the best score where they have changed. It also
        removes the file that a state calls the worst, when there is a better one.

        Raises:
            InputError: a path in a callback's state leads out of the checkpoint's folder.
        """
        checkpoint = super().load_checkpoint(path, *args, **more)
        now = str(Path(path).parent)
        for state in checkpoint.get("callbacks", {}).values():
            before = state.get("dirpath") if isinstance(state, dict) else None
            if before:
                state.update(_moved(state, str(before), now))
                _check_paths(state, Path(path))
        return checkpoint


def _check_paths(state: dict, path: Path) -> None:
    named = [value for key, value in state.items() if key.endswith("_model_path")]
    for one in [*named, *(state.get("best_k_models") or ())]:
        place = PurePath(str(one))
        if one and (".." in place.parts or not place.is_relative_to(path.parent)):
            raise InputError(
                f"{path}: a callback's state names {str(one)!r:.200}, outside of its folder; start "
                f"a new run with model.weights={path}"
            )


def _moved(value: object, before: str, now: str) -> object:
    """Return the value with `before`, where a path in it begins so, replaced by `now`.

    >>> _moved({"dirpath": "/a", "best_k_models": {"/a/best.ckpt": 1}}, "/a", "/b")
    {'dirpath': '/b', 'best_k_models': {'/b/best.ckpt': 1}}
    """
    if isinstance(value, dict):
        return {_moved(key, before, now): _moved(one, before, now) for key, one in value.items()}
    if isinstance(value, str) and (value == before or value.startswith(f"{before}/")):
        return now + value[len(before) :]
    return value
