"""The plots of a sensor: how sure its rates are, and which numbers are nobody's measurement."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from clsim.cli.plots import sensor_plot
from clsim.sensor import SensorSettings, characteristics, load_sensor


class Panel:
    """Notes what is drawn with error bars."""

    def __init__(self) -> None:
        self.bars: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def errorbar(self, x: np.ndarray, y: np.ndarray, error: np.ndarray, *, label: str, **_: Any) -> None:
        self.bars[label] = y, error

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: None


def test_a_rate_of_noise_is_known_as_well_as_its_events_are_many(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of N events in a time T the rate is N / T ± √N / T (Poisson)."""
    counts, seconds = np.array([1.0, 4.0, 900.0]), 2.5
    watched = characteristics.PIXELS * seconds
    rates = characteristics.NoiseRates(np.array([1.0, 10.0, 100.0]), counts / watched, 4 * counts / watched, seconds)
    monkeypatch.setattr(characteristics, "noise_rates", lambda *_: rates)
    panel = Panel()
    sensor_plot._draw_noise(panel, SensorSettings(), 0)
    assert len(panel.bars) == 2
    for (rate, error), count in zip(panel.bars.values(), (counts, 4 * counts), strict=True):
        np.testing.assert_allclose(rate, count / watched)
        np.testing.assert_allclose(error, np.sqrt(count) / watched)


@pytest.mark.parametrize("source", ["guess", "guess: as small as can be", "shared", "shared by all presets", "as a.b"])
def test_what_is_a_guess_or_anothers_is_marked_however_it_is_said(source: str) -> None:
    settings = load_sensor("dvs128")
    name = next(name for name, told in settings.sources.items() if not told.startswith(("guess", "shared", "as ")))
    before = {line.split()[0] for line in sensor_plot._numbers(settings)[0] if "*" not in line}
    assert name in before
    sources = dict(settings.sources) | {name: source, "a.b": "guess"}
    object.__setattr__(settings, "sources", sources)
    marked = {line.split("*")[0].strip() for line in sensor_plot._numbers(settings)[0] if "*" in line}
    assert name in marked
