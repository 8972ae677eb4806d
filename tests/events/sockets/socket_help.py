"""Shared by the socket tests: synthetic events and small raw-socket helpers."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

import numpy as np

from clsim.events import EventBatch, empty_batch

WIDTH, HEIGHT = 64, 48


def make_events(count: int, start_us: int = 0, seed: int = 0, width: int = WIDTH, height: int = HEIGHT) -> EventBatch:
    """Random events, sorted by t, y, x."""
    rng = np.random.default_rng(seed)
    batch = empty_batch(count)
    batch["t"] = start_us + np.sort(rng.integers(0, 4 * count + 1, count))
    batch["x"] = rng.integers(0, width, count)
    batch["y"] = rng.integers(0, height, count)
    batch["on"] = rng.integers(0, 2, count)
    return batch[np.lexsort((batch["x"], batch["y"], batch["t"]))]


def receive_until_end(connection: socket.socket) -> bytes:
    """Everything the peer sends until it closes."""
    parts = []
    while part := connection.recv(1 << 16):
        parts.append(part)
    return b"".join(parts)


def wait_until(condition: Callable[[], object], timeout_s: float = 10.0) -> None:
    """Poll a condition that another thread or process makes true; fail if it does not."""
    end_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end_s, "the awaited condition did not come true"
        time.sleep(0.005)


def free_port() -> int:
    """A UDP port that nobody uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def is_bound(port: int) -> bool:
    """Whether somebody listens at a UDP port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return True
    return False


AESTREAM = """
import sys, time
import numpy as np, aestream

shape, port, count = (int(sys.argv[1]), int(sys.argv[2])), int(sys.argv[3]), int(sys.argv[4])
image, end = np.zeros(shape), time.monotonic() + 60
with aestream.UDPInput(shape, port=port) as source:
    while image.sum() < count and time.monotonic() < end:
        image += np.asarray(source.read(aestream.Backend.Numpy))
        time.sleep(0.01)
np.save(sys.argv[5], image)
"""
"""A receiver: WIDTH HEIGHT PORT COUNT FILE; saves the number of events in each pixel [x, y]."""
