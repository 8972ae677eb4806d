"""Writes numbered events until it is killed: ``python -m tests.events.event_writer FILE COUNTER BATCH INTERVAL_US``.

Event i has t = 2·i + i mod 2, and pixel and polarity that follow from i, so that a reader knows what event i must be.
After every write the number of events written so far is stored in the file COUNTER.
"""

import os
import sys

import numpy as np

from clsim.events import EVENT_DTYPE, EventBatch
from clsim.events.files import open_sink
from clsim.events.formats.filesink import FlushPolicy
from tests.events.event_data import end_of


def numbered(start: int, stop: int) -> EventBatch:
    """Return events start … stop − 1."""
    index = np.arange(start, stop)
    batch = np.empty(len(index), EVENT_DTYPE)
    batch["t"] = 2 * index + index % 2
    batch["x"], batch["y"], batch["on"] = index % 346, index % 260, index % 3 == 0
    return batch


if __name__ == "__main__":
    path, counter, size, interval_us = sys.argv[1], sys.argv[2], int(sys.argv[3]), float(sys.argv[4])
    descriptor = os.open(counter, os.O_WRONLY | os.O_CREAT)
    sink = open_sink(path, 346, 260, flush=FlushPolicy(interval_us=interval_us))
    done = 0
    while True:
        batch = numbered(done, done + size)
        sink.write(batch, end_of(batch))
        done += size
        os.pwrite(descriptor, done.to_bytes(8, "little"), 0)
