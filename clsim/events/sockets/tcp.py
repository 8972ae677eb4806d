"""``tcp://HOST:PORT``: a server that speaks DV's protocol to any number of clients and waits for none of them."""

from __future__ import annotations

import contextlib
import os
import selectors
import socket
import threading
import time
from collections import deque

from clsim.errors import InputError
from clsim.events.batch import EventBatch, SinkError
from clsim.events.formats.dv_stream import Compression, DvEncoder
from clsim.events.sockets.address import Address, exposure_warning, parse_address, resolve, unusable
from clsim.events.sockets.closing import BRIEF_FLUSH_S, CLOSE_TIMEOUT_S, PATIENCE_S

QUEUE_BYTES = 64 << 20
MAX_CLIENTS = 64
_RECEIVED_LIMIT_BYTES = 1 << 16
_PACKETS_A_TURN = 4  # so that nobody holds the lock for long
_COMPRESSIONS = {"lz4": Compression.LZ4, "none": Compression.NONE}


class _Client:
    """One connection and what waits to be sent over it."""

    def __init__(self, connection: socket.socket, header: bytes) -> None:
        self.connection = connection
        self.sending = memoryview(header)
        """The packet under way, what is left of it: never dropped, or the client would lose the thread."""
        self.sending_events = 0
        self.queue: deque[tuple[bytes, int]] = deque()
        self.queued_bytes = 0
        self.received_bytes = 0
        self.watched = selectors.EVENT_READ

    def send(self) -> bool:
        """Send until the socket is full, nothing is left or some packets went; tell whether it took anything.

        Raises OSError if the client is gone.
        """
        took = False
        for _ in range(_PACKETS_A_TURN):
            while self.sending:
                try:
                    self.sending = self.sending[self.connection.send(self.sending) :]
                    took = True
                except (BlockingIOError, InterruptedError):
                    return took
            self.sending_events = 0
            if not self.queue:
                return took
            packet, self.sending_events = self.queue.popleft()
            self.queued_bytes -= len(packet)
            self.sending = memoryview(packet)
        return took

    @property
    def waiting(self) -> bool:
        """Whether the socket took less than there is."""
        return bool(self.sending or self.queue)


