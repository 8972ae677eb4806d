"""Text files of truth, a line a sample, written as the run goes: a kill loses none."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.events.formats.filesink import naming_failures, unwritable
from clsim.truth.record import F64, ImuChunk, Times, TrackChunk

MAX_BYTES = 1 << 30
_LATEST_US = 1 << 62


class Lines:
    """A text file that grows by whole lines."""

    def __init__(self, path: Path, head: str = "") -> None:
        """Create the file with its first lines; raises InputError when it cannot be."""
        self._path = path
        try:
            self._file = path.open("w", encoding="utf-8")
            self._file.write(head)
            self._file.flush()
        except OSError as error:
            raise unwritable(path, error) from None

    def add(self, lines: Iterable[str]) -> None:
        """Append lines, without their ends; raises SinkError when the medium fails."""
        with naming_failures(self._path):
            self._file.write("".join(f"{line}\n" for line in lines))
            self._file.flush()

    def close(self) -> None:
        """Release the file; safe to call twice."""
        self._file.close()


def seconds(time_us: int) -> str:
    """Return a time in seconds, to the microsecond."""
    sign, whole = "-" if time_us < 0 else "", abs(time_us)
    return f"{sign}{whole // 1_000_000}.{whole % 1_000_000:06d}"


def tum_lines(chunk: TrackChunk) -> Iterable[str]:
    """Yield ``time_s x y z qx qy qz qw``, as the TUM format has it."""
    for time_us, pose in zip(chunk.times_us.tolist(), chunk.poses, strict=True):
        place, turn = pose[:3], pose[3:]
        yield " ".join([seconds(time_us), *(f"{v:.9g}" for v in place), *(f"{v:.12f}" for v in turn)])


def imu_lines(chunk: ImuChunk) -> Iterable[str]:
    """Yield ``time_s ax ay az gx gy gz`` [m/s², rad/s], as ECD has it."""
    samples = np.concatenate([chunk.acceleration, chunk.angular_velocity], axis=1)
    for time_us, sample in zip(chunk.times_us.tolist(), samples, strict=True):
        yield " ".join([seconds(time_us), *(f"{v:.9g}" for v in sample)])


def read_table(path: Path, columns: int) -> F64:
    """Read lines of that many numbers ``[n, columns]``; those that begin with ``#`` are skipped.

    Raises:
        ValueError: a line has other than so many numbers.
    """
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"{path} is larger than {MAX_BYTES >> 20} MiB")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that there are no lines
        table = np.loadtxt(path, np.float64, comments="#", ndmin=2)
    if table.size == 0:
        return np.zeros((0, columns))
    if table.shape[1] != columns:
        raise ValueError(f"{path} has {table.shape[1]} numbers a line, expected {columns}")
    return table


def held(dataset: Any, at: int | None = None) -> npt.NDArray[Any]:
    """Return all that a data set of HDF5 holds, or its row ``at``; a file may claim any size, however small it is.

    Raises:
        ValueError: it is more than a GiB.
    """
    size = dataset.nbytes if at is None else dataset.nbytes // max(len(dataset), 1)
    if size > MAX_BYTES:
        raise ValueError(f"{dataset.name} has {size} bytes, expected at most {MAX_BYTES}")
    found: npt.NDArray[Any] = dataset[:] if at is None else dataset[at]
    return found


def microseconds(seconds: npt.ArrayLike) -> Times:
    """Return whole µs of seconds ``[n]``.

    Raises:
        ValueError: one is not finite, or so large that no µs can be told.
    """
    times_us = np.rint(np.asarray(seconds, np.float64) * 1e6)
    if not (np.abs(times_us) < _LATEST_US).all():
        raise ValueError("a time is not finite or too late")
    return times_us.astype(np.int64)


def read_track(path: Path, name: str) -> TrackChunk:
    """Read poses as `tum_lines` writes them; velocities, which the format lacks, are NaN."""
    table = read_table(path, 8)
    return TrackChunk(name, microseconds(table[:, 0]), table[:, 1:], np.full((len(table), 6), np.nan))


def read_imu(path: Path) -> ImuChunk:
    """Read samples as `imu_lines` writes them."""
    table = read_table(path, 7)
    return ImuChunk(microseconds(table[:, 0]), table[:, 1:4], table[:, 4:])


def read_files(path: Path) -> dict[int, str]:
    """Read ``time_s file`` a line; returns the files by their times [µs].

    Raises:
        ValueError: a line is otherwise, or a file lies outside the folder.
    """
    found = {}
    for number, line in enumerate(path.read_text("utf-8-sig").splitlines(), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) != 2 or Path(words[1]).is_absolute() or ".." in Path(words[1]).parts:
            raise ValueError(f"{path}:{number}: got {line[:60]!r}, expected a time and a file beside")
        found[int(microseconds([float(words[0])])[0])] = words[1]
    return found


def rate_of(times_us: npt.ArrayLike) -> float:
    """Return the frames per second of these times; 30 where there are too few to tell."""
    steps = np.diff(np.asarray(times_us, np.int64))
    return 1e6 / float(np.median(steps)) if len(steps) and np.median(steps) > 0 else 30.0
