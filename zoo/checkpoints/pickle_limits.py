"""Check the pickle of a torch file before torch reads it: its classes, its length and its values.

Torch's own reader runs no code of the file. But it calls what it knows with any arguments, such as
`bytearray(8_000_000_000)`, and takes minutes for tuples that share their parts.
"""

import io
import pickle
import pickletools

from zoo.base.limits import MOST

MOST_BYTES = 4_000_000  # of the pickle alone; VGG16's with its optimizer has 30,000
MOST_STEPS = 400_000
# Besides torch's types and storages, which are looked up in torch.
KNOWN = (
    "collections OrderedDict",
    "torch._utils _rebuild_tensor",
    "torch._utils _rebuild_tensor_v2",
    "torch._utils _rebuild_tensor_v3",
    "torch._utils _rebuild_sparse_tensor",
    "torch.serialization _get_layout",
    "torch._utils _rebuild_parameter",
    "torch.nn.parameter Parameter",
    "torch Size",
    "torch device",
    "_codecs encode",
    "__builtin__ set",
    "builtins set",
)
_MARK = object()


def check_pickles(data: bytes, count: int) -> None:
    """Check the pickles at the beginning of some bytes.

    Args:
        data: bytes; a pickle that does not end in them is too long.
        count: number of pickles.

    Raises:
        pickle.UnpicklingError: a pickle names a class or function that no checkpoint needs.
        ValueError: a pickle is damaged, too long, or has too many values.
    """
    stream = io.BytesIO(data)
    for _ in range(count):
        _check_pickle(stream)


def _check_pickle(stream: io.BytesIO) -> None:
    """Follow a pickle's steps with the number of values in place of each value.

    Lists and dicts count as when they were kept for later use, since they are changed afterwards;
    their contents are counted once they are read.
    """
    stack: list = []
    kept: dict = {}
    for number, (step, argument, _) in enumerate(pickletools.genops(stream)):
        if number > MOST_STEPS:
            raise ValueError(f"more than {MOST_STEPS:,} steps")
        if step.name in ("GLOBAL", "INST") and not _is_known(str(argument)):
            raise pickle.UnpicklingError(argument)
        if step.name in ("PUT", "BINPUT", "LONG_BINPUT"):
            kept[argument] = stack[-1]
            continue
        values = 1
        if step.name in ("GET", "BINGET", "LONG_BINGET"):
            values = kept[argument]
        before = list(step.stack_before)
        if pickletools.markobject in before:
            while (top := stack.pop()) is not _MARK:
                values += top
            before = before[: before.index(pickletools.markobject)]
        values += sum(stack.pop() for _ in before)
        if values > MOST["values"]:
            raise ValueError(f"more than {MOST['values']:,} values")
        stack += [_MARK if kind is pickletools.markobject else values for kind in step.stack_after]


def _is_known(name: str) -> bool:
    import torch

    module, _, kind = name.partition(" ")
    if module == "torch" and isinstance(getattr(torch, kind, None), torch.dtype):
        return True
    return name in KNOWN or (module.startswith("torch") and kind.endswith("Storage"))
