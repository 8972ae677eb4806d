"""A client of DV's protocol over TCP and UNIX sockets as a source of events."""

from __future__ import annotations

import socket
import struct
import time

import numpy as np

from clsim.errors import InputError
from clsim.events.batch import EventBatch
from clsim.events.formats.dv_stream import MAX_HEADER_BYTES, MAX_PACKET_BYTES, PACKET_HEAD, parse_header, parse_packet
from clsim.events.sockets.address import Address, cause
from clsim.events.sockets.stream_source import SocketSource

_READ_BYTES = 1 << 20


class DvSource(SocketSource):
    """A client of DV's protocol; see open_socket_source."""

    def __init__(self, address: Address, timeout_s: float, idle_timeout_s: float | None) -> None:
        """Connect and read the header."""
        address.allow()
        super().__init__(_connect(address, timeout_s))
        self._text = address.text
        self._timeout_s = timeout_s
        self._idle_timeout_s = idle_timeout_s
        try:
            prefix = self._receive(4)
            size = struct.unpack("<I", prefix)[0]
            if not 0 < size <= MAX_HEADER_BYTES:
                raise InputError(f"the stream begins with {prefix!r}; expected the header of DV's protocol")
            self._header = parse_header(prefix + self._receive(size))
        except InputError as error:
            self.close()
            raise InputError(f"{self._text}: {error}") from None
        self.width, self.height = self._header.width, self._header.height

    def __next__(self) -> EventBatch:
        """Wait for the next packet of events; packets of other streams are passed over."""
        idle_until_s = None if self._idle_timeout_s is None else time.monotonic() + self._idle_timeout_s
        try:
            while self._wait(idle_until_s):
                stream_id, size = PACKET_HEAD.unpack(self._receive(PACKET_HEAD.size))
                if not 0 <= size <= MAX_PACKET_BYTES:
                    raise InputError(f"a packet claims {size} bytes; expected at most {MAX_PACKET_BYTES >> 20} MiB")
                payload = self._receive(size)
                if stream_id == self._header.stream_id:
                    batch = parse_packet(payload, self._header)
                    if len(batch):
                        return batch[np.argsort(batch["t"], kind="stable")]
        except InputError as error:
            ended = self._closed  # by another thread: then it is no fault that the packet is torn
            self.close()
            if not ended:
                raise InputError(f"{self._text}: {error}") from None
        self.close()
        raise StopIteration

    def _wait(self, until_s: float | None) -> bool:
        """Wait between packets; False if the stream has ended or patience has."""
        if self._closed:
            return False
        try:
            self._socket.settimeout(None if until_s is None else max(1e-3, until_s - time.monotonic()))
            return len(self._socket.recv(1, socket.MSG_PEEK)) > 0
        except TimeoutError:
            return False
        except OSError as error:
            raise InputError(f"the connection was lost ({cause(error)})") from None

    def _receive(self, count: int) -> bytes:
        data = bytearray()
        try:
            self._socket.settimeout(self._timeout_s)
            while len(data) < count:
                part = self._socket.recv(min(count - len(data), _READ_BYTES))
                if not part:
                    raise InputError(
                        f"the connection ended {count - len(data)} bytes before a header's or packet's end"
                    )
                data += part
        except TimeoutError:
            raise InputError(
                f"nothing came for {self._timeout_s:g} s; expected the rest of a header or packet"
            ) from None
        except OSError as error:
            raise InputError(f"the connection was lost ({cause(error)})") from None
        return bytes(data)


def _connect(address: Address, timeout_s: float) -> socket.socket:
    connection = None
    try:
        if address.scheme == "tcp":
            return socket.create_connection((address.host, address.port), timeout=timeout_s)
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.settimeout(timeout_s)
        connection.connect(address.path)
        return connection
    except (OSError, UnicodeError) as error:
        if connection is not None:
            connection.close()
        raise InputError(f"{address.text}: cannot be reached ({cause(error)}); expected a server there") from None
