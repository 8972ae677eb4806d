"""The ideal pixel by hand: which events a change of brightness makes, and when."""

import numpy as np
import pytest

from clsim.opencl.device import choose_device
from clsim.opencl.path import BrightnessPath
from clsim.opencl.workplace import Grid, Workplace
from clsim.sensor import IdealPixels, Thresholds, ideal
from tests.sensor.benchtop import Benchtop, with_stages


class Strip:
    """A row of pixels that is told its levels."""

    def __init__(self, width, thresholds=Thresholds(0.25, 0.125)):  # noqa: B008 - it never changes
        device = choose_device()
        self.grid = Grid(width, 1, device.lanes, np.float32)
        self.place = Workplace(device, self.grid, device.queue())
        self.pixels = IdealPixels(self.place, thresholds)

    def step(self, start, end, start_us=1000, end_us=2000, listed=None):
        """Return what fires where levels go from ``start`` to ``end``, each a number or one for each pixel."""
        images = []
        for values in (start, end):
            image = np.zeros(self.grid.image_shape)
            image[0, : self.grid.width] = values
            images.append(self.place.allocate(image.shape))
            self.place.write(images[-1], image)
        chosen = np.arange(self.grid.width) if listed is None else np.array(listed)
        pixels = self.place.allocate((self.grid.span,), np.int32)
        self.place.write(pixels, np.pad(chosen, (0, self.grid.span - len(chosen))))
        return self.pixels.step(BrightnessPath(start_us, end_us, *images, pixels, len(chosen)))

    def references(self):
        return self.place.read(self.pixels.references)[0, : self.grid.width]


def listed(events):
    return [(int(e["t"]), int(e["x"]), int(e["y"]), bool(e["on"])) for e in events]


def test_events_are_stamped_when_the_line_crosses_the_threshold():
    strip = Strip(1)
    assert listed(strip.step(0.0, 0.0).events) == []
    events = strip.step(0.0, 0.625).events
    assert listed(events) == [(1400, 0, 0, True), (1800, 0, 0, True)]
    assert strip.references().tolist() == [0.5]
    # From 0.625 down to 0.125: 0.375, 0.25 and 0.125 are 1/2, 3/4 and all of the way.
    events = strip.step(0.625, 0.125, 2000, 3000).events
    assert listed(events) == [(2500, 0, 0, False), (2750, 0, 0, False), (3000, 0, 0, False)]
    assert strip.references().tolist() == [0.125]


def test_a_stamp_between_two_microseconds_is_the_later_one():
    strip = Strip(1)
    strip.step(0.0, 0.0)
    # A third of 1000 µs.
    assert listed(strip.step(0.0, 0.75, 0, 1000).events)[0] == (334, 0, 0, True)


def test_linear_light_stamps_events_when_light_and_not_its_logarithm_has_come_to_the_threshold():
    strip = Strip(2, Thresholds(0.25, 0.125, linear_light=True))
    strip.step(0.0, 0.0)
    # From 1 to e, and from 1 to 1/e.
    events = strip.step(0.0, [1.0, -1.0], 0, 10_000).events
    up = [np.ceil(1e4 * (np.exp(0.25 * k) - 1) / (np.e - 1)) for k in (1, 2, 3, 4)]
    down = [np.ceil(1e4 * (np.exp(-0.125 * k) - 1) / (1 / np.e - 1)) for k in range(1, 9)]
    np.testing.assert_allclose(events["t"][events["on"]], up, atol=1)
    np.testing.assert_allclose(events["t"][~events["on"]], down, atol=1)


def test_an_event_is_at_the_earliest_a_microsecond_after_the_start_and_at_the_latest_at_the_end():
    strip = Strip(2)
    strip.step(0.0, 0.0)
    # Pixel 0 was at the threshold already, pixel 1 reaches it at the very end.
    events = strip.step([0.25, 0.0], [0.3, 0.25], 5, 7).events
    assert listed(events) == [(6, 0, 0, True), (7, 1, 0, True)]


def test_the_frame_rule_stamps_the_end_and_takes_the_level():
    strip = Strip(3, Thresholds(0.25, 0.125, at_step_ends=True))
    strip.step(0.0, 0.0)
    events = strip.step(0.0, [0.9, -0.12, -0.13]).events
    assert listed(events) == [(2000, 0, 0, True), (2000, 2, 0, False)]
    np.testing.assert_allclose(strip.references(), [0.9, 0.0, -0.13], rtol=1e-6)


def test_a_pixel_without_a_reference_fires_nothing_and_takes_the_level():
    strip = Strip(2)
    fired = strip.step(np.nan, [3.0, -2.0])
    assert len(fired.events) == 0
    np.testing.assert_array_equal(strip.references(), [3.0, -2.0])
    assert strip.place.read(fired.crossings)[:2].tolist() == [0, 0]
    strip.pixels.forget()
    assert np.isnan(strip.references()).all()