class StreamServer:
    """Sends batches over every connection a listening socket accepts; TcpSink and UnixSink differ in that socket only.

    ``write`` encodes once, sends what the sockets take at once, and queues the rest per client, in at most
    ``queue_bytes``; when a queue is full its oldest packets are dropped and counted. One thread, asleep while nothing
    happens, accepts clients, sends what waits, and drops clients that leave or talk.
    """

    def __init__(
        self, listener: socket.socket, encoder: DvEncoder, queue_bytes: int = QUEUE_BYTES, warning: str | None = None
    ) -> None:
        """Serve on a socket that listens already."""
        self.warning = warning
        """A sentence for the user, if the address is open to other machines."""
        self.dropped_packets = 0
        self.dropped_events = 0
        self._encoder = encoder
        self._queue_bytes = queue_bytes
        self._listener = listener
        self._clients: set[_Client] = set()
        self._changed = threading.Condition()
        self._closing_at_s: float | None = None
        self._taken_at_s = 0.0
        self._selector = selectors.DefaultSelector()
        self._wake_reader, self._wake_writer = socket.socketpair()
        for watched in (listener, self._wake_reader, self._wake_writer):
            watched.setblocking(False)
        self._selector.register(listener, selectors.EVENT_READ)
        self._selector.register(self._wake_reader, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._serve, name="clsim-stream-server", daemon=True)
        self._thread.start()

    @property
    def clients(self) -> int:
        """How many clients are connected."""
        return len(self._clients)

    @property
    def queued_bytes(self) -> int:
        """How much waits for clients that are slower than the events."""
        with self._changed:
            return sum(client.queued_bytes for client in self._clients)

    def report(self) -> dict[str, float]:
        """Return how many clients are connected, and how many events they were too slow for."""
        return {"clients": self.clients, "dropped_events": self.dropped_events}

    def wait_for_clients(self, count: int = 1, timeout_s: float | None = None) -> bool:
        """Wait until ``count`` clients are connected; events written earlier are not sent to them."""
        with self._changed:
            return self._changed.wait_for(lambda: len(self._clients) >= count, timeout_s)

    def write(self, events: EventBatch, end_us: int) -> None:
        """Send the events to every client; never waits for one. DV's protocol has no word for silence.

        Raises:
            InputError: an event lies outside the sensor.
        """
        if self._closing_at_s is not None:
            raise SinkError("the stream cannot be written any more; it was closed before")
        if not self._clients or not len(events):
            return
        for packet, count in self._encoder.packets(events):
            with self._changed:
                for client in tuple(self._clients):
                    self._enqueue(client, packet, count)
                    if client.watched == selectors.EVENT_READ:  # nothing waited before: spare the thread's detour
                        self._send(client)

    def close(self) -> None:
        """Refuse new clients, send what waits, and disconnect.

        Clients that take nothing for a second are stuck and not waited for; what is left counts as dropped.
        """
        self._begin_to_close(CLOSE_TIMEOUT_S)
        self._thread.join()

    def flush_briefly(self) -> None:
        """Begin to close, and have that last no longer than 0.3 s."""
        self._begin_to_close(BRIEF_FLUSH_S)

    def _begin_to_close(self, timeout_s: float) -> None:
        with self._changed:
            now_s = time.monotonic()
            if self._closing_at_s is None:
                self._closing_at_s, self._taken_at_s = now_s + timeout_s, now_s
            self._closing_at_s = min(self._closing_at_s, now_s + timeout_s)
            if self._wake_writer.fileno() != -1:  # it has not ended yet
                self._wake()

    def _wake(self) -> None:
        with contextlib.suppress(BlockingIOError):  # full: the thread will wake anyway
            self._wake_writer.send(b"\0")

    def _enqueue(self, client: _Client, packet: bytes, events: int) -> None:
        client.queue.append((packet, events))
        client.queued_bytes += len(packet)
        while client.queued_bytes > self._queue_bytes:
            oldest, lost = client.queue.popleft()
            client.queued_bytes -= len(oldest)
            self.dropped_packets += 1
            self.dropped_events += lost

    def _send(self, client: _Client) -> None:
        """Send what the socket takes; have the thread do the rest when there is room again."""
        try:
            if client.send():
                self._taken_at_s = time.monotonic()
        except OSError:
            self._remove(client)
            return
        watched = selectors.EVENT_READ | (selectors.EVENT_WRITE if client.waiting else 0)
        if watched != client.watched:
            client.watched = watched
            self._selector.modify(client.connection, watched, client)

    def _remove(self, client: _Client) -> None:
        if client in self._clients:
            self._clients.remove(client)
            self._selector.unregister(client.connection)
            client.connection.close()
            self._changed.notify_all()

    def _serve(self) -> None:
        while True:
            ready = self._selector.select(self._left_s())
            connection = self._accept() if any(key.fileobj is self._listener for key, _ in ready) else None
            with self._changed:
                if connection is not None:
                    self._admit(connection)
                for key, events in ready:
                    if key.fileobj is self._listener:
                        continue
                    if key.fileobj is self._wake_reader:
                        self._wake_reader.recv(4096)
                    else:
                        self._attend(key.data, events)
                if self._closing_at_s is not None and (
                    self._left_s() == 0.0 or not any(client.waiting for client in self._clients)
                ):
                    self._end()
                    return

    def _left_s(self) -> float | None:
        if self._closing_at_s is None:
            return None
        return max(0.0, min(self._closing_at_s, self._taken_at_s + PATIENCE_S) - time.monotonic())

    def _accept(self) -> socket.socket | None:
        try:
            return self._listener.accept()[0]
        except (BlockingIOError, ConnectionAbortedError):
            return None
        except OSError:  # out of descriptors: the listener stays readable, so do not spin
            time.sleep(0.05)
            return None

    def _admit(self, connection: socket.socket) -> None:
        if len(self._clients) >= MAX_CLIENTS or self._closing_at_s is not None:
            connection.close()
            return
        connection.setblocking(False)
        if connection.family != socket.AF_UNIX:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            _keep_alive(connection)
        client = _Client(connection, self._encoder.header)
        self._selector.register(connection, client.watched, client)
        self._clients.add(client)
        self._changed.notify_all()
        self._send(client)

    def _attend(self, client: _Client, events: int) -> None:
        if client not in self._clients:
            return
        if events & selectors.EVENT_READ:
            # DV's clients say nothing: what comes is the end, or from somebody who takes this for another protocol.
            try:
                received = len(client.connection.recv(4096))
            except (BlockingIOError, InterruptedError):
                received = -1
            except OSError:
                received = 0
            client.received_bytes += max(received, 0)
            if received == 0 or client.received_bytes > _RECEIVED_LIMIT_BYTES:
                self._remove(client)
                return
        if events & selectors.EVENT_WRITE:
            self._send(client)

    def _end(self) -> None:
        for client in tuple(self._clients):
            left = [events for _, events in client.queue] + ([client.sending_events] if client.sending else [])
            self.dropped_packets += len(left)
            self.dropped_events += sum(left)
            self._remove(client)
        self._selector.close()
        for watched in (self._listener, self._wake_reader, self._wake_writer):
            watched.close()


def _keep_alive(connection: socket.socket) -> None:
    """Have the system notice within a minute or so that a machine vanished without a word."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in (("TCP_KEEPIDLE", 30), ("TCP_KEEPINTVL", 10), ("TCP_KEEPCNT", 3)):
        if hasattr(socket, name):  # macOS lacks the first
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


class TcpSink(StreamServer):
    """A server at ``tcp://HOST:PORT?compression=lz4|none&queue_mb=64``; port 0 takes a free one (see ``port``)."""

    def __init__(self, address: Address | str, width: int, height: int) -> None:
        """Start to listen.

        Raises:
            InputError: the address is malformed, unknown or in use, or the sensor is too large for the protocol.
        """
        if isinstance(address, str):
            address = parse_address(address)
        encoder, queue_bytes = stream_options(address, width, height)
        family, name = resolve(address)
        listener = socket.socket(family, socket.SOCK_STREAM)
        try:
            if os.name == "posix":  # elsewhere it would let two servers share a port
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(name)
            listener.listen(MAX_CLIENTS)
        except OSError as error:
            listener.close()
            raise unusable(address, error) from None
        self.port: int = listener.getsockname()[1]
        super().__init__(listener, encoder, queue_bytes, exposure_warning(address, name))


def stream_options(address: Address, width: int, height: int) -> tuple[DvEncoder, int]:
    """Return what the options of a ``tcp`` or ``unix`` address ask for: the encoder, and the bytes a queue may hold."""
    address.allow(compression=tuple(_COMPRESSIONS), queue_mb=())
    queue_mb = address.options.get("queue_mb", str(QUEUE_BYTES >> 20))
    if not (queue_mb.isascii() and queue_mb.isdigit() and len(queue_mb) <= 5 and int(queue_mb) > 0):
        raise InputError(f"{address.text}: queue_mb is {queue_mb!r}; expected a whole number of megabytes, as in 64")
    compression = _COMPRESSIONS[address.options.get("compression", "lz4")]
    return DvEncoder(width, height, compression), int(queue_mb) << 20
