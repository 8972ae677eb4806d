"""What goes over the page's WebSocket: 32 bytes of header, then arrays a browser can use as they are.

Header, little-endian: kind u32, count u32, base_us i64, now_us i64, width u32, height u32.

==== ======== ==========================================================================================
kind name     body
==== ======== ==========================================================================================
1    events   dt u32 [count] (t = base_us + dt), x u16 [count], y u16 [count] with ``on`` in its highest bit
2    noisy    the frame the renderer made, u8 [height, width, 3]
3    denoised the brightness the detector believes in, u8 [height, width, 1]
4    seek     none: forget all events, time goes on from now_us
5    depth    truth as a picture, u8 [height, width, 3]
6    flow     likewise
7    ids      likewise
8    caused   as events, then the cause of each, u8 [count]
==== ======== ==========================================================================================

``now_us`` is how far time has come, with or without events.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from clsim.events import EventBatch

HEADER = struct.Struct("<IIqqII")
EVENTS, NOISY, DENOISED, SEEK, DEPTH, FLOW, IDS, CAUSED = range(1, 9)
PACKET_EVENTS = 1 << 16
_ON_BIT = np.uint16(1 << 15)


def event_packets(batch: EventBatch, now_us: int) -> Iterator[tuple[bytes, int]]:
    """Yield (packet, number of events); an empty batch yields one packet that only tells the time.

    Events with a field ``cause`` are sent with it.
    """
    caused = "cause" in (batch.dtype.names or ())
    if not len(batch):
        yield HEADER.pack(EVENTS, 0, now_us, now_us, 0, 0), 0
    start = 0
    while start < len(batch):
        part = batch[start : start + PACKET_EVENTS]
        base_us = int(part["t"][0])
        if int(part["t"][-1]) - base_us >= 1 << 32:  # a gap of more than an hour: dt would wrap
            part = part[: int(np.searchsorted(part["t"], base_us + (1 << 32)))]
        start += len(part)
        kind = CAUSED if caused else EVENTS
        header = HEADER.pack(kind, len(part), base_us, now_us if start == len(batch) else int(part["t"][-1]), 0, 0)
        y = part["y"] & ~_ON_BIT | np.where(part["on"], _ON_BIT, np.uint16(0))
        dt = (part["t"] - base_us).astype("<u4")
        columns = [dt, part["x"].astype("<u2"), y.astype("<u2"), *([part["cause"]] if caused else [])]
        yield header + b"".join(column.tobytes() for column in columns), len(part)


def image_packet(kind: int, image: npt.NDArray[np.uint8], time_us: int) -> bytes:
    """Pack an image uint8 ``[H, W, C]``."""
    height, width, channels = image.shape
    return HEADER.pack(kind, channels, time_us, time_us, width, height) + image.tobytes()


def seek_packet(now_us: int) -> bytes:
    """Tell the page that time jumps."""
    return HEADER.pack(SEEK, 0, now_us, now_us, 0, 0)
