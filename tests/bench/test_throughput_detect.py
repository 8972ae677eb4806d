"""The detector's bench: its figures and their shares."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from clsim.bench.throughput.detect import _Bench, detect_throughput, fit_flops


def test_figures_are_there_and_shares_are_of_what_they_say():
    figures = detect_throughput(width=64, height=48, window=5, seconds=0.02)
    rates = {name: value for name, value in figures.items() if name.endswith("_per_cpu_second")}
    assert len(rates) == 9 and all(value > 100 for value in rates.values())
    fits = figures["fits_per_cpu_second"]
    assert figures["float64_ratio"] == pytest.approx(figures["float64_fits_per_cpu_second"] / fits)
    # Seven features beside the place of the pixel.
    assert figures["fma_peak_fraction"] == pytest.approx(fits * fit_flops(5, 7) / figures["fma_peak_flops"])
    assert 0 < figures["fma_peak_fraction"] < 1 and figures["device"]


def test_a_rate_is_that_of_the_fastest_round_however_slow_the_last():
    """Other programs take their share of the machine at times."""
    clock = iter([0.0, 1.0, 1.0, 1.5, 2.0, 6.0])
    bench = SimpleNamespace(seconds=5.0, clock=lambda: next(clock))
    assert _Bench.rate(bench, lambda: None, lambda: None, 10.0) == 20.0
