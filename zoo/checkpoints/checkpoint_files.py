"""A run's checkpoint files, which survive a full disk and a moved run folder."""

import io
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path, PurePath
from typing import Any

import torch
from lightning import Callback
from lightning.fabric.plugins import TorchCheckpointIO
from lightning.pytorch.callbacks import EarlyStopping

from zoo.base.errors import InputError
from zoo.base.whole_file import write_whole


class CheckpointFiles(TorchCheckpointIO):
    """A replacement of Lightning's reader and writer of checkpoints.

    Lightning's own writer writes a file in /tmp and, when /tmp is another disk, copies it over the
    old checkpoint. A full disk then destroys both.

    Args:
        callbacks: callbacks of the trainer. The patience that they are given counts, not the
            saved patience, which Lightning would restore.
    """

    def __init__(self, callbacks: Sequence[Callback] = ()) -> None:
        super().__init__()
        self._patience = {
            callback.state_key: callback.patience
            for callback in callbacks
            if isinstance(callback, EarlyStopping)
        }

    def save_checkpoint(
        self, checkpoint: dict, path: str | Path, storage_options: object = None
    ) -> None:
        """Replace the file in one step; do not recreate a run's folder that was removed.

        Raises:
            OSError: the file cannot be written; the old file is kept.
        """
        path = Path(path)
        contents = io.BytesIO()
        torch.save(checkpoint, contents)
        path.parent.mkdir(exist_ok=True)
        write_whole(path, contents.getbuffer())

    def remove_checkpoint(self, path: str | Path) -> None:
        """Remove a checkpoint that is no longer among the best, unless Windows keeps it open."""
        with suppress(PermissionError):
            super().remove_checkpoint(path)

    def load_checkpoint(self, path: str | Path, *args: Any, **options: Any) -> dict:
        """Return a checkpoint, with its callbacks' paths changed to its present folder.

        Lightning saves absolute paths, and forgets the best score when they change. It also deletes
        the file that a callback's state names as the worst, once there is a better one.

        Raises:
            InputError: a path in a callback's state leads out of the checkpoint's folder.
        """
        checkpoint = super().load_checkpoint(path, *args, **options)
        for key, state in checkpoint.get("callbacks", {}).items():
            if key in self._patience:
                state["patience"] = self._patience[key]
            if before := isinstance(state, dict) and state.get("dirpath"):
                state.update(_moved(state, str(before), str(Path(path).parent)))
                _check_paths(state, Path(path))
        return checkpoint


def _check_paths(state: dict, path: Path) -> None:
    named = [value for key, value in state.items() if key.endswith("_model_path")]
    for file in [*named, *(state.get("best_k_models") or ())]:
        target = PurePath(str(file))
        if file and (".." in target.parts or not target.is_relative_to(path.parent)):
            raise InputError(
                f"{path}: a callback's state names {str(file)!r:.200}, outside its folder; start "
                f"a new run with model.weights={path}"
            )


def _moved(value: object, before: str, now: str) -> Any:
    r"""Return a value in which paths below the folder `before` lie below `now`.

    >>> _moved({"dirpath": "/a", "best_k_models": {"/a/best.ckpt": 1}}, "/a", "/b")
    {'dirpath': '/b', 'best_k_models': {'/b/best.ckpt': 1}}
    >>> _moved("C:\\a\\best.ckpt", "C:\\a", "D:\\b") == "D:\\b\\best.ckpt"
    True
    """
    if isinstance(value, dict):
        return {_moved(key, before, now): _moved(item, before, now) for key, item in value.items()}
    below = f"{before}/", f"{before}\\"
    if isinstance(value, str) and (value == before or value.startswith(below)):
        return now + value[len(before) :]
    return value
