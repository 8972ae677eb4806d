"""The readout against queueing theory and by hand."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

from clsim.opencl.device import choose_device
from clsim.opencl.workplace import Grid, Workplace
from clsim.sensor import SensorSettings
from clsim.sensor.pixel import REQUEST
from clsim.sensor.readout import Bus
from clsim.sensor.settings import Readout
from tests.sensor.benchtop import SPLITS, Benchtop, with_stages

END_NS = 10**9


def bus(**numbers):
    device = choose_device()
    return Bus(Workplace(device, Grid(64, 64, device.lanes, np.float32), device.queue()), Readout(**numbers))


def requests_at(times_ns, seed=0, rows=64):
    generator = np.random.default_rng(seed)
    requests = np.zeros(len(times_ns), REQUEST)
    requests["t"] = np.sort(times_ns)
    for name, most in (("x", 64), ("y", rows), ("on", 2)):
        requests[name] = generator.integers(0, most, len(times_ns))
    return requests


def poisson(rate_hz, seed=1):
    """Return requests at random times of a second."""
    generator = np.random.default_rng(seed)
    return requests_at(generator.integers(1, END_NS, generator.poisson(rate_hz)), seed)


def test_events_wait_for_the_bus_as_queueing_theory_has_it():
    # Poisson requests, fixed service S, load rho: the mean wait is rho S / 2 (1 - rho).
    for load in (0.3, 0.7, 0.9):
        asked = poisson(load * 1e6)
        served, lost = bus(event_us=1.0).run(asked, END_NS)
        assert lost == 0
        waits = served["t"] - asked["t"] - 1000
        assert waits.min() >= 0 and waits.mean() == pytest.approx(load * 1000 / 2 / (1 - load), rel=0.1)


def test_a_bus_that_is_asked_for_more_than_it_can_loses_the_rest():
    # Ask for 4 million a second of a bus that has one.
    served, lost = bus(event_us=1.0, most_wait_us=50.0).run(poisson(4e6), END_NS)
    assert lost / (len(served) + lost) == pytest.approx(1 - 1 / 4, abs=0.002)
    assert np.diff(served["t"]).min() >= 1000


def test_who_waits_exactly_as_long_as_may_be_is_served():
    served, lost = bus(event_us=1.0, most_wait_us=2.0).run(requests_at([1000] * 4), END_NS)
    assert served["t"].tolist() == [2000, 3000, 4000] and lost == 1


def test_a_scan_reads_column_after_column():
    asked = requests_at([1000] * 40, rows=8)
    read = bus(scan_us=500.0).run(asked, END_NS)[0]
    places = list(zip(read["x"].tolist(), read["y"].tolist(), strict=True))
    assert places == sorted(set(zip(asked["x"].tolist(), asked["y"].tolist(), strict=True)))


def test_another_row_takes_longer():
    same, other = (
        bus(event_us=1.0, row_us=3.0).run(requests_at([1000] * 10, rows=rows), END_NS)[0] for rows in (1, 64)
    )
    assert same["t"].tolist() == [1000 + 3000 + 1000 * k for k in range(1, 11)]
    changes = 1 + np.count_nonzero(np.diff(other["y"].astype(int)))
    assert other["t"][-1] == 1000 + 10 * 1000 + 3000 * changes


def test_a_scan_stamps_its_own_times_and_reads_a_pixel_once():
    asked = poisson(2e4)
    served, lost = bus(scan_us=500.0).run(asked, END_NS)
    assert (served["t"] % 500_000 == 0).all()
    assert len(served) == len(np.unique(np.stack([-(-asked["t"] // 500_000), asked["x"], asked["y"]]), axis=1).T)
    assert lost == len(asked) - len(served) > 0
    alone = requests_at(np.sort(asked["t"]))
    alone["x"], alone["y"] = np.arange(len(alone)) % 64, np.arange(len(alone)) // 64 % 64
    waits = np.sort(bus(scan_us=500.0).run(alone, END_NS)[0]["t"]) - alone["t"]
    assert stats.kstest(waits / 500_000, "uniform").pvalue > 1e-3


def test_the_controller_lets_so_many_pass_in_each_period():
    asked = poisson(1e5)
    served, lost = bus(control_period_us=200.0, most_in_period=10).run(asked, END_NS)
    counts = np.bincount(served["t"] // 200_000, minlength=5000)
    expected = np.minimum(np.bincount(asked["t"] // 200_000, minlength=5000), 10)
    np.testing.assert_array_equal(counts, expected)
    assert lost == len(asked) - counts.sum() > 10_000


@pytest.mark.parametrize(
    "numbers",
    [
        {"event_us": 1.0, "row_us": 2.0, "most_wait_us": 20.0},
        {"scan_us": 700.0},
        {"control_period_us": 300.0, "most_in_period": 20},
        {"scan_us": 300.0, "event_us": 1.0, "control_period_us": 1000.0, "most_in_period": 200},
    ],
)
def test_calls_on_the_way_change_nothing(numbers):
    asked = poisson(3e5)
    asked = asked[asked["t"] < 10**8]
    whole, lost = bus(**numbers).run(asked, 10**8)
    parts, part, lost_there = [], bus(**numbers), 0
    cuts = [0, *sorted(np.random.default_rng(3).integers(1, 10**8, 30).tolist()), 10**8]
    for begin, end in pairwise(cuts):
        read, gone = part.run(asked[(asked["t"] > begin) & (asked["t"] <= end)], end)
        parts.append(read)
        lost_there += gone
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    assert lost == lost_there


def test_stamps_are_multiples_and_every_event_comes_once_whatever_the_frame_rate():
    settings = replace(
        with_stages(noise={"on_hz": 40.0, "off_hz": 20.0}),
        readout=Readout(
            event_us=5.0, row_us=5.0, most_wait_us=300.0, control_period_us=1000.0, most_in_period=60, stamp_us=100
        ),
    )
    found = []
    for times_us in SPLITS.values():
        bench = Benchtop(settings, 40, 30)
        found.append(bench.along(times_us, [0.0] * len(times_us)))
    assert len(found[0]) > 5000 and (found[0]["t"] % 100 == 0).all()
    for events in found[1:]:
        np.testing.assert_array_equal(events, found[0])


def test_a_perfect_readout_leaves_no_trace():
    assert SensorSettings(readout=Readout(control_period_us=100.0)).is_ideal
    assert not SensorSettings(readout=Readout(stamp_us=10)).is_ideal
