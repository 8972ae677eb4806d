"""Between a producer that never waits and browsers that may be slow: bounded queues that drop the oldest."""

from __future__ import annotations

import asyncio
import threading
from collections import deque

import numpy as np

from clsim.events import EventBatch, empty_batch
from clsim.live.view.packets import event_packets, seek_packet

QUEUE_EVENTS = 1 << 20
"""Most events that wait for one browser (8 bytes each, 9 with causes)."""
QUEUE_PACKETS = 1 << 10
UNSEEN_PACKETS = 16
"""Packets under way that a browser has not confirmed; the rest waits here, where it can be dropped."""
PERIOD_S = 1 / 60


class Watcher:
    """What waits for one browser. Lives in the server's thread."""

    def __init__(self) -> None:
        """Start with nothing to send."""
        self.wants_frames = True
        self.dropped_events = 0
        """Events that the browser was too slow for, in all."""
        self.missed_events = 0
        """Those of them since time last jumped."""
        self.sent = 0
        self.seen = 0
        self.images: dict[int, bytes] = {}
        self.texts: dict[str, str] = {}
        """Messages by type: only the newest of each matters."""
        self._packets: deque[tuple[bytes, int]] = deque()
        self._waiting_events = 0
        self.changed = asyncio.Event()

    @property
    def waiting_events(self) -> int:
        """Number of events in the queue."""
        return self._waiting_events

    def put(self, packet: bytes, events: int) -> None:
        """Queue a packet, dropping the oldest when there are too many."""
        self._packets.append((packet, events))
        self._waiting_events += events
        while self._waiting_events > QUEUE_EVENTS or len(self._packets) > QUEUE_PACKETS:
            _, lost = self._packets.popleft()
            self._waiting_events -= lost
            self.miss(lost)
        self.changed.set()

    def miss(self, events: int) -> None:
        """Count events that the browser will not get."""
        self.dropped_events += events
        self.missed_events += events

    def clear(self) -> None:
        """Forget what waits: time has jumped."""
        self._packets.clear()
        self._waiting_events = self.missed_events = 0

    def put_image(self, kind: int, packet: bytes) -> None:
        """Replace the image of this kind."""
        self.images[kind] = packet
        self.changed.set()

    def put_text(self, kind: str, text: str) -> None:
        """Replace the message of this type."""
        self.texts[kind] = text
        self.changed.set()

    def next_packet(self) -> bytes | None:
        """Return what to send next, events before images; None while the browser has not seen what was sent."""
        if self.sent - self.seen >= UNSEEN_PACKETS:
            return None
        if self._packets:
            packet, events = self._packets.popleft()
            self._waiting_events -= events
        elif self.images:
            packet = self.images.pop(next(iter(self.images)))
        else:
            return None
        self.sent += 1
        return packet


class Hub:
    """Gathers batches from any thread and hands them, packed once, to every watcher, at most 60 times a second."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        """Serve watchers that live in ``loop``."""
        self.watchers: set[Watcher] = set()
        self._loop = loop
        self._lock = threading.Lock()
        self._pending: deque[EventBatch] = deque()
        self._pending_events = 0
        self._now_us = 0
        self._seek_us: int | None = None
        self._scheduled = False
        self._lost_events = 0
        """Lost before they were handed out."""
        self._left_events = 0
        """Lost by watchers that have gone."""

    @property
    def dropped_events(self) -> int:
        """Events lost so far, summed over the watchers."""
        return self._left_events + sum(watcher.dropped_events for watcher in tuple(self.watchers))

    def offer(self, batch: EventBatch, now_us: int) -> None:
        """Take a batch (a copy is made) from any thread; returns at once, and costs nothing while nobody watches.

        Either all batches that have events have a field ``cause``, or none.
        """
        if not self.watchers:
            return
        copy = batch[-QUEUE_EVENTS:].copy()
        with self._lock:
            if len(copy):
                self._pending.append(copy)
            self._pending_events += len(copy)
            self._lost_events += len(batch) - len(copy)
            while self._pending_events > QUEUE_EVENTS:
                lost = len(self._pending.popleft())
                self._pending_events -= lost
                self._lost_events += lost
            self._now_us = now_us
        self._schedule()

    def seek(self, now_us: int) -> None:
        """Tell every watcher that time jumps; drops what waits. From any thread."""
        with self._lock:
            self._pending.clear()
            self._pending_events = self._lost_events = 0
            self._seek_us = self._now_us = now_us
        self._schedule()

    def show(self, kind: int, packet: bytes) -> None:
        """Hand an image to the watchers that want frames. From any thread."""
        self._call(self._show, kind, packet)

    def leave(self, watcher: Watcher) -> None:
        """Forget a watcher, but not what it lost."""
        self.watchers.discard(watcher)
        self._left_events += watcher.dropped_events

    def _schedule(self) -> None:
        with self._lock:
            wake, self._scheduled = not self._scheduled, True
        if wake:
            self._call(self._loop.call_later, PERIOD_S, self._flush)

    def _call(self, *call: object) -> None:
        try:
            self._loop.call_soon_threadsafe(*call)  # type: ignore[arg-type]
        except RuntimeError:  # the loop has closed: the view is over
            self.watchers.clear()

    def _flush(self) -> None:
        with self._lock:
            batches, self._pending = list(self._pending), deque()
            self._pending_events, self._scheduled = 0, False
            lost, self._lost_events = self._lost_events, 0
            now_us, seek_us, self._seek_us = self._now_us, self._seek_us, None
        if seek_us is not None:
            for watcher in self.watchers:
                watcher.clear()
                watcher.put(seek_packet(seek_us), 0)
        for watcher in self.watchers:
            watcher.miss(lost)
        merged = np.concatenate(batches) if batches else empty_batch(0)
        for packet, events in event_packets(merged, now_us):
            for watcher in self.watchers:
                watcher.put(packet, events)

    def _show(self, kind: int, packet: bytes) -> None:
        for watcher in self.watchers:
            if watcher.wants_frames:
                watcher.put_image(kind, packet)
