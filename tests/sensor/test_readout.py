"""The readout against queueing theory and by hand."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from clsim.errors import InputError
from clsim.opencl.device import choose_device
from clsim.opencl.workplace import Grid, Workplace
from clsim.sensor import SensorSettings
from clsim.sensor.pixel import REQUEST
from clsim.sensor.pixel_stages import Delay, Refractory
from clsim.sensor.readout import Bus, Pool
from clsim.sensor.settings import Readout
from tests.sensor.benchtop import SPLITS, Benchtop, with_stages

END_NS = 10**9


def bus(height=64, **numbers):
    device = choose_device()
    return Bus(Workplace(device, Grid(64, height, device.lanes, np.float32), device.queue()), Readout(**numbers))


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
    # Whoever may not wait at all is lost where the bus is busy.
    served, lost = bus(event_us=1.0, most_wait_us=0.0).run(requests_at([1000, 1000, 1500, 2000]), END_NS)
    assert served["t"].tolist() == [2000, 3000] and lost == 2
    asked = requests_at([1000] * 4)
    asked["y"] = range(4)
    served, lost = bus(arbiter="rows", row_us=1.0, most_wait_us=2.0).run(asked, END_NS)
    assert served["t"].tolist() == [2000, 3000, 4000] and lost == 1


def test_a_scan_reads_column_after_column():
    asked = requests_at([1000] * 40, rows=8)
    read = bus(scan_us=500.0).run(asked, END_NS)[0]
    places = list(zip((-read["x"].astype(int)).tolist(), read["y"].tolist(), strict=True))
    assert places == sorted(set(zip((-asked["x"].astype(int)).tolist(), asked["y"].tolist(), strict=True)))


def test_columns_of_a_scan_bear_times_of_their_own():
    asked = requests_at([1000, 499_000, 500_000, 500_001], rows=8)
    asked["x"], asked["y"] = (63, 0, 10, 10), 5
    read, lost = bus(scan_us=500.0, column_us=2.0).run(asked, END_NS)
    assert lost == 0 and read["t"].tolist() == [500_000, 500_000 + 53 * 2000, 500_000 + 63 * 2000, 1_106_000]
    # 64 columns take longer than such a period: the next scan begins when they are through.
    read = bus(8, scan_us=100.0, column_us=2.0).run(asked, END_NS)[0]
    assert read["t"].tolist() == [128_000, 512_000 + 53 * 2000, 512_000 + 63 * 2000]


def test_another_row_takes_longer():
    same, other = (
        bus(event_us=1.0, row_us=3.0).run(requests_at([1000] * 10, rows=rows), END_NS)[0] for rows in (1, 64)
    )
    assert same["t"].tolist() == [1000 + 3000 + 1000 * k for k in range(1, 11)]
    changes = 1 + np.count_nonzero(np.diff(other["y"].astype(int)))
    assert other["t"][-1] == 1000 + 10 * 1000 + 3000 * changes


def event_reads(requests, event_ns, row_ns, most_ns):
    """Return when each request is served by a bus that takes events one by one, None if it is lost."""
    free, row, times = 0, None, []
    for t, y in zip(requests["t"].tolist(), requests["y"].tolist(), strict=True):
        begin = max(t, free)
        served = begin - t <= most_ns
        free = begin + event_ns + (0 if y == row else row_ns) if served else free
        row = y if served else row
        times.append(free if served else None)
    return times


@given(
    st.lists(st.tuples(st.integers(1, 4000), st.integers(0, 2)), max_size=60),
    st.integers(10, 90),
    st.integers(0, 300),
    st.sampled_from([None, 0.0, 0.05, 0.4]),
    st.lists(st.integers(0, 4000), max_size=3),
)
@settings(max_examples=60, deadline=None)
def test_events_are_served_as_they_come_and_take_longer_in_another_row(asked, event_ns, row_ns, most_us, cuts):
    """Whose row was last is known from call to call: where these end changes nothing."""
    requests = np.zeros(len(asked), REQUEST)
    requests["t"], requests["y"] = np.array(sorted(asked), np.int64).reshape(-1, 2).T
    expected = event_reads(requests, event_ns, row_ns, np.inf if most_us is None else 1000 * most_us)
    chip = bus(event_us=event_ns / 1000, row_us=row_ns / 1000, most_wait_us=most_us)
    found, lost = [], 0
    for begin, end in pairwise([0, *sorted(cuts), 5000]):
        part = requests[(requests["t"] > begin) & (requests["t"] <= end)]
        served, gone = chip.run(part, end)
        found += served["t"].tolist()
        lost += gone
    assert found == [t for t in expected if t is not None] and lost == expected.count(None)


def row_reads(requests, event_ns, row_ns, most_ns, shared):
    """Return when each request is served by an arbiter of rows, None if it is lost: told anew, event by event."""
    waiting, free, times, i = [], 0, [None] * len(requests), 0
    asked = [(int(r["t"]), int(r["y"]), int(r["x"])) for r in requests]
    while waiting or i < len(asked):
        begin = max(free, asked[waiting[0]][0]) if waiting else None
        if begin is None or (i < len(asked) and asked[i][0] <= begin):
            if asked[i][1:] not in [asked[k][1:] for k in waiting]:
                waiting.append(i)
            i += 1
            continue
        row = asked[waiting[0]][1]
        read = [k for k in waiting if asked[k][1] == row]
        waiting = [k for k in waiting if asked[k][1] != row]
        read = [k for k in read if begin - asked[k][0] <= most_ns]
        for nth, k in enumerate(read, 1):
            times[k] = begin + row_ns + (0 if shared else nth * event_ns)
        free = begin + row_ns + len(read) * event_ns
    return times


@given(
    st.lists(st.tuples(st.integers(1, 4000), st.integers(0, 3), st.integers(0, 2)), max_size=60),
    st.integers(0, 90),
    st.integers(10, 300),
    st.sampled_from([None, 0.05, 0.4]),
    st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_rows_are_read_as_they_asked_first_and_all_that_waits_in_one_together(asked, event_ns, row_ns, most_us, shared):
    requests = np.zeros(len(asked), REQUEST)
    for name, values in zip(("t", "y", "x"), zip(*asked, strict=True), strict=False):
        requests[name] = values
    requests = requests[np.lexsort((requests["x"], requests["y"], requests["t"]))]
    numbers = {"event_us": event_ns / 1e3, "row_us": row_ns / 1e3, "most_wait_us": most_us, "row_stamps": shared}
    times = row_reads(requests, event_ns, row_ns, 10**9 if most_us is None else round(1e3 * most_us), shared)
    whole, lost = bus(arbiter="rows", **numbers).run(requests, END_NS)
    assert lost == times.count(None)
    expected = sorted((t, *r.tolist()[1:3]) for t, r in zip(times, requests, strict=True) if t is not None)
    assert sorted(zip(*(whole[name].tolist() for name in ("t", "x", "y")), strict=True)) == expected
    assert (np.diff(whole["t"]) >= 0).all()
    parts, part, gone = [], bus(arbiter="rows", **numbers), 0
    for begin, end in pairwise((0, 700, 701, 2500, END_NS)):
        read, more = part.run(requests[(requests["t"] > begin) & (requests["t"] <= end)], end)
        parts.append(read)
        gone += more
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    assert gone == lost


def test_rows_that_all_ask_always_are_read_once_a_round():
    # Each of 64 rows has 8 pixels that ask every µs; a row takes 100 ns and 5 an event: a round takes 64 · 140 ns.
    times = np.repeat(np.arange(1, 2001) * 1000, 512)
    asked = np.zeros(len(times), REQUEST)
    asked["t"], asked["x"], asked["y"] = times, np.tile(np.arange(512) // 64, 2000), np.tile(np.arange(512) % 64, 2000)
    read, lost = bus(arbiter="rows", row_us=0.1, event_us=0.005, row_stamps=True).run(asked, 2_000_000)
    assert np.diff(np.unique(read["t"])).tolist() == [140] * (len(read) // 8 - 1)
    of_one = np.diff(np.unique(read["t"][read["y"] == 5]))
    assert of_one.mean() == pytest.approx(64 * 140, rel=0.05) and of_one.max() < 70 * 140
    assert len(np.unique(read["t"])) == len(np.unique(read[["t", "y"]]))  # one row a time
    # What a pixel asks while it waits is lost: all but one of the 8.96 a round.
    assert lost / len(asked) == pytest.approx(1 - 1 / 8.96, abs=0.005)


def test_a_scan_reads_what_a_pixel_fired_first_and_what_is_due_is_passed_on_at_once():
    asked = requests_at([100, 200, 300_000], rows=1)
    asked["x"], asked["on"] = 3, [1, 0, 0]
    read, lost = bus(scan_us=100.0).run(asked, END_NS)
    assert read["on"].tolist() == [1, 0] and lost == 1
    pool = Pool(REQUEST)
    assert len(pool.pass_on(asked, 200)) == 2 and len(pool.pass_on(asked[:0], 300_000)) == 1


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


def test_a_period_of_the_controller_need_not_be_whole_microseconds():
    served, lost = bus(control_period_us=1.5, most_in_period=1).run(
        requests_at([200, 1600, 2900, 3100, 4400, 4500]), END_NS
    )
    assert served["t"].tolist() == [200, 1600, 3100, 4500] and lost == 2


def test_the_controller_lets_so_many_pass_in_each_period():
    asked = poisson(1e5)
    served, lost = bus(control_period_us=200.0, most_in_period=10).run(asked, END_NS)
    counts = np.bincount(served["t"] // 200_000, minlength=5000)
    expected = np.minimum(np.bincount(asked["t"] // 200_000, minlength=5000), 10)
    np.testing.assert_array_equal(counts, expected)
    assert lost == len(asked) - counts.sum() > 10_000


IN_TURN = pytest.mark.parametrize(
    "numbers",
    [
        {"event_us": 1.0, "row_us": 2.0, "most_wait_us": 20.0},
        {"scan_us": 700.0},
        {"control_period_us": 300.0, "most_in_period": 20},
        {"scan_us": 300.0, "event_us": 1.0, "control_period_us": 1000.0, "most_in_period": 200},
        {"scan_us": 300.0, "column_us": 4.0, "event_us": 1.0},
        {"arbiter": "rows", "row_us": 5.0, "event_us": 0.5, "row_stamps": True, "most_wait_us": 200.0},
        {"arbiter": "rows", "row_us": 5.0, "event_us": 1.0, "control_period_us": 500.0, "most_in_period": 100},
    ],
)


@IN_TURN
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


@IN_TURN
def test_a_bus_that_has_forgotten_all_is_as_new(numbers):
    """What waited at 20 ms is gone, and so are the controller's count and whose turn it was."""
    asked = poisson(3e5)
    asked = asked[asked["t"] < 3 * 10**7]
    expected, lost = bus(**numbers).run(asked, 3 * 10**7)
    used = bus(**numbers)
    used.run(asked[asked["t"] <= 20_050_000], 20_050_000)
    used.forget()
    found, lost_there = used.run(asked, 3 * 10**7)
    np.testing.assert_array_equal(found, expected)
    assert lost_there == lost


