"""Text files of truth, a line a sample, written as the run goes: a kill loses none."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from clsim.events.filesink import naming_failures, unwritable
from clsim.truth.record import ImuChunk, TrackChunk


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
