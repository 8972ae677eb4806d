"""Reading a data set: sequences, slices of them, and iterators for training.

Nothing here needs PyTorch; ``pytorch.py`` makes an `IterableDataset` of `Slices`.
"""

from __future__ import annotations

import os
import tarfile
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.datasets.job import sequence_folder
from clsim.datasets.manifest import scan
from clsim.errors import Error, InputError
from clsim.events import EventBatch, empty_batch
from clsim.values import read_fields, read_value

F32 = npt.NDArray[np.float32]


class Sequence:
    """One sequence in the layout ``h5``; close it, or use it in a ``with`` block.

    Attributes:
        width, height: of the sensor [pixels].
        end_us: time of the last event, or of the last frame of truth.
        frame_times_us: int64 ``[n]``, times of the frames of truth.
    """

    def __init__(self, path: str | Path) -> None:
        """Open a sequence's folder, or its ``events.h5``; raises InputError when it is none."""
        import h5py

        path = Path(read_value("path", path, str))
        if not os.path.exists(path):
            raise InputError(f"{path}: no such file or folder; expected a sequence of a data set")
        path = path / "events.h5" if path.is_dir() else path
        if path.with_name("sequence.dsec").is_dir() and not path.exists():
            raise InputError(
                f"{path.parent}: is in the layout dsec, which loaders of DSEC read; expected the layout h5"
            )
        try:
            self._file = h5py.File(path, "r")
            self._events = self._file["events"]
            self._t = self._events["t"]
            frames = self._file.get("frames")
            self.frame_times_us: npt.NDArray[np.int64] = np.asarray(frames["t"] if frames else [], np.int64)
            attributes = self._events.attrs
            self.width, self.height = int(attributes["width"]), int(attributes["height"])
        except (OSError, KeyError) as error:
            raise InputError(f"{path}: is no sequence of a data set ({str(error).splitlines()[0]})") from None
        self._frames = frames
        self._offset = int(self._file["t_offset"][()]) if "t_offset" in self._file else 0
        last = int(self._t[-1]) + self._offset if len(self._t) else 0
        self.end_us = max(last, int(self.frame_times_us[-1]) if len(self.frame_times_us) else 0)

    def __len__(self) -> int:
        """Return the number of events."""
        return len(self._t)

    def events(self, start_us: int = 0, end_us: int | None = None) -> EventBatch:
        """Return the events from ``start_us`` on and before ``end_us``; None is all.

        Raises InputError where the file's index of milliseconds leads astray.
        """
        from clsim.events.formats.tables.hdf5 import index_at

        self._check_open()
        first = index_at(self._file, read_value("start_us", start_us, int))
        last = len(self._t) if end_us is None else index_at(self._file, read_value("end_us", end_us, int))
        return self.events_at(first, last)

    def events_at(self, first: int, last: int) -> EventBatch:
        """Return events by their numbers, ``last`` not among them; raises InputError for one below 0."""
        self._check_open()
        first, last = read_value("first", first, int), read_value("last", last, int)
        if min(first, last) < 0:  # which h5py counts from the end
            raise InputError(f"`first` and `last` must be numbers of events from 0 on, got {first} and {last}")
        batch = empty_batch(max(0, min(last, len(self._t)) - first))
        for name, field in (("t", "t"), ("x", "x"), ("y", "y"), ("p", "on")):
            batch[field] = self._events[name][first : first + len(batch)]
        batch["t"] += self._offset
        return batch

    def truth(self, name: str, frame: int) -> npt.NDArray[Any]:
        """Return a plane of truth of a frame, such as ``depth`` ``[H, W]`` or ``flow`` ``[H, W, 2]``.

        Raises:
            InputError: the sequence has none of that name, or no such frame.
        """
        self._check_open()
        name, frame = read_value("name", name, str), read_value("frame", frame, int)
        if self._frames is None or name not in self._frames:
            held = sorted(self._frames) if self._frames is not None else []
            raise InputError(f"{self._file.filename}: has no truth {name!r}, but {', '.join(held) or 'none'}")
        count = len(self._frames[name])
        if not -count <= frame < count:
            raise InputError(f"{self._file.filename}: has {count} frames of truth, got frame {frame}")
        plane: npt.NDArray[Any] = self._frames[name][frame]
        return plane

    def _check_open(self) -> None:
        if not self._file:
            raise Error("the sequence is closed")

    def close(self) -> None:
        """Release the file."""
        self._file.close()

    def __enter__(self) -> Sequence:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Release the file."""
        self.close()


def voxel_grid(events: EventBatch, bins: int, height: int, width: int) -> F32:
    """Return a voxel grid of events ``[bins, height, width]``: ON is 1, OFF −1, shared by the two nearest bins.

    Zhu et al., "Unsupervised Event-Based Learning of Optical Flow, Depth, and Egomotion", CVPR 2019, equation 1; time
    goes from the first event to the last.
    """
    if bins < 1:
        raise InputError(f"`bins` must be at least 1, got {bins}")
    grid = np.zeros((bins, height, width), np.float32)
    if not len(events):
        return grid
    t = events["t"].astype(np.float64)
    first, last = t.min(), t.max()  # which need not be at the ends of what a program has put together
    place = (bins - 1) * (t - first) / max(last - first, 1.0)
    low = np.floor(place).astype(np.int64)
    sign = np.where(events["on"], 1.0, -1.0)
    for bin_, share in ((low, 1 - (place - low)), (low + 1, place - low)):
        inside = bin_ < bins
        np.add.at(grid, (bin_[inside], events["y"][inside], events["x"][inside]), (sign * share)[inside])
    return grid


@dataclass(frozen=True)
class Slices:
    """Slices of all sequences of a data set, in order or shuffled; iterate over it.

    Each is a dictionary: ``events``, ``sequence`` (its number), ``start_us``, ``end_us``, with ``bins`` also ``voxels``
    ``[bins, H, W]``, and for each name in ``truth`` that plane, of the frame that the slice begins at.

    Attributes:
        folder: of the data set, or of its WebDataset shards.
        split: part; "" is all.
        by: ``frames`` (from each frame of truth to the next), ``time`` or ``count``.
        step: length of a slice [µs], or number of events; not for frames.
        bins: of voxel grids; 0 makes none.
        truth: names of planes; for slices by frames.
        shuffle_seed: of the order of sequences; None keeps it.
        worker, workers: this reader's number, and of how many; each reads sequences of its own.
    """

    folder: str | Path
    split: str = ""
    by: str = "frames"
    step: int = 0
    bins: int = 0
    truth: tuple[str, ...] = ()
    shuffle_seed: int | None = None
    worker: int = 0
    workers: int = 1

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        read_fields(self)
        if self.by not in ("frames", "time", "count"):
            raise InputError(f"`by` must be frames, time or count, got {self.by!r}")
        if (self.by == "frames") != (self.step == 0) or self.step < 0:
            raise InputError(f"`step` must be above 0 for slices by time or count, and 0 by frames, got {self.step}")
        if self.truth and self.by != "frames":
            raise InputError("`truth` is for slices by frames")
        if min(self.bins, self.shuffle_seed or 0) < 0:
            raise InputError(f"`bins` and `shuffle_seed` must be 0 or more, got {self.bins} and {self.shuffle_seed}")
        if not 0 <= self.worker < self.workers:
            raise InputError(f"`worker` must be from 0 to below `workers`, got {self.worker} of {self.workers}")

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Yield the slices; raises InputError where there are no sequences."""
        worker, workers = _of_torch(self.worker, self.workers)
        folder = Path(self.folder)
        shards = sorted(shard for shard, split in _shards(folder) if self.split in ("", split))
        if shards:
            yield from self._of_shards(shards[worker::workers])
            return
        found = [done.index for done in scan(folder) if done.kept and self.split in ("", done.split)]
        if not found:
            raise InputError(_nothing(folder, self.split))
        if self.shuffle_seed is not None:
            np.random.default_rng(self.shuffle_seed).shuffle(found)
        for index in found[worker::workers]:
            with Sequence(sequence_folder(folder, index)) as sequence:
                yield from self._of(sequence, index)

    def _of_shards(self, shards: list[Path]) -> Iterator[dict[str, Any]]:
        if self.shuffle_seed is not None:
            np.random.default_rng(self.shuffle_seed).shuffle(shards)
        for shard in shards:
            with tarfile.open(shard) as tar, tempfile.TemporaryDirectory(prefix="clsim-shard-") as folder:
                for entry in tar:
                    stream = tar.extractfile(entry) if entry.name.endswith(".events.h5") else None
                    if stream is None:
                        continue
                    path = Path(folder) / "events.h5"
                    path.write_bytes(stream.read())
                    with Sequence(path) as sequence:
                        yield from self._of(sequence, int(entry.name.partition(".")[0]))

    def _of(self, sequence: Sequence, index: int) -> Iterator[dict[str, Any]]:
        if self.by == "count":
            for first in range(0, len(sequence) - self.step + 1, self.step):
                events = sequence.events_at(first, first + self.step)
                yield self._slice(sequence, index, events, int(events["t"][0]), int(events["t"][-1]), None)
            return
        times = sequence.frame_times_us
        if self.by == "time":
            times = np.arange(0, sequence.end_us + 1, self.step)
        for frame, (start_us, end_us) in enumerate(zip(times[:-1].tolist(), times[1:].tolist(), strict=True)):
            # Events at a slice's end are the next one's; at the sequence's end, no slice comes.
            events = sequence.events(start_us, None if end_us == sequence.end_us else end_us)
            yield self._slice(sequence, index, events, start_us, end_us, frame)

    def _slice(
        self, sequence: Sequence, index: int, events: EventBatch, start_us: int, end_us: int, frame: int | None
    ) -> dict[str, Any]:
        made: dict[str, Any] = {"events": events, "sequence": index, "start_us": start_us, "end_us": end_us}
        if self.bins:
            made["voxels"] = voxel_grid(events, self.bins, sequence.height, sequence.width)
        if frame is not None:
            made |= {name: sequence.truth(name, frame) for name in self.truth}
        return made


def _shards(folder: Path) -> Iterator[tuple[Path, str]]:
    """Yield the tars of a data set, and the part that each is of: ``train-000000.tar``."""
    for path in folder.glob("*-*.tar"):
        yield path, path.name.rpartition("-")[0]


def _nothing(folder: Path, split: str) -> str:
    """Return why there is nothing to read."""
    if not os.path.isdir(folder):
        return f"{folder}: no such folder"
    splits = {done.split for done in scan(folder) if done.kept}
    splits |= {split for _, split in _shards(folder)}
    known = ", ".join(sorted(splits - {""}))
    if not split or not splits:
        return f"{folder}: holds no sequences"
    return f"{folder}: holds no sequences of the split {split!r}, " + (f"but {known}" if known else "for it has none")


def _of_torch(worker: int, workers: int) -> tuple[int, int]:
    """Return this reader's number and of how many: within a worker of PyTorch's loader, that one's."""
    import sys

    data = sys.modules.get("torch.utils.data")
    info = data.get_worker_info() if data is not None else None
    return (worker, workers) if info is None else (worker * info.num_workers + info.id, workers * info.num_workers)
