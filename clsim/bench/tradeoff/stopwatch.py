"""Time and memory of one piece of work."""

from __future__ import annotations

import time
from pathlib import Path
from types import TracebackType

_CLEAR_REFS = Path("/proc/self/clear_refs")
_STATUS = Path("/proc/self/status")
_RESET_PEAK = "5"


class Stopwatch:
    """Adds up the time spent inside ``with`` blocks.

    Attributes:
        wall_s: wall-clock time [s].
        cpu_s: processor time of all threads of this process [s].
    """

    def __init__(self) -> None:
        """Start at zero."""
        self.wall_s = 0.0
        self.cpu_s = 0.0
        self._started = (0.0, 0.0)

    def __enter__(self) -> Stopwatch:
        """Go on."""
        self._started = time.perf_counter(), time.process_time()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop."""
        cpu_s, wall_s = time.process_time(), time.perf_counter()
        self.wall_s += wall_s - self._started[0]
        self.cpu_s += cpu_s - self._started[1]


def reset_peak_memory() -> None:
    """Let ``peak_memory_bytes`` start anew, where the system can (Linux)."""
    try:
        _CLEAR_REFS.write_text(_RESET_PEAK)
    except OSError:
        return


def peak_memory_bytes() -> int | None:
    """Return the largest resident memory of this process since the last reset [bytes]; None where it is not told."""
    try:
        lines = _STATUS.read_text().splitlines()
    except OSError:
        return None
    found = [int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM:")]
    return found[0] if found else None
