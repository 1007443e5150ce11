"""The split of rows into train, validation and test."""

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from datamodules.driving_log import BadRows, read_fields
from datamodules.image import shard_of
from datamodules.recording import LOG_NAME, Recording, file_name
from zoo.base.errors import InputError
from zoo.base.file_text import csv_cell, csv_text
from zoo.base.whole_file import write_whole

PARTS = ("train", "val", "test")
KINDS = ("blocks", "random", "recording")
SHARE = 0.1  # of the rows, for validation, and for the test, where a user sets no other
REDEALS = 100
LEAST_SHARDS = 20  # with more, a shard is a block


@dataclass(frozen=True)
class Split:
    """Row numbers of each part, int64, ascending; rows in gaps are in no part."""

    train: np.ndarray
    val: np.ndarray
    test: np.ndarray


def split_rows(
    recording: Recording,
    kind: str = KINDS[0],
    val_share: float = SHARE,
    test_share: float = SHARE,
    block_s: float | None = None,
    gap_s: float | None = None,
    seed: int = 0,
) -> Split:
    """Deal rows to train, validation and test.

    Args:
        kind: `blocks`: contiguous blocks of `block_s`; `gap_s` of training rows next to another
            part are dropped, because neighbouring frames are near copies; `random`: single rows, as
            in the publications; `recording`: whole recordings; or the path of a CSV file of
            `image,part` rows, such as a run's `split.csv`.
        recording: recording to split.
        val_share: share of validation rows, 0..1.
        test_share: share of test rows, 0..1.
        block_s: length of a block, seconds; None for that of `recording.blocks`.
        gap_s: length of a gap, seconds; None for that of `recording.blocks`.
        seed: random seed of the split only: experiments with other training seeds have the same
            test rows.

    Raises:
        InputError: the kind is unknown, a share is beyond 0..1, or a part gets no row.
    """
    if min(val_share, test_share) < 0 or val_share + test_share >= 1:
        raise InputError(
            f"data.val_share={val_share} and data.test_share={test_share} leave nothing to train "
            "on; lower them"
        )
    shares = np.array([1 - val_share - test_share, val_share, test_share])
    rng = np.random.default_rng(seed)
    if kind == "blocks":
        part = _split_blocks(recording, shares, *block_rows(recording, block_s, gap_s), rng)
    elif kind == "random":
        part = _deal(np.ones(len(recording)), shares, rng)
    elif kind == "recording":
        part = _split_recordings(recording, shares, rng)
    elif Path(kind).exists():
        part = _read_split(recording, Path(kind))
    else:
        raise InputError(
            f"data.split={kind} is not one of {', '.join(KINDS)}, nor a file with image,part rows"
        )
    first: dict[str, int] = {}  # a repeated image's rows are all of one part
    images = enumerate(recording.images[:, 0])
    part = part[[first.setdefault(str(image or row), row) for row, image in images]]
    split = Split(*(np.flatnonzero(part == number) for number in range(3)))
    if not len(split.train):
        raise InputError(f"data.split={kind} leaves no rows to train on; record more driving")
    for name, share in (("val", val_share), ("test", test_share)):
        if share > 0 and not len(getattr(split, name)):
            raise InputError(
                f"data.split={kind} leaves no {name} rows of {len(recording)}; "
                f"record more driving, or set data.{name}_share=0 or data.split=random"
            )
    return split


def rows_per_second(recording: Recording) -> float:
    """Return rows of a time over the median time to the next; without times 15, the simulator's."""
    steps = np.diff(recording.time_s)
    forward = steps[steps > 0]  # a clock of whole seconds gives several rows each time
    return float((steps >= 0).sum() / len(forward) / np.median(forward)) if len(forward) else 15.0


def recording_rates(recording: Recording) -> list[float]:
    """Return the rows of a second in each of several recordings."""
    return list(map(rows_per_second, recording.recordings))


