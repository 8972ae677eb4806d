"""``udp://HOST:PORT``: events in datagrams, for whoever listens there."""

from __future__ import annotations

import socket
import threading
import time
from collections import deque

from clsim.errors import InputError
from clsim.events.batch import EventBatch, SinkError
from clsim.events.sockets.address import Address, exposure_warning, parse_address, resolve, unusable
from clsim.events.sockets.closing import BRIEF_FLUSH_S, CLOSE_TIMEOUT_S
from clsim.events.sockets.udp_layouts import LAYOUTS

QUEUE_BYTES = 16 << 20
# A receiver's socket holds some 90 datagrams by default and the system drops what is over without a word, so bursts are
# followed by pauses in which a receiver, be it in Python, can empty it. Where much waits the pauses are short.
_BURST = 16
_PAUSE_S = 0.002
_SHORT_PAUSE_S = 0.0002
_SHORT_PAUSE_BYTES = QUEUE_BYTES // 4
_EVENTS_PER_CHUNK = 65_536


class UdpSink:
    """Sends to ``udp://HOST:PORT?format=t64|t32|spif``.

    A thread of its own sends in small bursts, so that ``write`` never waits: some 0.7 million events per second, and up
    to 5 when the queue fills. What the queue or the system has no room for is dropped and counted; what the network or
    the receiver loses, nobody knows.
    """

    def __init__(self, address: Address | str, width: int, height: int) -> None:
        """Prepare to send; no receiver need be there.

        Raises:
            InputError: the address is malformed or unreachable, or the sensor is too large for the layout.
        """
        if isinstance(address, str):
            address = parse_address(address)
        address.allow(format=tuple(LAYOUTS))
        if address.port == 0:
            raise InputError(f"{address.text}: the port is 0; expected the port a receiver listens at")
        self._text = address.text
        self._layout = LAYOUTS[address.options.get("format", "t64")]
        side = self._layout.max_side
        if not (0 < width <= side and 0 < height <= side):
            raise InputError(f"{address.text}: a sensor of {width}x{height} does not fit 1x1 … {side}x{side}")
        self._width, self._height = width, height
        family, self._target = resolve(address)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            with socket.socket(family, socket.SOCK_DGRAM) as probe:
                probe.connect(self._target)  # sends nothing, but fails where there is no way
        except OSError as error:
            self._socket.close()
            raise unusable(address, error, "an address that can be reached") from None
        self._socket.setblocking(False)
        self.warning = exposure_warning(address, self._target)
        """A sentence for the user, if the address is on another machine."""
        self.dropped_packets = 0
        self.dropped_events = 0
        self._queue: deque[bytes] = deque()
        self._queued_bytes = 0
        self._changed = threading.Condition()
        self._closing_at_s: float | None = None
        self._thread = threading.Thread(target=self._run, name="clsim-udp", daemon=True)
        self._thread.start()

    def write(self, events: EventBatch, end_us: int) -> None:
        """Queue the events; never waits. Datagrams have no word for silence.

        Raises:
            InputError: a time is negative, or an event lies outside the sensor.
        """
        if self._closing_at_s is not None:
            raise SinkError(f"{self._text}: cannot be written any more; it was closed before")
        if len(events):
            self._check(events)
        for start in range(0, len(events), _EVENTS_PER_CHUNK):
            data = self._layout.pack(events[start : start + _EVENTS_PER_CHUNK])
            with self._changed:
                self._queue.append(data)
                self._queued_bytes += len(data)
                while self._queued_bytes > QUEUE_BYTES:
                    self._take(drop=True)
                self._changed.notify()

    def report(self) -> dict[str, float]:
        """Return how many events there was no room for."""
        return {"dropped_events": self.dropped_events}

    @property
    def queued_bytes(self) -> int:
        """How much waits to be sent."""
        return self._queued_bytes

    def close(self) -> None:
        """Send what waits, which a full queue makes a second or two; what is left after 30 s counts as dropped."""
        self._begin_to_close(CLOSE_TIMEOUT_S)
        self._thread.join()

    def flush_briefly(self) -> None:
        """Begin to close, and have that last no longer than 0.3 s."""
        self._begin_to_close(BRIEF_FLUSH_S)

    def _begin_to_close(self, timeout_s: float) -> None:
        with self._changed:
            end_s = time.monotonic() + timeout_s
            self._closing_at_s = end_s if self._closing_at_s is None else min(self._closing_at_s, end_s)
            self._changed.notify()

    def _check(self, batch: EventBatch) -> None:
        if batch["t"][0] < 0:
            raise InputError(f"{self._text}: event time {batch['t'][0]} µs is negative; expected 0 or later")
        for name, limit in (("x", self._width), ("y", self._height)):
            largest = int(batch[name].max())
            if largest >= limit:
                raise InputError(f"{self._text}: an event has {name} = {largest}; expected less than {limit}")

    def _take(self, drop: bool = False) -> bytes:
        data = self._queue.popleft()
        self._queued_bytes -= len(data)
        if drop:
            self._count_dropped(len(data))
        return data

    def _count_dropped(self, size: int) -> None:
        events = size // self._layout.event_bytes
        self.dropped_events += events
        self.dropped_packets += -(-events // self._layout.events_per_datagram)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._closing_at_s is not None)
                if not self._queue:
                    self._socket.close()
                    return
                data = self._take()
            self._send(data)

    def _send(self, data: bytes) -> None:
        size = self._layout.events_per_datagram * self._layout.event_bytes
        datagrams = [data[start : start + size] for start in range(0, len(data), size)]
        for index, datagram in enumerate(datagrams):
            late = self._closing_at_s is not None and time.monotonic() >= self._closing_at_s
            try:
                if not late:
                    self._socket.sendto(datagram, self._target)
            except OSError:  # no room (never wait), or the network is gone for now
                late = True
            if late:
                with self._changed:
                    self._count_dropped(len(datagram))
            if index % _BURST == _BURST - 1 and not late:
                time.sleep(_PAUSE_S if self._queued_bytes < _SHORT_PAUSE_BYTES else _SHORT_PAUSE_S)
