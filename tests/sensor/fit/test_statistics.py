"""Statistics of streams against streams made by hand, and against what was read of real recordings."""

import math

import numpy as np
import pytest

from clsim.events import EVENT_DTYPE
from clsim.events.files import open_source
from clsim.sensor.statistics import LONELY_US, distances, read_statistics, statistics
from tests.sensor.fit.real import REAL


def stream(*events):
    return np.array(list(events), dtype=EVENT_DTYPE)


# Two pixels of row 1 at once, one of row 2 at that time, then three more of (3, 1) that flip twice.
HANDMADE = stream(
    (0, 3, 1, True), (0, 4, 1, True), (0, 4, 2, False), (100, 3, 1, False), (300, 3, 1, False), (1000, 3, 1, True)
)  # fmt: skip


def test_counts_rates_and_shares():
    found = statistics(HANDMADE, 10, 5)
    assert (found.events, found.duration_s, found.active_pixels) == (6, 0.001, 3)
    assert found.events_per_s == pytest.approx(6000) and found.events_per_pixel_s == pytest.approx(120)
    assert found.active_share == pytest.approx(3 / 50) and found.on_share == 0.5
    assert statistics(HANDMADE).active_share is None
    assert statistics(HANDMADE).events_per_pixel_s == pytest.approx(2000)


def test_intervals_are_those_of_a_pixel_whatever_fires_between():
    low, middle, high = statistics(HANDMADE).interval_us
    assert middle == 200 and low == pytest.approx(102) and high == pytest.approx(690)
    ramp = stream(*((k * 50, k % 7, 0, True) for k in range(700)))
    assert statistics(ramp).interval_us == (350, 350, 350)


def test_polarity_flips_are_those_of_a_pixel():
    assert statistics(HANDMADE).opposite_next == pytest.approx(2 / 3)
    assert statistics(stream((0, 0, 0, True), (1, 1, 0, False), (2, 0, 0, True))).opposite_next == 0


def test_times_that_events_share():
    assert statistics(HANDMADE).shared_time == 0.5
    # Neighbours in a row are the first two, and the last three: of the three pairs one has one time.
    assert statistics(HANDMADE).row_mates == pytest.approx(1 / 3)
    # Neighbours in a column: the second and the third, at once; then those of (3, 1), at times of their own.
    assert statistics(HANDMADE).column_mates == pytest.approx(1 / 3)
    assert statistics(stream((0, 0, 0, True), (0, 9, 9, True), (1, 0, 0, True))).row_mates is None