def block_rows(
    recording: Recording, block_s: float | None = None, gap_s: float | None = None
) -> tuple[list[int], list[int]]:
    """Return the rows of a block and of a gap in each of the recordings; see `split_rows`."""
    blocks, lengths, gaps = recording.blocks, [], []
    for rate in recording_rates(recording):
        wanted = rate * (blocks.block_s if block_s is None else block_s)
        # Blocks of a short recording are shorter, so that every part gets one.
        lengths.append(int(np.clip(wanted, 1, max(len(recording) // 20, 1))))
        gaps.append(min(round(rate * (blocks.gap_s if gap_s is None else gap_s)), lengths[-1]))
    return lengths, gaps


def shard_changes(recording: Recording) -> list[int]:
    """Return the rows at which another shard begins; none for few shards, or without any."""
    shards = [shard_of(image) for image in recording.images[:, 0]]
    changes = [row for row in range(1, len(shards)) if shards[row] != shards[row - 1]]
    return changes if shards[0] and len(changes) > LEAST_SHARDS else []


def split_words(
    recording: Recording, kind: str, block_s: float | None = None, gap_s: float | None = None
) -> str:
    """Return which split was chosen, and why."""
    if kind != "blocks":
        return kind
    rate = recording_rates(recording)[0]
    length, gap = (rows[0] / rate for rows in block_rows(recording, block_s, gap_s))
    if changes := shard_changes(recording):
        return f"blocks of a shard each, {len(changes) + 1:,}, with gaps of {gap:.2g} s"
    chosen = recording.blocks.why if block_s is None else "data.block_s, at most 1/20 of the rows"
    return f"blocks of {length:.3g} s with gaps of {gap:.2g} s ({chosen})"


def write_split(path: Path, recording: Recording, split: Split, resumed: bool = False) -> None:
    """Write `image,part` rows that `data.split=FILE` reads back.

    Raises:
        InputError: of a `resumed` run, the file holds another split, which its epochs had.
    """
    names = shortest_ends([str(image) for image in recording.images[:, 0]])
    rows = [(names[row], part) for part in PARTS for row in getattr(split, part)]
    text = csv_text([("image", "part"), *rows], line_end="\r\n").encode(errors="surrogateescape")
    if resumed and path.is_file() and path.read_bytes() != text:
        raise InputError(f"{path}: data.split gives other rows now; restore the file that it names")
    write_whole(path, text)


def shortest_ends(paths: list[str]) -> list[str]:
    r"""Return the shortest end of each path that no other has, of whole names; else all of it.

    >>> shortest_ends([r"a\IMG\1.jpg", "b/IMG/1.jpg", "b/IMG/2.jpg", "b/IMG/2.jpg"])
    ['a/IMG/1.jpg', 'b/IMG/1.jpg', '2.jpg', '2.jpg']
    """
    counts = Counter(end for path in set(paths) for end in _ends(path))
    return [next((end for end in _ends(path) if counts[end] == 1), path) for path in paths]


def _ends(path: str) -> list[str]:
    """Return the ends of a path of any system, from its file's name on."""
    names = [name.strip() for name in re.split(r"[\\/]", path)]
    return ["/".join(names[start:]) for start in reversed(range(len(names)))]


def _deal(sizes: np.ndarray, shares: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Deal blocks of `sizes` to parts, whose shares of the rows are near `shares`."""
    part = np.zeros(len(sizes), dtype=np.int64)
    order = rng.permutation(len(sizes))
    start = 0
    for number in (1, 2):
        wanted = shares[number] * sizes.sum()
        if wanted == 0:
            continue
        # The count nearest to the share, but one block at least for this and each later part.
        count = int(np.abs(np.cumsum(sizes[order[start:]]) - wanted).argmin()) + 1
        count = min(count, max(len(sizes) - start - (3 - number), 0))
        part[order[start : start + count]] = number
        start += count
    return part


def _split_blocks(
    recording: Recording,
    shares: np.ndarray,
    lengths: list[int],
    gaps: list[int],
    rng: np.random.Generator,
) -> np.ndarray:
    if changes := shard_changes(recording):  # so that validation reads few shards
        sizes = np.diff([0, *changes, len(recording)])
    else:
        counts = np.bincount(recording.recording, minlength=len(lengths)).tolist()
        pairs = zip(counts, lengths, strict=True)
        sizes = np.array([min(n, count - at) for count, n in pairs for at in range(0, count, n)])
    # With few blocks the gaps can remove a whole part: deal again.
    for _ in range(REDEALS):
        kept = without_gaps(np.repeat(_deal(sizes, shares, rng), sizes), recording.recording, gaps)
        if all((kept == number).any() for number in np.flatnonzero(shares > 0)):
            break
    return kept


def without_gaps(part: np.ndarray, recording: np.ndarray, gaps: list[int]) -> np.ndarray:
    """Return `part` with -1 for rows within its recording's gap of another part."""
    kept = part.copy()
    for border in np.flatnonzero(np.diff(part)) + 1:
        if recording[border - 1] != recording[border]:
            continue
        # Of two neighbours the larger part loses rows: train before val before test.
        loser = min(part[border - 1], part[border])
        gap = gaps[recording[border]]
        near = slice(max(border - gap, 0), border + gap)
        kept[near][(part[near] == loser) & (recording[near] == recording[border])] = -1
    return kept


def _split_recordings(
    recording: Recording, shares: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    needed = int((shares > 0).sum())
    if len(recording.names) < needed:
        raise InputError(
            f"data.split=recording needs {needed} recordings, data.root names "
            f"{len(recording.names)}; name more, or set data.split=blocks"
        )
    sizes = np.bincount(recording.recording, minlength=len(recording.names))
    return _deal(sizes, shares, rng)[recording.recording]


def _read_split(recording: Recording, path: Path) -> np.ndarray:
    images = [str(image) for image in recording.images[:, 0]]
    counts = Counter(csv_cell(end) for image in set(images) for end in _ends(image))
    parts: dict[str, str] = {}
    bad = BadRows()
    for line, fields in read_fields(path, bad):
        if len(fields) == 2 and fields[1] in PARTS:
            # The path may be of another machine, or of the same folder at another place.
            name = csv_cell(fields[0].replace("\\", "/"))
            name = name if counts[name] else csv_cell(file_name(fields[0]))
            if counts[name] > 1 and parts.get(name, fields[1]) != fields[1]:
                bad.faults.append(f"{path}, row {line}: several images are called {name:.80}")
            parts[name] = fields[1]
        elif fields != ["image", "part"]:
            bad.faults.append(
                f"{path}, row {line}: {','.join(fields)[:80]!a} is not image,part with a part of "
                f"{', '.join(PARTS)}"
            )
        if bad.faults:
            raise InputError(f"{bad.faults[0]}; correct the row")
    # The longest end that the file has is the image's own.
    ends = ([csv_cell(end) for end in reversed(_ends(image))] for image in images)
    dealt = [next((parts[end] for end in own if end in parts), None) for own in ends]
    if not any(dealt):
        raise InputError(
            f"{path}: names no image of this recording ({LOG_NAME} starts "
            f"with {file_name(images[0])}); name this recording's split, or set data.split=blocks"
        )
    return np.array([-1 if part is None else PARTS.index(part) for part in dealt])
