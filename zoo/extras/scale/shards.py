"""Shards of images that LitData writes, and a Parquet file of labels, in a folder or at an address.

A shard holds the images of neighbouring rows, those of all cameras. The recordings that were
converted stay apart, each with its rig.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from datamodules.driving_log import CAMERAS, BadRows
from datamodules.format_options import Converted, Progress, ReadOptions, WriteOptions
from datamodules.formats.parquet_columns import component, load_pyarrow, open_parquet, read_table
from datamodules.formats.recording_writer import left_out_note, reported
from datamodules.image import Stored, StoredImage, encode_image, find_fault
from datamodules.recording import TIMED_LABELS, Recording, indices, keep_valid, make_recording
from datamodules.stretches import complete_times, continuous_drives
from zoo.base.errors import InputError, optional_import
from zoo.base.new_folder import whole_folder
from zoo.base.plain_files import read_json
from zoo.base.rig import UDACITY, Rig
from zoo.base.rig_file import make_rig, rig_fields
from zoo.extras.scale.shard_store import EXTRA, INDEX, REMEDY, ShardStore, is_address

title = "shards"
keys = ("shard_mb",)  # of `WriteOptions`
LABELS = "labels.parquet"
RECORDING = "recording"  # number of the recording in `RIGS`, from 0
LINE = "line"  # number of the row in its source; a missing number is a missing row
MOST_RECORDINGS = 10_000
RIGS = "rigs.json"  # of each recording: contents of rig.yaml, `udacity`, or null if it is unknown


def detect(path: Path) -> bool:
    """Return whether a path is an address, or a folder with shards and labels."""
    return is_address(path) or ((path / INDEX).exists() and (path / LABELS).exists())


def read(path: Path, options: ReadOptions) -> Recording:
    """Return the rows; the images stay in their shards until they are needed.

    Raises:
        InputError: a file is missing or damaged, or a server does not answer.
    """
    cache = Path(options.cache).expanduser() if options.cache else None
    store = ShardStore(path, cache, int(options.cache_gb * 1e9))
    labels = store.fetch(LABELS)
    rigs = _read_rigs(store)
    numbered = {LINE} & set(open_parquet(labels, ()).schema_arrow.names)  # of earlier shards none
    columns = read_table(labels, [*TIMED_LABELS, *CAMERAS, RECORDING, *numbered])
    table = {name: component(column, labels, name) for name, column in columns.items()}
    counts = np.array(list(store.images.values()))
    files = [f"{store.source}/{name}" for name in store.images]
    ends = np.cumsum(counts)
    images = {}
    for camera in CAMERAS:
        number = indices(table[camera])
        if number.max(initial=-1) >= ends[-1]:
            raise InputError(f"{store.source}/{LABELS}: names images that no shard has; {REMEDY}")
        shard = np.searchsorted(ends, number, side="right")
        at = number - (ends - counts)[shard]
        images[camera] = [
            StoredImage(files[index], position, store) if is_known else None
            for index, position, is_known in zip(
                shard.tolist(), at.tolist(), (number >= 0).tolist(), strict=True
            )
        ]
    label = f"{store.source}/{LABELS}"
    recording = make_recording(
        path,
        {name: table[name] for name in TIMED_LABELS},
        images,
        places=np.array([f"{label}, row {row + 1}" for row in range(len(number))], object),
        recording=indices(table[RECORDING]),
        line=indices(table.get(LINE, np.arange(1, len(number) + 1))),
    )
    if not np.isin(recording.recording, range(len(rigs))).all():
        raise InputError(f"{label}: has rows of recordings that {RIGS} lacks; {REMEDY}")
    rig = rigs[0] if rigs.count(rigs[0]) == len(rigs) else None
    several = [f"{store.source}#{number + 1}" for number in range(len(rigs))]
    names = tuple(several) if len(rigs) > 1 else (store.source,)
    recording = replace(recording, names=names, rig=rig, rigs=rigs)
    bad, named = BadRows(options.on_bad_row), np.count_nonzero(recording.images.astype(bool))
    if named < ends[-1]:
        bad.notes.append(f"{ends[-1] - named:,} of {ends[-1]:,} images in the shards have no row")
    return keep_valid(recording, bad)


def write(recording: Recording, out: Path, options: WriteOptions, progress: Progress) -> Converted:
    """Write images as they are stored, in shards, and the labels, to the bit.

    Raises:
        InputError: LitData or pyarrow is missing, no image is whole, `out` exists, or the disk is
            full.
    """
    pyarrow = load_pyarrow()
    with optional_import(f"to=shards: needs LitData; {EXTRA}"):
        from litdata.streaming.writer import BinaryWriter
    item, count = np.full(recording.images.shape, -1), 0
    left_out = []
    with whole_folder(out) as part:
        writer = BinaryWriter(str(part), chunk_bytes=int(options.shard_mb * 1e6))
        for row in reported(range(len(recording)), progress):
            cameras = np.flatnonzero(recording.images[row]).tolist()
            try:
                stored = [
                    _encoded(recording.stored(row, camera), options.quality) for camera in cameras
                ]
            except (OSError, ValueError) as error:
                left_out.append(f"{recording.place(row)}: {error}")
                continue
            for camera, data in zip(cameras, stored, strict=True):
                writer.add_item(count, data)
                item[row, camera], count = count, count + 1
        if not count:
            raise InputError(f"no row has whole images: {left_out[0]}; copy the images again")
        writer.done()
        writer.merge()
        times = complete_times(recording)
        good = np.any(item >= 0, axis=1)
        kept = recording.keep(good)
        columns = {name: getattr(kept, name) for name in TIMED_LABELS} | {"time_s": times[good]}
        columns |= {camera: item[good, number] for number, camera in enumerate(CAMERAS)}
        columns |= {RECORDING: kept.recording, LINE: kept.line}
        pyarrow.parquet.write_table(pyarrow.table(columns), part / LABELS)
        rigs = [
            UDACITY.name if rig == UDACITY else rig and rig_fields(rig)
            for rig in recording.each_rig
        ]
        (part / RIGS).write_text(json.dumps(rigs, indent=2) + "\n", encoding="utf-8")
    notes = left_out_note(left_out, "their image is damaged")
    following = ("drivezoo", "train", f"data.root={out}")
    return Converted(out, len(kept), len(continuous_drives(kept)), tuple(notes), following)


def _read_rigs(store: ShardStore) -> tuple[Rig | None, ...]:
    rigs, label = read_json(store.fetch(RIGS)), f"{store.source}/{RIGS}"
    if not isinstance(rigs, list) or not 0 < len(rigs) <= MOST_RECORDINGS:
        raise InputError(f"{label}: is no list of 1 to {MOST_RECORDINGS:,} rigs; {REMEDY}")
    rigs = [UDACITY if rig == UDACITY.name else rig for rig in rigs]
    return tuple(rig if rig in (None, UDACITY) else make_rig(rig, label) for rig in rigs)


def _encoded(stored: Stored, quality: int) -> bytes:
    data = stored if isinstance(stored, bytes) else encode_image(stored, quality=quality)
    if fault := find_fault(data):
        raise ValueError(fault)
    return data
