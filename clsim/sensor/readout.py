"""From requests of pixels to events on the wire; host side of readout.cl."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from clsim.opencl.workplace import Buffer, Grid, Workplace
from clsim.sensor.settings import Readout

Requests: TypeAlias = npt.NDArray[Any]
"""Events as pixels ask for them: t in ns, x, y, on, cause."""
_WAITS = -2
"""In place of a time, as readout.cl has it: of a request whose row's turn has not come."""


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
        layout = place.layout
        columns_ns = round(1e3 * settings.column_us) * layout.width
        self._scan_ns = max(round(1e3 * settings.scan_us), columns_ns)
        self._rows: tuple[Buffer, ...] = ()
        if not settings.queues:
            self._serve = None
        elif settings.arbiter == "rows":
            self._serve = place.kernels("sensor/readout", ("serve_rows",))[0]
            heads, tails, queue = (place.allocate((layout.height,), np.int32) for _ in range(3))
            place.fill(heads, -1)
            self._rows = place.allocate((layout.height * layout.width,), np.uint8), heads, tails, queue
        else:
            self._serve = place.kernels("sensor/readout", ("serve",))[0]
        self._state = place.allocate((2,), np.int64)
        self._buffers: tuple[Buffer, ...] = ()
        self.forget()

    def forget(self) -> None:
        """Know no request and no event any more: the bus is free, and what waits for it is gone."""
        self._place.write(self._state, np.array([0, -1]))
        self._for_scan: Requests | None = None
        self._for_row: Requests | None = None
        self._period, self._passed = -1, 0

    def run(self, requests: Requests, end_ns: int) -> tuple[Requests, int]:
        """Return what leaves the chip of requests up to ``end_ns``, sorted by time, and how many were lost.

        Times may lie after ``end_ns``. Nothing that a later call brings comes before what this one returns.
        """
        asked, settings = len(requests) + self._waiting, self._settings
        if settings.scan_us > 0:
            requests = self._scanned(requests, end_ns)
        if self._serve is not None:
            requests = self._served_rows(requests, end_ns) if self._rows else self._served(requests)
        if settings.most_in_period is not None:
            requests = self._controlled(requests)
        return requests, asked - self._waiting - len(requests)

    @property
    def _waiting(self) -> int:
        return sum(0 if each is None else len(each) for each in (self._for_scan, self._for_row))

    def _scanned(self, requests: Requests, end_ns: int) -> Requests:
        """Return the events of the scans up to ``end_ns``.

        All columns are held at multiples of the period, and read one after the other from then on: one event of a pixel
        a scan, the first.
        """
        if self._for_scan is not None:
            requests = np.concatenate([self._for_scan, requests])
        scans = -(-requests["t"] // self._scan_ns)
        done = scans * self._scan_ns <= end_ns
        self._for_scan = requests[~done]
        requests, scans = requests[done], scans[done]
        columns = self._place.layout.width - 1 - requests["x"].astype(np.int64)
        # By scan, column, row and then time: the first of each pixel stays.
        order = np.lexsort((requests["t"], requests["y"], columns, scans))
        requests, scans, columns = requests[order], scans[order], columns[order]
        again = np.zeros(len(requests), dtype=bool)
        again[1:] = scans[1:] == scans[:-1]
        for name in ("x", "y"):
            again[1:] &= requests[name][1:] == requests[name][:-1]
        read = requests[~again]
        read["t"] = scans[~again] * self._scan_ns + round(1e3 * self._settings.column_us) * columns[~again]
        return read

    def _served(self, requests: Requests) -> Requests:
        count = len(requests)
        if not count:
            return requests
        times, _, rows, out = self._buffers_for(requests)[:4]
        self._place.launch(self._serve, (1,), times, rows, count, *self._numbers, self._state, out)
        served = self._place.read(out, np.empty(count, dtype=np.int64))
        kept = served >= 0
        requests = requests[kept]
        requests["t"] = served[kept]
        return requests

    def _served_rows(self, requests: Requests, end_ns: int) -> Requests:
        """Return what is read of rows whose turn comes up to ``end_ns``."""
        if self._for_row is not None:
            requests = np.concatenate([self._for_row, requests])
        count = len(requests)
        if not count:
            return requests
        times, columns, rows, out, following = self._buffers_for(requests)
        self._place.launch(
            self._serve, (1,), times, columns, rows, count, self._place.layout.width, self._place.layout.height,
            *self._numbers, int(self._settings.row_stamps), np.int64(end_ns), self._state, *self._rows, following, out,
        )  # fmt: skip
        served = self._place.read(out, np.empty(count, dtype=np.int64))
        self._for_row = requests[served == _WAITS]
        kept = np.flatnonzero(served >= 0)
        kept = kept[np.argsort(served[kept], kind="stable")]
        requests = requests[kept]
        requests["t"] = served[kept]
        return requests

    @property
    def _numbers(self) -> tuple[np.int64, ...]:
        """Return the times of an event and of a row, and the longest wait [ns]."""
        settings = self._settings
        most_us = settings.most_wait_us
        most_ns = (1 << 62) if most_us is None else round(1e3 * most_us)
        return tuple(np.int64(each) for each in (round(1e3 * settings.event_us), round(1e3 * settings.row_us), most_ns))

    def _buffers_for(self, requests: Requests) -> tuple[Buffer, ...]:
        """Return memory with times, columns and rows of requests; two more for times and for numbers of requests."""
        count = len(requests)
        if not self._buffers or self._buffers[0].shape[0] < count:
            kinds = (np.int64, np.uint16, np.uint16, np.int64, np.int32)
            self._buffers = tuple(self._place.allocate((2 * count,), kind) for kind in kinds)
        for buffer, name in zip(self._buffers, ("t", "x", "y"), strict=False):
            self._place.write(buffer, np.ascontiguousarray(requests[name]))
        return self._buffers

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
