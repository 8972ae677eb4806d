"""Mitsuba and the published method, end to end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.bench.throughput.detect import noise_frame
from clsim.render import RenderOptions
from clsim.scene import load_world
from tools.peers.chain import SPP, chain_config, run_chain, time_plain


def test_windows_of_a_run_are_timed() -> None:
    config = chain_config(load_world("two-boxes").sensor)
    assert (config.gate, config.side, config.event_rule) == ("published", 13, "frame")
    cost = time_plain(noise_frame(24, 20), noise_frame(24, 20), config, sampled=30)
    assert cost.sampled == 30 and cost.gate_s > 0 and cost.fit_s > 0


@pytest.mark.oracle
@pytest.mark.usefixtures("llvm_mitsuba")
def test_all_of_the_chain_is_counted() -> None:
    world = load_world("cornell", resolution=(16, 12))
    told: list[int] = []
    options = RenderOptions(spp=SPP, frames=4, fps=10.0, noise="independent")
    chain = run_chain(world, None, options, chain_config(world.sensor), lambda: told.append(1))
    costs = chain.costs()
    assert len(told) == 4 and costs["paths"] == 16 * 12 * 4 * SPP
    assert chain.gates == 16 * 12 * 3 and 16 * 12 <= chain.fits < 16 * 12 * 4
    assert costs["detect_cpu_s"] == chain.fits * chain.plain.fit_s + chain.gates * chain.plain.gate_s
    assert costs["startup_cpu_s"] > 0 and costs["render_cpu_s"] > 0
    assert len(chain.events) > 0 and set(chain.events["t"]) <= {100_000, 200_000, 300_000}
    calm = replace(chain_config(world.sensor), threshold_on=1e6, threshold_off=1e6)
    still = run_chain(world, None, replace(options, frames=2), calm, lambda: None)
    assert (still.fits, still.gates) == (16 * 12, 16 * 12), "the first frame's fits, and no more"
    again = run_chain(world, None, options, chain_config(world.sensor), lambda: None)
    np.testing.assert_array_equal(again.events, chain.events)
