"""A receiver of UDP datagrams as a source of events."""

from __future__ import annotations

import re
import socket
import time

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events.batch import EventBatch, gather
from clsim.events.sockets.address import Address, resolve, unusable
from clsim.events.sockets.stream_source import SocketSource
from clsim.events.sockets.udp_layouts import LAYOUTS, Unwrapper

_BUFFER_BYTES = 4 << 20
_BATCH_DATAGRAMS = 512
_POLL_S = 0.2
_JUMP_US = 10_000_000
"""A datagram so much later than all before it may be a stranger's."""


class UdpSource(SocketSource):
    """A receiver of datagrams; see open_socket_source.

    Anybody may send to it, so what does not fit is left out and counted (``dropped_events``, ``malformed_packets``):
    events outside the sensor, and those that the network delivers after later ones. A datagram that lies far ahead
    counts only if the next one does not go back; but the first is believed. The SPIF layout has no times: its events
    get their time of arrival, from 0 on.
    """

    def __init__(self, address: Address, idle_timeout_s: float | None) -> None:
        """Listen."""
        address.allow(format=tuple(LAYOUTS), size=())
        size = re.fullmatch(r"([1-9]\d{0,4})x([1-9]\d{0,4})", address.options.get("size", ""), re.ASCII)
        if size is None:
            raise InputError(
                f"{address.text}: datagrams tell no sensor size; expected ?size=WIDTHxHEIGHT, as in 346x260"
            )
        self.width, self.height = int(size[1]), int(size[2])
        self.malformed_packets = 0
        self._format = address.options.get("format", "t64")
        self._layout = LAYOUTS[self._format]
        self._unwrap = Unwrapper()
        self._last_us: int | None = None
        self._ahead: EventBatch | None = None
        self._idle_timeout_s = idle_timeout_s
        self._start_s = time.monotonic()
        family, name = resolve(address)
        super().__init__(socket.socket(family, socket.SOCK_DGRAM))
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            self._socket.bind(name)
        except OSError as error:
            self.close()
            raise unusable(address, error) from None
        self.port: int = self._socket.getsockname()[1]

    def __next__(self) -> EventBatch:
        """Wait for events; datagrams that have come meanwhile share a batch."""
        until_s = float("inf") if self._idle_timeout_s is None else time.monotonic() + self._idle_timeout_s
        while not self._closed:
            left_s = until_s - time.monotonic()
            if left_s <= 0:
                break
            # Shutdown does not wake a waiting receiver everywhere.
            parts = [self._clean(self._layout.unpack(data)) for data in self._receive(min(left_s, _POLL_S))]
            batch = self._in_order([part for part in parts if len(part)])
            if len(batch):
                return batch
        self.close()
        if self._ahead is not None:  # nothing spoke against it
            batch, self._ahead = self._ahead, None
            return batch
        raise StopIteration

    def _receive(self, wait_s: float) -> list[bytes]:
        datagrams: list[bytes] = []
        try:
            self._socket.settimeout(wait_s)
            for _ in range(_BATCH_DATAGRAMS):
                datagram = self._socket.recv(1 << 16)
                self._socket.settimeout(0)
                if datagram and len(datagram) % self._layout.event_bytes == 0:
                    datagrams.append(datagram)
                else:
                    self.malformed_packets += 1
        except OSError:  # for now there is no more, or closed by another thread
            pass
        return datagrams

    def _clean(self, batch: EventBatch) -> EventBatch:
        """Return the events of a datagram that can be, in the order of their times."""
        if not self._layout.has_time:
            batch["t"] = round((time.monotonic() - self._start_s) * 1e6)
        elif self._format == "t32":
            batch["t"] = self._unwrap(batch["t"])
        return self._kept(batch, (batch["x"] < self.width) & (batch["y"] < self.height) & (batch["t"] >= 0))

    def _in_order(self, parts: list[EventBatch]) -> EventBatch:
        """Return the events of datagrams in the order of their times, without those that come too late."""
        taken: list[EventBatch] = []
        latest_us = self._last_us
        for part in parts:
            if self._ahead is not None:
                ahead, self._ahead = self._ahead, None
                if int(part["t"].max()) >= int(ahead["t"].max()) - _JUMP_US:
                    taken.append(ahead)
                    latest_us = int(ahead["t"].max())
                else:
                    self.dropped_events += len(ahead)
            end_us = int(part["t"].max())
            if latest_us is not None and end_us > latest_us + _JUMP_US:
                self._ahead = part
            else:
                taken.append(part)
                latest_us = end_us if latest_us is None else max(latest_us, end_us)
        batch = gather(taken)
        if self._last_us is not None:
            batch = self._kept(batch, batch["t"] >= self._last_us)
        if len(batch):
            if (batch["t"][1:] < batch["t"][:-1]).any():
                batch = batch[np.argsort(batch["t"], kind="stable")]
            self._last_us = int(batch["t"][-1])
        return batch

    def _kept(self, batch: EventBatch, fits: npt.NDArray[np.bool_]) -> EventBatch:
        if fits.all():
            return batch
        self.dropped_events += len(batch) - int(np.count_nonzero(fits))
        return batch[fits]
