"""How events lie in UDP datagrams: two layouts of faery and the one of AEStream's SPIF.

Sources: https://github.com/aestream/faery (UdpFormat), https://github.com/aestream/aestream (UDP input),
https://github.com/SpiNNakerManchester/spif.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from clsim.events.batch import EVENT_DTYPE, EventBatch, empty_batch

_T32_DTYPE = np.dtype([("t", "<u4"), ("x", "<u2"), ("y_on", "<u2")])
_WRAP_US = 1 << 32


@dataclass(frozen=True)
class UdpLayout:
    """One layout: how many events share a datagram, and the functions to and from its bytes."""

    events_per_datagram: int
    """Datagrams stay under the usual MTU of 1500 bytes (t64: 1300), and under what the receivers take (SPIF: 128)."""
    event_bytes: int
    max_side: int
    has_time: bool
    pack: Callable[[EventBatch], bytes]
    unpack: Callable[[bytes], EventBatch]
    """Takes whole events only. Times are those of the bytes (t32: modulo 2³²; SPIF: 0); ``on`` is 0 or 1."""


def _pack_t64(batch: EventBatch) -> bytes:
    return batch.tobytes()  # EVENT_DTYPE is this very layout, but for the sign of t


def _unpack_t64(data: bytes) -> EventBatch:
    batch: EventBatch = np.frombuffer(data, EVENT_DTYPE).copy()
    flags = batch["on"].view(np.uint8)
    flags[...] = flags != 0
    return batch


def _pack_t32(batch: EventBatch) -> bytes:
    wire = np.empty(len(batch), _T32_DTYPE)
    wire["t"] = batch["t"] & (_WRAP_US - 1)
    wire["x"] = batch["x"]
    wire["y_on"] = (batch["y"] << 1) | batch["on"]
    return wire.tobytes()


def _unpack_t32(data: bytes) -> EventBatch:
    wire = np.frombuffer(data, _T32_DTYPE)
    return _batch(wire["t"], wire["x"], wire["y_on"] >> 1, wire["y_on"] & 1)


def _pack_spif(batch: EventBatch) -> bytes:
    x, y, on = (batch[name].astype("<u4") for name in ("x", "y", "on"))
    wire: npt.NDArray[np.uint32] = (x | 0x8000) << 16 | on << 15 | y
    return wire.tobytes()


def _unpack_spif(data: bytes) -> EventBatch:
    wire = np.frombuffer(data, "<u4")
    return _batch(0, wire >> 16 & 0x7FFF, wire & 0x7FFF, wire >> 15 & 1)


def _batch(t: npt.ArrayLike, x: npt.NDArray[np.integer], y: npt.NDArray[np.integer], on: npt.ArrayLike) -> EventBatch:
    batch = empty_batch(len(x))
    batch["t"], batch["x"], batch["y"], batch["on"] = t, x, y, on
    return batch


LAYOUTS = {
    "t64": UdpLayout(100, 13, 1 << 16, True, _pack_t64, _unpack_t64),
    "t32": UdpLayout(100, 8, 1 << 15, True, _pack_t32, _unpack_t32),
    "spif": UdpLayout(128, 4, 1 << 15, False, _pack_spif, _unpack_spif),
}
"""``t64``: faery's ``t64_x16_y16_on8``; ``t32``: faery's ``t32_x16_y15_on1``, time modulo 2³² µs; ``spif``: AEStream's,
without time."""


class Unwrapper:
    """Restores the upper half of 32-bit times: a step of more than 2³¹ µs back is a wrap, forth an older datagram."""

    def __init__(self) -> None:
        """Begin with the first wrap period."""
        self._offset_us = 0
        self._previous_us: int | None = None

    def __call__(self, t_us: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Return the full times of a batch of one or more."""
        first = int(t_us[0]) if self._previous_us is None else self._previous_us
        steps = np.diff(t_us, prepend=first)
        wraps = (steps < -_WRAP_US // 2).astype(np.int64) - (steps > _WRAP_US // 2)
        offsets = self._offset_us + _WRAP_US * np.cumsum(wraps)
        self._previous_us, self._offset_us = int(t_us[-1]), int(offsets[-1])
        return t_us + offsets
