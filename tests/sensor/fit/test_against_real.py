"""Simulated readouts beside real recordings, at their rates: what events of a row, and of a column, share."""

import numpy as np
import pytest

from clsim.events.files import open_source
from clsim.sensor import load_sensor
from clsim.sensor.lab import Lab
from clsim.sensor.statistics import read_statistics, statistics
from tests.sensor.fit.real import REAL

pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="no real recordings beside this checkout")


def drifting(sensor, size, speed, patch):
    """Return the stream of patches that drift before a camera for 12 ms, its last 8, and how many events were lost."""
    width, height = size
    lab = Lab(sensor, width, height, seed=2)
    drawn = np.random.default_rng(0).choice([-0.6, 0.6], (height // patch, width // patch))
    tile = np.kron(drawn, np.ones((patch, patch)))
    found, lost = [], 0
    for time_us in range(0, 12_001, 200):
        whole, part = divmod(1e-6 * speed * time_us, 1)
        near = np.roll(tile, int(whole), 1)
        fired = lab.to(time_us, (1 - part) * near + part * np.roll(near, 1, 1))
        if time_us > 4000:
            found.append(fired.events.copy())
            lost += fired.lost
    return np.concatenate(found), lost


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "file", "size", "speed", "patch"),
    [("gen3.1", "gen3b-640x480.raw", (640, 480), 145.0, 20), ("gen4.1", "gen4.1-1280x720.raw", (1280, 720), 170.0, 10)],
)
def test_rows_share_their_times_as_in_a_real_recording_of_that_rate(name, file, size, speed, patch):
    with open_source(REAL / file) as source:
        real = read_statistics(source, *size)[0]
    events, lost = drifting(load_sensor(name), size, speed, patch)
    ours = statistics(events, *size)
    assert ours.events_per_s == pytest.approx(real.events_per_s, rel=0.1)
    for number in ("shared_time", "row_mates", "one_row"):
        assert getattr(ours, number) == pytest.approx(getattr(real, number), abs=0.05), number
    # A row is read again so soon that hardly a pixel fires twice before.
    assert lost < 1e-3 * len(events)
