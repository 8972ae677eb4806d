"""How recordings are cut in quarters, of which the first two are to predict the others, and what pixels count."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from clsim.cli.output import sensor_fits
from clsim.events import EVENT_DTYPE
from clsim.events.files import open_sink


def test_each_event_of_each_recording_is_in_one_quarter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The last one too, and the time of all quarters is that of all recordings."""
    lasts_us, names = (4_000_000, 8_000_000), []
    for number, last_us in enumerate(lasts_us):
        events = np.zeros(4, EVENT_DTYPE)
        events["t"] = 1_000_000 + np.array((0, last_us * 3 // 10, last_us * 6 // 10, last_us))
        events["on"] = True
        names.append(str(tmp_path / f"{number}.npz"))
        sink = open_sink(Path(names[-1]), 4, 3)
        sink.write(events, int(events["t"][-1]) + 1)
        sink.close()
    kept = []
    monkeypatch.setattr(sensor_fits, "predicted", lambda quarters: (kept.extend(quarters), []))
    assert sensor_fits.predict(names, (4, 3)) == []
    assert [int(quarter.on.sum()) for quarter in kept] == [2, 2, 2, 2]
    assert [quarter.seconds for quarter in kept] == pytest.approx([sum(lasts_us) * 1e-6 / 4] * 4, abs=2e-6)


def test_a_pixel_that_is_hot_in_one_recording_counts_in_none(monkeypatch: pytest.MonkeyPatch) -> None:
    hot, counted = [[[True, False, False]], [[False, True, False]]], []
    shown = iter(np.array(hot))
    monkeypatch.setattr(sensor_fits, "_counted", lambda *_: (SimpleNamespace(on=np.zeros((1, 3))), (3, 1)))
    monkeypatch.setattr(sensor_fits, "fit_still", lambda counts: SimpleNamespace(hot=next(shown)))
    monkeypatch.setattr(sensor_fits, "rates_of", lambda light, counts, quiet: counted.append(quiet.tolist()))
    for name in ("fit_uniform", "uniform_rows", "noise_table", "sensor_file"):
        monkeypatch.setattr(sensor_fits, name, lambda *_: [])
    sensor_fits.fit_lights(["a", "b"], [1.0, 2.0], (3, 1), "mine", "a, b", None)
    assert counted == [[[False, False, True]]] * 2
