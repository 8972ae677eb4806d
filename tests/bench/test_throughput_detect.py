"""The detector's bench: its figures and their shares."""

from __future__ import annotations

import pytest

from clsim.bench.throughput.detect import detect_throughput, fit_flops


def test_figures_are_there_and_shares_are_of_what_they_say():
    figures = detect_throughput(width=64, height=48, window=5, seconds=0.02)
    rates = {name: value for name, value in figures.items() if name.endswith("_per_cpu_second")}
    assert len(rates) == 9 and all(value > 100 for value in rates.values())
    fits = figures["fits_per_cpu_second"]
    assert figures["float64_ratio"] == pytest.approx(figures["float64_fits_per_cpu_second"] / fits)
    # Seven features beside the place of the pixel.
    assert figures["fma_peak_fraction"] == pytest.approx(fits * fit_flops(5, 7) / figures["fma_peak_flops"])
    assert 0 < figures["fma_peak_fraction"] < 1 and figures["device"]