def test_pixels_that_are_not_listed_stay_as_they_are():
    strip = Strip(3)
    strip.step(0.0, 0.0)
    fired = strip.step(0.0, 1.0, listed=[1])
    assert set(fired.events["x"]) == {1} and len(fired.events) == 4
    np.testing.assert_array_equal(strip.references()[[0, 2]], 0.0)


def test_what_fired_is_told_for_each_listed_pixel():
    strip = Strip(4)
    strip.step(0.0, 0.0)
    fired = strip.step(0.0, [0.5, 0.1, -0.125, 1.125])
    assert strip.place.read(fired.crossings)[:4].tolist() == [2, 0, -1, 4]
    assert (fired.many_crossings, fired.most_crossings, fired.capped) == (1, 4, 0)


def test_three_crossings_are_not_many():
    strip = Strip(2)
    strip.step(0.0, 0.0)
    assert strip.step(0.0, [0.75, 1.0]).many_crossings == 1


def test_a_portion_may_fill_the_buffers_to_the_last():
    strip = Strip(64, Thresholds(1e-3, 1e-3))
    strip.step(0.0, 0.0)
    fired = strip.step(0.0, 2.0)
    assert len(fired.events) == strip.pixels._capacity == 64_000
    assert np.bincount(fired.events["x"]).tolist() == [1000] * 64


def test_events_are_sorted_by_time_and_then_by_place():
    strip = Strip(300)
    strip.step(0.0, 0.0)
    events = strip.step(0.0, np.random.default_rng(0).uniform(-1, 1, 300)).events
    order = np.lexsort((events["x"], events["y"], events["t"]))
    assert len(events) > 300
    np.testing.assert_array_equal(order, np.arange(len(events)))


def test_more_events_than_buffers_hold_come_in_portions(monkeypatch):
    levels = np.random.default_rng(1).uniform(-0.5, 0.5, 1000)
    batches, capacities = [], []
    for portion in (1 << 20, 200):
        monkeypatch.setattr(ideal, "_PORTION", portion)
        strip = Strip(1000)
        strip.step(0.0, 0.0)
        batches.append(strip.step(0.0, levels).events)
        capacities.append(strip.pixels._capacity)
    assert capacities[1] == 200 and len(batches[1]) > 5 * 200
    np.testing.assert_array_equal(*batches)


def test_a_flash_is_capped_and_counted_without_overflow():
    strip = Strip(128, Thresholds(1e-12, 1e-12))
    strip.step(0.0, 0.0)
    fired = strip.step(0.0, 10.0)
    assert len(fired.events) == 128 * 1000
    assert fired.capped == 128 * (10**9 - 1000) > 2**31
    assert fired.most_crossings == 10**9 and fired.many_crossings == 128
    assert strip.pixels._capacity <= ideal._PORTION


@pytest.mark.parametrize("few", [0, 16])
def test_one_work_item_writes_what_many_do(few, monkeypatch):
    monkeypatch.setattr(ideal, "_FEW", few)
    levels = np.random.default_rng(2).uniform(-0.5, 0.5, 300)
    strip = Strip(300)
    strip.step(0.0, 0.0)
    fired = strip.step(0.0, levels)
    crossings = np.where(levels > 0, levels // 0.25, -(-levels // 0.125)).astype(int)
    assert np.bincount(fired.events["x"], minlength=300).tolist() == np.abs(crossings).tolist()
    assert strip.place.read(fired.crossings)[:300].tolist() == crossings.tolist()
    rise = levels[fired.events["x"]]
    rank = [np.count_nonzero(fired.events["x"][:i] == x) + 1 for i, x in enumerate(fired.events["x"])]
    expected = 1000 + np.ceil(1000 * np.array(rank) * np.where(rise > 0, 0.25, 0.125) / np.abs(rise))
    assert np.abs(fired.events["t"] - expected).max() <= 1
    sizes = np.where(crossings > 0, 0.25, 0.125)
    np.testing.assert_allclose(strip.references(), crossings * sizes, atol=1e-6)


@pytest.mark.parametrize("width", [1, 63, 64, 65, 200, 1025])
def test_every_listed_pixel_is_handled_once(width):
    strip = Strip(width)
    strip.step(0.0, 0.0)
    events = strip.step(0.0, 0.3).events
    assert sorted(events["x"].tolist()) == list(range(width))


@pytest.mark.parametrize("rest", [0.4, 0.9])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_pixel_with_faults_that_has_fired_all_that_it_may_goes_on_from_where_it_was(sign, rest):
    """After 1000 events and a part of a threshold more, the rest of that threshold is due; nothing was left out."""
    bench = Benchtop(with_stages(), 3, on=1e-3, off=1e-3)
    bench.to(0, 0.0)
    assert len(bench.to(1_000_000, sign * (1000 + rest) * 1e-3)) == 3000
    assert len(bench.to(2_000_000, sign * (1000.98) * 1e-3)) == 0
    events = bench.to(3_000_000, sign * 1001.02e-3)
    assert sorted(events["x"]) == [0, 1, 2] and set(events["on"]) == {sign > 0}
