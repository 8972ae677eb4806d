"""Arrays in large pages."""

from __future__ import annotations

import mmap
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from clsim.render.device.arrays import array
from clsim.render.device.large_pages import LARGE, spread


@pytest.mark.parametrize("entries", [1, 5, LARGE // 12 + 1, LARGE])
def test_an_array_has_its_shape_and_room_for_all_of_it(entries: int) -> None:
    one, other = spread((entries, 3), np.float32), spread(entries, np.uint16)
    one[:], other[:] = 2.0, 3
    assert one.shape == (entries, 3) and one.dtype == np.float32 and (one == 2).all()
    assert other.shape == (entries,) and other.dtype == np.uint16 and (other == 3).all()
    assert one.ctypes.data % 64 == other.ctypes.data % 64 == 0


@pytest.mark.skipif(not hasattr(mmap, "MADV_HUGEPAGE"), reason="only Linux is asked for large pages")
def test_large_pages_are_asked_for_all_of_a_large_array() -> None:
    values = spread(LARGE, np.float32)
    first = values.ctypes.data
    assert first % (1 << 21) == 0
    assert "hg" in _flags(first) and "hg" in _flags(first + values.nbytes)


def test_a_large_array_on_the_device_holds_what_it_was_given_and_lives_as_long_as_it_is_held() -> None:
    values = np.arange(LARGE, dtype=np.float64).reshape(-1, 2)
    held = array(values, wp.vec2, wp.get_device("cpu"))
    expected, values[:] = values.astype(np.float32), -1.0
    assert held.shape == (LARGE // 2,) and held.ptr % (1 << 21) == 0
    np.testing.assert_array_equal(held.numpy(), expected)


def _flags(address: int) -> list[str]:
    """Return what the kernel says of the memory at an address."""
    inside = False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        head = line.split()[0]
        if not head.endswith(":"):
            low, high = (int(each, 16) for each in head.split("-"))
            inside = low <= address < high
        elif inside and head == "VmFlags:":
            return line.split()[1:]
    return []
