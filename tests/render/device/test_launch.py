"""Kernels that several threads launch tile by tile."""

import os
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

from clsim.render.cache.light_grid import add_shared
from clsim.render.device.launch import Threads, Tiles, record

CPU = SimpleNamespace(is_cpu=True)


@wp.kernel(enable_backward=False)
def add_one(first: int, sums: wp.array2d[wp.int64]) -> None:
    i = first + wp.tid()
    add_shared(sums, i % 5, i % 2, wp.int64(1))


@wp.kernel(enable_backward=False)
def count(first: int, counts: wp.array[int]) -> None:
    i = first + wp.tid()
    counts[i] = counts[i] + 1


@wp.kernel(enable_backward=False)
def write(first: int, number: int, value: float, vector: wp.vec3, out: wp.array[wp.vec3]) -> None:
    for i in range(number):
        out[first + wp.tid() + i] = value * vector


def test_sums_to_which_many_threads_add_miss_nothing():
    sums = wp.zeros((5, 2), dtype=wp.int64, device="cpu")
    threads = Threads(4, CPU)
    tiles = Tiles(threads, lambda size: record(add_one, size, "cpu", first=0, sums=sums), "first", 1 << 30, 1_000_000)
    tiles.run(4_000_000, {})
    threads.close()
    np.testing.assert_array_equal(sums.numpy(), np.full((5, 2), 400_000))


@given(st.integers(1, 4), st.integers(0, 40), st.integers(0, 40), st.integers(1, 50))
def test_each_number_is_launched_once(many, begin, length, size):
    counts = wp.zeros(80, dtype=wp.int32, device="cpu")
    threads = Threads(many, CPU)
    tiles = Tiles(threads, lambda tile: record(count, tile, "cpu", first=0, counts=counts), "first", 80, size)
    assert tiles.run(begin + length, {}, begin)
    threads.close()
    np.testing.assert_array_equal(np.flatnonzero(counts.numpy() == 1), np.arange(begin, begin + length))
    assert counts.numpy().sum() == length


def test_nothing_is_launched_once_threads_are_cancelled_or_one_has_failed():
    counts = wp.zeros(4, dtype=wp.int32, device="cpu")
    threads = Threads(2, CPU)
    tiles = Tiles(threads, lambda tile: record(count, tile, "cpu", first=0, counts=counts), "first", 4, 1)

    def fail(_):
        raise ValueError("a launch fails")

    with pytest.raises(ValueError, match="a launch fails"):
        threads.each(fail, [0, 1])
    assert not tiles.run(4, {})
    assert not counts.numpy().any()


@pytest.mark.parametrize("many", [1, 3])
def test_all_threads_have_the_arguments_of_the_last_run(many):
    outs = [wp.zeros(9_000, dtype=wp.vec3, device="cpu") for _ in range(2)]
    threads = Threads(many, CPU)
    given = {"value": 0.0, "vector": wp.vec3(), "out": outs[0], "number": 1, "first": 0}
    tiles = Tiles(threads, lambda tile: record(write, tile, "cpu", **given), "first", 9_000, None, "number")
    # In small pieces first, by fewer threads, and then in many.
    for out, end, value in ((outs[0], 1_500, 2.0), (outs[1], 9_000, 3.0), (outs[0], 9_000, 4.0)):
        assert tiles.run(end, {"value": value, "vector": wp.vec3(1.0, 2.0, 0.5), "out": out})
        np.testing.assert_array_equal(out.numpy()[:end], np.tile(np.float32([value, 2 * value, value / 2]), (end, 1)))
        assert not out.numpy()[end:].any()
    threads.close()


@pytest.mark.parametrize(("many", "end", "sizes"), [(1, 9_000, {4096, 808}), (2, 9_000, {1125}), (8, 3_072, {1024})])
def test_threads_end_together_and_no_launch_is_tiny(many, end, sizes):
    class Launch:
        kernel = add_one

        def set_param_at_index(self, place, value): ...

        def set_dim(self, size):
            seen.add(size)

        def launch(self): ...

    seen: set[int] = set()
    threads = Threads(many, CPU)
    tiles = Tiles(threads, lambda _: Launch(), "first", 1 << 20, 4096)
    assert tiles.run(end, {})
    threads.close()
    assert seen == sizes


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system does not tell which cores may be used")
def test_there_are_as_many_threads_as_cores_that_the_process_may_use():
    """As where a container has a few of a large machine's; more threads would take turns on them."""
    allowed = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(allowed)})
        threads = Threads(None, CPU)
        threads.close()
    finally:
        os.sched_setaffinity(0, allowed)
    assert threads.count == 1
