"""Memory and kernels on a device: what goes there comes back, and kernels get what they are given."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.errors import Error
from clsim.opencl import workplace
from clsim.opencl.device import choose_device
from clsim.opencl.workplace import Grid, Workplace

REALS = [np.float32, np.float64]
TEXTS = {
    "number.clh": """
#ifdef DOUBLE
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double number;
#else
typedef float number;
#endif
static inline number plus(number x) { return x + PLUS; }
""",
    "line.clh": '#include "number.clh"\n#define LINE(a, b, x) ((a) * (x) + (b))\n',
    "lines.cl": """
#include "number.clh"
#include "line.clh"
#include "generated"
__kernel void line(__global const number *x, number a, int b, long c, __global number *out) {
    const size_t i = get_global_id(0) + 3 * get_global_id(1);
    out[i] = more(LINE(a, b, x[i])) + c;
}
// A comment that names STRANGE changes nothing.
""",
    "wrong.cl": "__kernel void wrong() { this_is_not_there(); }\n",
}
MORE = "static inline number more(number x) { return plus(x); }\n"


@pytest.fixture
def texts(monkeypatch):
    monkeypatch.setattr(workplace, "_read", TEXTS.__getitem__)


def place_of(real=np.float32, width=3, height=2, lanes=1):
    device = choose_device()
    return Workplace(device, Grid(width, height, lanes, real), device.queue())


@pytest.mark.parametrize("lanes", [1, 4, 16])
@pytest.mark.parametrize(("width", "height"), [(1, 1), (15, 3), (16, 9), (17, 2)])
def test_an_image_has_the_least_columns_that_vectors_fill(width, height, lanes):
    grid = Grid(width, height, lanes, np.float32)
    assert grid.span % lanes == 0 and width <= grid.span < width + lanes
    assert grid.image_shape == (height, grid.span)
    assert grid.vectors[0] * lanes == grid.span and grid.vectors[1] == height


@pytest.mark.parametrize("kind", ["u1", "u2", "i4", "i8", "f4", "f8"])
@pytest.mark.parametrize("shape", [(0,), (1,), (7,), (3, 5), (2, 3, 4)])
def test_what_is_written_is_read_again(kind, shape):
    place = place_of()
    values = np.random.default_rng(1).integers(0, 200, shape).astype(kind)
    buffer = place.allocate(shape, kind)
    assert (place.read(buffer) == 0).all() and place.read(buffer).shape == shape
    place.write(buffer, values[::-1])  # from its end on, so that it has gaps
    found = place.read(buffer)
    assert found.dtype == np.dtype(kind) and np.array_equal(found, values[::-1])
    place.write(buffer, values.astype(np.float32))  # of another type, whose numbers are meant
    assert np.array_equal(place.read(buffer), values)
    if values.size:
        place.fill(buffer, 9)
        assert (place.read(buffer) == 9).all()
        few = np.zeros(1, kind)
        assert place.read(buffer, few) is few and few[0] == 9


@pytest.mark.parametrize("real", REALS)
def test_memory_has_the_type_of_the_place_and_the_value_that_it_is_filled_with(real):
    place = place_of(real)
    found = place.read(place.allocate((2, 3), fill=-1.5))
    assert found.dtype == real and (found == -1.5).all()
    assert np.isnan(place.read(place.allocate((4,), fill=np.nan))).all()


@pytest.mark.parametrize("real", REALS)
def test_numbers_reach_a_kernel_in_the_types_that_it_takes(texts, real):
    """Again and again, some of them others than before, and in memory that changes places."""
    place = place_of(real)
    (line,) = place.kernels("lines", ("line",), {"PLUS": 100, "STRANGE": object()}, MORE)
    x = np.linspace(-1, 1, 6).astype(real).reshape(2, 3)
    given, other, out, out2 = (place.allocate((2, 3)) for _ in range(4))
    place.write(given, x)
    place.write(other, 2 * x)
    for source, a, b, c, to in (
        (given, 0.1, 7, 1 << 40, out), (other, 0.1, 7, 1 << 40, out2), (given, 0.3, -7, -1, out),
        (given, 0.3, 8, -1, out), (other, 1.0, 1, 1, out2), (other, 1.0, 1, 1, out),
    ):  # fmt: skip
        place.launch(line, (3, 2), source, a, b, np.int64(c), to)
        expected = (real(a) * (x if source is given else 2 * x) + real(b) + real(100)) + real(c)
        np.testing.assert_allclose(place.read(to), expected, rtol=1e-6 if real == np.float32 else 1e-15)


def test_memory_that_the_host_sees_shows_what_kernels_wrote(texts):
    place = place_of()
    (line,) = place.kernels("lines", ("line",), {"PLUS": 100}, MORE)
    given, seen = place.allocate((6,), fill=1.0), place.allocate_seen((6,), np.float32)
    for factor in (1.0, 2.0):
        place.launch(line, (3, 2), given, factor, 0, np.int64(0), seen)
        assert place.seen(seen, 4).tolist() == [100.0 + factor] * 4 and not len(place.seen(seen, 0))


def test_programs_are_built_once_for_what_their_text_names(texts):
    place = place_of()
    before = workplace._build.cache_info().misses
    for strange in (1, 2):
        place.kernels("lines", ("line",), {"PLUS": 100, "STRANGE": strange}, MORE + "// once\n")
    assert workplace._build.cache_info().misses == before + 1
    place.kernels("lines", ("line",), {"PLUS": 100}, MORE + "// another\n")
    assert workplace._build.cache_info().misses == before + 2


def test_a_kernel_that_is_none_is_one_sentence(texts):
    with pytest.raises(Error, match=r"does not build a kernel: .*this_is_not_there"):
        place_of().kernels("wrong", ("wrong",))
