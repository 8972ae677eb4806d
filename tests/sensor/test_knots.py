"""Brightness with knots within a step: the ideal pixel against a float64 walk."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from clsim.opencl.device import choose_device
from clsim.opencl.path import BrightnessPath, Knots
from clsim.opencl.workplace import Grid, Workplace
from clsim.sensor import IdealPixels, Thresholds
from clsim.sensor.reference.ideal import walk

STEP_US = 4000
ON, OFF = 0.25, 0.125
THRESHOLDS = Thresholds(ON, OFF)


def fire(starts, rows, ends, thresholds=THRESHOLDS, start_us=0, with_knots=True):
    """Return the events and references of pixels that go from ``starts`` over ``rows`` of (ns, level) to ``ends``."""
    device = choose_device()
    grid = Grid(len(starts), 1, device.lanes, np.float32)
    place = Workplace(device, grid, device.queue())
    pixels = IdealPixels(place, thresholds)

    def held(values, dtype=np.float32, shape=None):
        array = np.zeros(max(1, len(values)) if shape is None else shape, dtype)
        array.reshape(-1)[: len(values)] = values
        buffer = place.allocate(array.shape, dtype)
        place.write(buffer, array)
        return buffer

    listed = held(np.arange(len(starts)), np.int32)
    start, end = (held(values, shape=grid.image_shape) for values in (starts, ends))
    pixels.step(BrightnessPath(start_us, start_us, start, start, listed, len(starts)))
    knots = Knots(
        held(np.cumsum([0, *map(len, rows)]), np.int32),
        held([time for row in rows for time, _ in row], np.int64),
        held([level for row in rows for _, level in row]),
    )
    path = BrightnessPath(start_us, start_us + STEP_US, start, end, listed, len(starts), knots if with_knots else None)
    fired = pixels.step(path)
    return fired, place.read(fired.crossings)[: len(starts)], place.read(pixels.references)[0, : len(starts)]


def told(events, x):
    return [(int(e["t"]), bool(e["on"])) for e in events if e["x"] == x]


def test_a_pixel_fires_on_its_way_up_and_down_again():
    # Up to 0.625 in the first millisecond and back: neither end shows it. From the reference 0.5 it goes down to 0.375,
    # 0.25, 0.125 and, at the very end, 0.
    fired, crossings, references = fire([0.0], [[(1_000_000, 0.625)]], [0.0])
    assert told(fired.events, 0) == [
        (400, True),
        (800, True),
        (2200, False),
        (2800, False),
        (3400, False),
        (4000, False),
    ]
    assert crossings.tolist() == [-6] and references.tolist() == [0.0]
    assert fired.many_crossings == 0 and fired.most_crossings == 0, "brightness is known in between"


def test_pixels_without_knots_fire_as_they_do_where_there_are_none():
    levels = np.random.default_rng(3).uniform(-1, 1, (2, 300)).astype(np.float32)
    rows = [[] for _ in range(299)] + [[(1, 0.0)]]
    plain, _, references = fire(*[levels[0]], rows, levels[1], start_us=7, with_knots=False)
    knotted, _, same = fire(levels[0], rows, levels[1], start_us=7)
    for events in (plain.events, knotted.events):
        assert len(events) > 300
    np.testing.assert_array_equal(*(e.events[e.events["x"] < 299] for e in (plain, knotted)))
    np.testing.assert_array_equal(references[:299], same[:299])


def test_knots_on_the_line_change_nothing():
    rows = [[(1_000_000, 0.25), (2_000_000, 0.5), (3_000_000, 0.75)], []]
    fired, _, references = fire([0.0, 0.0], rows, [1.0, 1.0])
    assert told(fired.events, 0) == told(fired.events, 1) == [(1000 * k, True) for k in (1, 2, 3, 4)]
    assert references.tolist() == [1.0, 1.0]


def test_between_knots_light_is_linear_where_it_is_asked_for():
    rule = Thresholds(ON, OFF, linear_light=True)
    fired, _, _ = fire([0.0], [[(1_000_000, 0.5)]], [0.25], rule)
    up, down = (1000 * np.expm1(0.25) / np.expm1(0.5), 1000 + 3000 * np.expm1(-0.125) / np.expm1(-0.25))
    assert told(fired.events, 0) == [(np.ceil(up), True), (1000, True), (np.ceil(down), False), (4000, False)]


def test_the_frame_rule_knows_the_end_alone():
    fired, _, _ = fire([0.0, 0.0], [[(1_000_000, 0.9)], [(1_000_000, 0.9)]], [0.0, 0.3], Thresholds(ON, OFF, True))
    assert told(fired.events, 0) == [] and told(fired.events, 1) == [(STEP_US, True)]


LEVEL = st.floats(-2, 2, width=32)
ROW = st.lists(st.tuples(st.integers(1, 1000 * STEP_US - 1), LEVEL), max_size=6, unique_by=lambda knot: knot[0]).map(
    sorted
)


@settings(max_examples=40)
@given(st.lists(st.tuples(LEVEL, ROW, LEVEL), min_size=1, max_size=40), st.sampled_from([0, 10**9]))
def test_kernels_walk_knots_as_the_reference_does(pixels, start_us):
    starts, rows, ends = zip(*pixels, strict=True)
    walks = [
        walk([(0.0, a), *((t * 1e-3, level) for t, level in row), (STEP_US, b)], a, ON, OFF) for a, row, b in pixels
    ]
    assume(all(margin > 1e-5 for _, _, margin in walks))
    fired, crossings, references = fire(starts, rows, ends, start_us=start_us)
    for x, (events, reference, _) in enumerate(walks):
        found = told(fired.events, x)
        assert [on for _, on in found] == [on for _, on, _ in events]
        # A stamp is the µs at or after the crossing; where brightness hardly moves, its rounding moves it by more.
        for (t, _), (exact_us, _, slope) in zip(found, events, strict=True):
            assert -1e-6 / slope - 1e-3 <= t - start_us - exact_us <= 1 + 1e-6 / slope
        assert crossings[x] == (len(events) if not events or events[-1][1] else -len(events))
        assert abs(references[x] - reference) < 1e-5
    order = np.lexsort((fired.events["x"], fired.events["t"]))
    np.testing.assert_array_equal(order, np.arange(len(order)))
