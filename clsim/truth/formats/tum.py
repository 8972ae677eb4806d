"""The TUM format of trajectories: ``time_s x y z qx qy qz qw`` a line, of the camera; evo reads it.

Source: Sturm et al., A Benchmark for the Evaluation of RGB-D SLAM Systems, IROS 2012.
"""

from __future__ import annotations

from pathlib import Path

from clsim.truth.record import About, Layout, TrackChunk
from clsim.truth.writing.lines import Lines, tum_lines

HEAD = "# time_s x y z qx qy qz qw: camera to world, m; the camera's +x is right, +y down, +z ahead (OpenCV)\n"


class TumLayout(Layout):
    """Writes the camera's poses and leaves out all else."""

    def __init__(self, path: Path, about: About) -> None:
        """Create the file; raises InputError when it cannot be."""
        self._lines = Lines(path, HEAD)

    def track(self, chunk: TrackChunk) -> None:
        """Append the camera's poses."""
        if chunk.name == "camera":
            self._lines.add(tum_lines(chunk))

    def close(self) -> None:
        """Complete the file."""
        self._lines.close()


def is_recording(path: Path) -> bool:
    """Tell that a trajectory is no recording: it has no events."""
    return False


def open_layout(path: Path, about: About) -> TumLayout:
    """Open a writer of the layout."""
    return TumLayout(path, about)