def test_stamps_are_multiples_and_every_event_comes_once_whatever_the_frame_rate():
    sensor = replace(
        with_stages(noise={"on_hz": 40.0, "off_hz": 20.0}),
        readout=Readout(
            event_us=5.0, row_us=5.0, most_wait_us=300.0, control_period_us=1000.0, most_in_period=60, stamp_us=100
        ),
    )
    found = []
    for times_us in SPLITS.values():
        bench = Benchtop(sensor, 40, 30)
        found.append(bench.along(times_us, [0.0] * len(times_us)))
    assert len(found[0]) > 5000 and (found[0]["t"] % 100 == 0).all()
    for events in found[1:]:
        np.testing.assert_array_equal(events, found[0])


def test_a_perfect_readout_leaves_no_trace():
    assert SensorSettings(readout=Readout(control_period_us=100.0)).is_ideal
    assert not SensorSettings(readout=Readout(stamp_us=10)).is_ideal


@pytest.mark.parametrize(("delay_us", "stamp_us"), [(300.0, 1), (1e-9, 1000)])
@pytest.mark.parametrize("restarts", [False, True])
def test_after_a_restart_nothing_is_on_its_way_off_the_chip(delay_us, stamp_us, restarts):
    """Neither what is late nor what waits for its stamp."""
    slow = replace(with_stages(), refractory=Refractory(500.0), delay=Delay(delay_us, 0.0))
    bench = Benchtop(replace(slow, readout=Readout(stamp_us=stamp_us)), 4)
    bench.to(0, 0.0)
    assert len(bench.to(500, 0.21)) == 0, "they cross after 476 µs"
    if restarts:
        bench.pixels.restart()
    assert len(bench.to(2000, 0.21)) == (0 if restarts else 4)


def test_periods_are_of_a_microsecond_at_least():
    shortest = Readout(scan_us=1.0, control_period_us=1.0)
    for name in ("scan_us", "control_period_us"):
        with pytest.raises(InputError, match=f"`{name}` must be at least 1 µs, got 0.9"):
            replace(shortest, **{name: 0.9})


@pytest.mark.parametrize(
    ("numbers", "told"),
    [
        ({"column_us": 1.0}, "`column_us` is of a scan"),
        ({"arbiter": "rows"}, "give `row_us`"),
        ({"arbiter": "columns"}, "`arbiter`"),
        ({"row_us": 1.0, "row_stamps": True}, "`row_stamps` needs rows"),
    ],
)
def test_numbers_that_do_not_go_together_are_refused(numbers, told):
    with pytest.raises(InputError, match=told):
        Readout(**numbers)
