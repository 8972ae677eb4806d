"""The manifest: a row for each sequence, told by what lies in the folder and by nothing else."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from clsim.datasets.job import Done, read_done, sequence_folder
from clsim.errors import InputError

MANIFEST = "manifest.parquet"
DATASET = "dataset.json"


def scan(out: Path) -> Iterator[Done]:
    """Yield what became of each sequence that is whole, in order."""
    folder = out / "sequences"
    for each in sorted(folder.iterdir()) if folder.is_dir() else ():
        if each.name.isdigit():
            done = read_done(each)
            if done is not None:
                yield done


def read_about(out: Path) -> dict[str, Any]:
    """Return what ``dataset.json`` tells: name, digest and parts; raises InputError where it is damaged."""
    path = out / DATASET
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise InputError(f"{path}: is damaged, expected what clsim dataset wrote")
    return found


def write_manifest(out: Path) -> Path:
    """Scan and write ``manifest.parquet``; returns where it is."""
    import pyarrow as arrow
    import pyarrow.parquet as parquet

    rows: list[dict[str, Any]] = []
    for done in scan(out):
        size = sum(size for size, _ in done.files.values())
        path = str(sequence_folder(Path(), done.index))
        told = {"index": done.index, "path": path, "split": done.split, "kept": done.kept, "job": done.job}
        rows.append(told | {"bytes": size, "rejected": list(done.rejected)} | done.figures | done.cost)
    names = sorted({name for row in rows for name in row})
    order: list[str] = [name for name in ("index", "path", "split", "kept", "job") if name in names]
    order += [name for name in names if name not in order]
    table = arrow.table({name: [row.get(name) for row in rows] for name in order})
    target, part = out / MANIFEST, out / f".{MANIFEST}.{os.getpid()}.part"
    parquet.write_table(table, part, compression="zstd")
    os.replace(part, target)
    return target


def read_manifest(out: Path) -> list[dict[str, Any]]:
    """Return the rows of a manifest; raises InputError where there is none."""
    import pyarrow.parquet as parquet

    path = out / MANIFEST
    if not path.is_file():
        raise InputError(f"{out}: holds no data set, for {MANIFEST} is missing")
    rows: list[dict[str, Any]] = parquet.read_table(path).to_pylist()
    return rows
