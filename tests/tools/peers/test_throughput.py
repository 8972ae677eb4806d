"""What is measured beside clsim's own throughput, and that Mitsuba renders the same."""

from __future__ import annotations

import pytest

from clsim.bench.throughput.render_worlds import bumpy_room, cornell
from tools.peers.throughput import beside_mitsuba, numpy_fits_per_cpu_second


def test_numpy_fits_are_counted() -> None:
    assert 100 < numpy_fits_per_cpu_second(side=8, window=5, rounds=1) < 1e6


@pytest.mark.oracle
@pytest.mark.usefixtures("llvm_mitsuba")
@pytest.mark.parametrize(
    ("world", "noise"), [(cornell(64), 0.001), (bumpy_room(20_000, 64), 0.005)], ids=["cornell", "bumpy"]
)
def test_mitsuba_renders_the_same(world, noise):
    """Within four times the noise of the difference, which was measured over seeds."""
    result = beside_mitsuba(world, spp=512, rounds=1)
    radiance = result["mean_radiance"]
    assert abs(radiance["bvh16"] / radiance["mitsuba"] - 1) < 4 * noise
    assert result["mitsuba_ratio"] > 0 and result["mitsuba_cpu_ratio"] > 0
