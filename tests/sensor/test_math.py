"""The kernels' own exponentials, logarithms and normal quantiles against numpy's and scipy's."""

import numpy as np
import pyopencl as cl
import pytest
from scipy import stats

from clsim.opencl.device import choose_device
from clsim.opencl.workplace import Grid, Workplace, _build, _read

KERNEL = """
__kernel void compute(__global const double *x, __global double *out, int n) {
    const int i = get_global_id(0);
    out[i] = quick_exp(x[i]);
    out[n + i] = quick_expm1(x[i]);
    out[2 * n + i] = quick_log(x[i]);
    out[3 * n + i] = normal_quantile(x[i]);
}
"""


def computed(x):
    """Return exp, expm1, log and the normal quantile of numbers, as kernels have them."""
    device = choose_device()
    place = Workplace(device, Grid(8, 1, device.lanes, np.float64), device.queue())
    types = _read("types.clh") + "#pragma OPENCL EXTENSION cl_khr_fp64 : enable\n"
    program = _build(device.context, types + _read("sensor/math.clh") + KERNEL, (("DOUBLE", 1), ("VW", device.lanes)))
    given, out = place.allocate((len(x),), np.float64), place.allocate((4, len(x)), np.float64)
    place.write(given, x)
    place.launch(cl.Kernel(program, "compute"), (len(x),), given, out, len(x))
    return place.read(out)


def test_they_are_as_exact_as_they_say():
    around = np.linspace(-1, 1, 2001)
    x = np.concatenate([np.linspace(-690, 690, 2001), around[around != 0]])
    exp, expm1, *_ = computed(x)
    assert exp == pytest.approx(np.exp(x), rel=1e-9) and expm1 == pytest.approx(np.expm1(x), rel=1e-9)
    x = np.exp(x)
    assert computed(x)[2] == pytest.approx(np.log(x), rel=1e-9)
    p = np.concatenate([np.logspace(-16, -0.31, 1000), 1 - np.logspace(-15, -0.31, 1000)])
    assert computed(p)[3] == pytest.approx(stats.norm.ppf(p), abs=1e-6)


def test_what_is_beyond_doubles_is_next_to_nothing_or_finite():
    assert (computed(np.array([-1e9, -701.0]))[0] < 1e-300).all()
    assert np.isfinite(computed(np.array([1e9]))[0]).all()
