"""From requests of pixels to events on the wire; host side of sensor_readout.cl."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from clsim.opencl.workplace import Buffer, Grid, Workplace
from clsim.sensor.settings import Readout

Requests: TypeAlias = npt.NDArray[Any]
"""Events as pixels ask for them: t in ns, x, y, on, cause."""


class Pool:
    """What is not due yet."""

    def __init__(self, kind: np.dtype[Any]) -> None:
        """Hold nothing."""
        self._waiting: Requests = np.empty(0, dtype=kind)

    def pass_on(self, requests: Requests, end_ns: int) -> Requests:
        """Return what is due up to ``end_ns``, that of earlier calls first; hold the rest."""
        if len(self._waiting):
            requests = np.concatenate([self._waiting, requests])
        late = requests["t"] > end_ns
        if not late.any():
            self._waiting = requests[:0]
            return requests
        self._waiting = requests[late]
        return requests[~late]


class Bus:
    """A readout by the stages of `Readout`: requests, in the order of their times, become events or are lost."""

    def __init__(self, place: Workplace[Grid], settings: Readout) -> None:
        """Build what is on."""
        self._place, self._settings = place, settings
        self._serve = place.kernels("sensor_readout", ("serve",))[0] if settings.queues else None
        self._state = place.allocate((2,), np.int64)
        place.write(self._state, np.array([0, -1]))
        self._buffers: tuple[Buffer, ...] = ()
        self._waiting: Requests | None = None
        self._period, self._passed = -1, 0

    def run(self, requests: Requests, end_ns: int) -> tuple[Requests, int]:
        """Return what leaves the chip of requests up to ``end_ns``, sorted by time, and how many were lost.

        Times may lie after ``end_ns``. Nothing that a later call brings comes before what this one returns.
        """
        asked, settings = len(requests), self._settings
        if settings.scan_us > 0:
            requests, held = self._scanned(requests, end_ns)
            asked -= held
        if self._serve is not None and len(requests):
            requests = self._served(requests)
        if settings.most_in_period is not None:
            requests = self._controlled(requests)
        return requests, asked - len(requests)

    def _scanned(self, requests: Requests, end_ns: int) -> tuple[Requests, int]:
        """Return the events of the scans up to ``end_ns``, and how many more wait now than before.

        All columns are held and read at multiples of the period: one event of a pixel a scan, the first.
        """
        before = 0 if self._waiting is None else len(self._waiting)
        if self._waiting is not None:
            requests = np.concatenate([self._waiting, requests])
        period = round(self._settings.scan_us * 1e3)
        scans = -(-requests["t"] // period)
        done = scans * period <= end_ns
        self._waiting = requests[~done]
        requests, scans = requests[done], scans[done]
        # By scan, column, row and then time: the first of each pixel stays.
        order = np.lexsort((requests["t"], requests["y"], requests["x"], scans))
        requests, scans = requests[order], scans[order]
        again = np.zeros(len(requests), dtype=bool)
        again[1:] = scans[1:] == scans[:-1]
        for name in ("x", "y"):
            again[1:] &= requests[name][1:] == requests[name][:-1]
        read = requests[~again]
        read["t"] = scans[~again] * period
        return read, len(self._waiting) - before

    def _served(self, requests: Requests) -> Requests:
        place, settings, count = self._place, self._settings, len(requests)
        if not self._buffers or self._buffers[0].shape[0] < count:
            self._buffers = tuple(place.allocate((2 * count,), kind) for kind in (np.int64, np.uint16, np.int64))
        times, rows, out = self._buffers
        place.write(times, requests["t"])
        place.write(rows, requests["y"])
        most_ns = (1 << 62) if settings.most_wait_us is None else round(settings.most_wait_us * 1e3)
        place.launch(
            self._serve, (1,), times, rows, count, np.int64(round(settings.event_us * 1e3)),
            np.int64(round(settings.row_us * 1e3)), np.int64(most_ns), self._state, out,
        )  # fmt: skip
        served = place.read(out, np.empty(count, dtype=np.int64))
        kept = served >= 0
        requests = requests[kept]
        requests["t"] = served[kept]
        return requests

    def _controlled(self, requests: Requests) -> Requests:
        """Let the first so many of each period pass."""
        if not len(requests):
            return requests
        periods = requests["t"] // round(self._settings.control_period_us * 1e3)
        first = np.searchsorted(periods, periods)
        nth = np.arange(len(requests)) - first
        nth[periods == self._period] += self._passed
        most = self._settings.most_in_period
        assert most is not None, "only then is there a controller"
        kept = nth < most
        last = int(periods[-1])
        passed = int(np.count_nonzero(kept[first[-1] :]))
        self._passed = passed + (self._passed if last == self._period else 0)
        self._period = last
        return requests[kept]