def test_events_of_one_time_lie_in_one_row_or_not():
    # At 0: two of row 1 and one of row 2; two of column 4 and one of column 3.
    assert statistics(HANDMADE).one_row == statistics(HANDMADE).one_column == 0.5
    assert statistics(HANDMADE[[0, 2, 1]]).one_row == 0.5  # whatever the order of the stream
    row = stream(*((k // 4, k, 1, True) for k in range(8)))
    column = stream(*((k // 4, 1, k, True) for k in range(8)))
    assert (statistics(row).one_row, statistics(row).one_column) == (1, 0)
    assert (statistics(column).one_row, statistics(column).one_column) == (0, 1)
    assert statistics(HANDMADE[3:]).one_row is None


@pytest.mark.parametrize("dy", (-1, 0, 1))
@pytest.mark.parametrize("dx", (-1, 0, 1))
def test_an_event_is_lonely_unless_a_neighbour_fired_lately(dx, dy):
    alone = 1.0 if (dx, dy) == (0, 0) else 0.5
    assert statistics(stream((0, 5, 5, True), (LONELY_US, 5 + dx, 5 + dy, False))).lonely == alone
    assert statistics(stream((0, 5, 5, True), (LONELY_US + 1, 5 + dx, 5 + dy, False))).lonely == 1


def test_what_is_two_pixels_off_or_on_the_other_side_of_the_picture_is_no_neighbour():
    assert statistics(stream((0, 5, 5, True), (1, 7, 5, True))).lonely == 1
    assert statistics(stream((0, 9, 0, True), (1, 0, 1, True))).lonely == 1
    assert statistics(stream((0, 0, 1, True), (1, 9, 0, True))).lonely == 1


def test_lonely_events_are_those_that_a_search_of_all_pairs_finds():
    random = np.random.default_rng(3)
    events = np.zeros(600, EVENT_DTYPE)
    events["t"] = np.sort(random.integers(0, 200_000, 600))
    events["x"], events["y"] = random.integers(0, 9, 600), random.integers(0, 7, 600)
    t, x, y = (events[name].astype(int) for name in "txy")
    age = t[:, None] - t
    close = (abs(x[:, None] - x) <= 1) & (abs(y[:, None] - y) <= 1) & ((x[:, None] != x) | (y[:, None] != y))
    lonely = ~(close & (age >= 0) & (age <= LONELY_US)).any(axis=1)
    assert 0.05 < lonely.mean() < 0.95
    assert statistics(events).lonely == lonely.mean()


def test_the_hottest_pixels_are_a_hundredth_of_those_that_fire():
    events = np.zeros(1000, EVENT_DTYPE)
    # 200 pixels: two fire 301 times, 198 fire twice or once.
    events["x"] = np.r_[np.zeros(301), np.ones(301), np.resize(np.arange(2, 200), 398)]
    assert statistics(events).hottest == 0.602


def test_few_events_leave_what_cannot_be_told_untold():
    nothing, one = statistics(np.zeros(0, EVENT_DTYPE), 4, 4), statistics(stream((7, 0, 0, True)), 4, 4)
    assert (nothing.events, nothing.events_per_s, nothing.on_share, nothing.lonely) == (0, None, None, None)
    assert nothing.active_share == 0 and nothing.hottest is None and nothing.interval_us is None
    assert (one.duration_s, one.events_per_s, one.interval_us, one.shared_time, one.lonely) == (0, None, None, 0, 1)


def test_distances_are_differences_of_shares_and_decades_of_rates_and_times():
    slow = HANDMADE.copy()
    slow["t"] *= 10
    slow["on"] = True
    apart = distances(statistics(HANDMADE, 10, 5), statistics(slow, 10, 5))
    assert apart["events_per_s"] == apart["events_per_pixel_s"] == pytest.approx(1)
    assert apart["interval_us"] == pytest.approx((1, 1, 1))
    assert apart["on_share"] == 0.5 and apart["active_share"] == 0
    assert distances(statistics(HANDMADE), statistics(slow, 10, 5))["active_share"] is None
    twice = statistics(stream((0, 0, 0, True), (0, 0, 0, True), (5, 0, 0, True)))
    assert distances(twice, statistics(slow))["interval_us"][0] > 1
    assert distances(statistics(HANDMADE[:3]), statistics(slow))["events_per_s"] is None
    assert math.isinf(
        distances(statistics(stream((0, 0, 0, True), (0, 0, 0, True))), statistics(slow))["interval_us"][0]
    )


def test_so_many_events_are_read_and_it_is_told_if_there_are_more():
    parts = [HANDMADE[:2], HANDMADE[2:]]
    assert read_statistics(parts) == (statistics(HANDMADE), False)
    for most in (2, 4):
        assert read_statistics(parts, most=most) == (statistics(HANDMADE[:most]), True)
    assert read_statistics(parts, most=6) == (statistics(HANDMADE), False)
    assert read_statistics([])[0].events == 0


@pytest.mark.skipif(not REAL.is_dir(), reason="no real recordings beside this checkout")
@pytest.mark.parametrize(
    ("name", "events", "seconds", "shared", "row_mates"),
    [
        ("gen3-640x480.raw", 521_252, 0.096, 0.98, 0.95),
        ("gen3b-640x480.raw", 539_481, 0.050, 1.00, 0.96),
        ("gen4.1-1280x720.raw", 219_596, 0.0088, 1.00, 1.00),
        ("dvs-320x240.es", 473_225, 1.0, 1.00, 1.00),
        ("sample-320x240.aedat4", 111_954, 0.59, 0.38, 0.11),
    ],
)
def test_real_recordings_are_as_their_table_has_them(name, events, seconds, shared, row_mates):
    with open_source(REAL / name) as source:
        found, more = read_statistics(source)
    assert not more and found.events == events and found.duration_s == pytest.approx(seconds, rel=0.01)
    assert found.shared_time == pytest.approx(shared, abs=0.005)
    assert found.row_mates == pytest.approx(row_mates, abs=0.005)


@pytest.mark.parametrize(("pixels", "most"), [(1, 1), (40, 1), (140, 1), (160, 2), (1_000, 10)])
def test_the_hottest_are_the_busiest_hundredth_of_those_that_fire(pixels, most):
    """Pixel k fires k + 1 times; of how many there are a hundredth is taken, to the nearest whole one."""
    counts = np.arange(pixels) + 1
    events = np.zeros(counts.sum(), EVENT_DTYPE)
    events["x"] = np.repeat(np.arange(pixels), counts)
    assert statistics(events).hottest == pytest.approx(counts[-most:].sum() / counts.sum())
