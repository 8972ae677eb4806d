"""Shards: sequences packed for training, WebDataset tars or Parquet tables of events."""

from __future__ import annotations

import io
import json
import os
import tarfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from clsim.datasets.job import Done, sequence_folder
from clsim.datasets.manifest import scan
from clsim.errors import InputError

KINDS = ("webdataset", "parquet")
SHARD_BYTES = 1 << 30


def check_shards(kind: str | None) -> None:
    """Raise InputError for a kind of shards that there is not."""
    if kind is not None and kind not in KINDS:
        raise InputError(f"`shards` must be one of {', '.join(KINDS)}, got {kind!r}")


def write_shards(out: Path, kind: str, size: int = SHARD_BYTES) -> list[Path]:
    """Pack all kept sequences of a data set, part by part, into files of about ``size`` bytes; returns them.

    ``webdataset``: ``shards/train-000000.tar`` …, in which the files of sequence 12 are ``000012.events.h5``,
    ``000012.json`` … ``parquet``: ``shards/train-000000.parquet`` …, tables of sequence, t [µs], x, y, p.
    """
    check_shards(kind)
    folder = out / "shards"
    folder.mkdir(exist_ok=True)
    written: list[Path] = []
    parts: dict[str, list[Done]] = {}
    for done in scan(out):
        if done.kept:
            parts.setdefault(done.split or "all", []).append(done)
    pack = _tar if kind == "webdataset" else _table
    for part, sequences in sorted(parts.items()):
        for number, group in enumerate(_groups(sequences, size)):
            path = folder / f"{part}-{number:06d}.{'tar' if kind == 'webdataset' else 'parquet'}"
            hidden = path.with_name(f".{path.name}.{os.getpid()}.part")
            pack(out, group, hidden)
            os.replace(hidden, path)
            written.append(path)
    return written


def _groups(sequences: list[Done], size: int) -> Iterator[list[Done]]:
    group: list[Done] = []
    held = 0
    for done in sequences:
        own = sum(size for size, _ in done.files.values())
        if group and held + own > size:
            yield group
            group, held = [], 0
        group.append(done)
        held += own
    if group:
        yield group


def _tar(out: Path, group: list[Done], path: Path) -> None:
    with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as tar:
        for done in group:
            folder = sequence_folder(out, done.index)
            for name in sorted(done.files):
                # In WebDataset, a sample is what has one name up to the first point.
                with (folder / name).open("rb") as stream:
                    _add(tar, f"{done.index:06d}.{name.replace('/', '.')}", done.files[name][0], stream)
            told = {key: each for key, each in asdict(done).items() if key not in ("cost", "files")}
            text = json.dumps(told, sort_keys=True).encode()
            _add(tar, f"{done.index:06d}.json", len(text), io.BytesIO(text))


def _add(tar: tarfile.TarFile, name: str, size: int, stream: Any) -> None:
    entry = tarfile.TarInfo(name)  # without owner and time of day: the same sequences give the same bytes
    entry.size = size
    tar.addfile(entry, stream)


def _table(out: Path, group: list[Done], path: Path) -> None:
    import numpy as np
    import pyarrow as arrow
    import pyarrow.parquet as parquet

    from clsim.datasets.load import Sequence

    types = {
        "sequence": arrow.int32(),
        "t": arrow.int64(),
        "x": arrow.uint16(),
        "y": arrow.uint16(),
        "p": arrow.bool_(),
    }
    schema = arrow.schema(list(types.items()))
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for done in group:
            with Sequence(sequence_folder(out, done.index)) as sequence:
                events = sequence.events()
            columns = [np.full(len(events), done.index, np.int32)]
            columns += [np.ascontiguousarray(events[name]) for name in ("t", "x", "y", "on")]
            writer.write_table(arrow.table(columns, schema=schema))
