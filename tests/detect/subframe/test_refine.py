"""Events between frames, with a tracer that knows its scene in closed form: objects that go over a wall."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detector import Detector
from clsim.frames import ALBEDO, COVERAGE, DEPTH, EMISSION, RADIANCE, Frame, Reflected, frame_time_us, page_aligned
from clsim.score.matching import Sampling, one_to_one
from clsim.sensor import SensorSettings, Specimen
from clsim.sensor.pixel_stages import FrontEnd, Noise, Refractory, Threshold

WIDTH, HEIGHT = 96, 8
NAMES = ("R", "G", "B")
CONFIG = DetectorConfig(method="esim", threshold_on=0.2, threshold_off=0.2)
PIXELS = np.arange(WIDTH * HEIGHT)


@dataclass
class Bars:
    """A dark wall, over which bright bars go to the right; a pixel sees the mean over its square."""

    speed_px: float
    bar_px: float = 0.3
    gap_px: float = 1e9
    first_px: float = -20.0
    wall: float = 0.1
    bar: float = 4.3
    day: float = 1.0
    names: tuple[str, ...] = NAMES
    lit: bool = True
    asked: int = 0

    def luminance(self, pixels, times_s):
        """Day comes slowly, so that no pixel is ever as bright as before: it would be at its threshold to the bit."""
        left = pixels % WIDTH - self.first_px - self.speed_px * times_s
        bars = self._covered(left + 1) - self._covered(left)
        return (self.wall + (self.bar - self.wall) * bars) * (1.0 + 0.3 * self.day * times_s)

    def _covered(self, x):
        """How much of the half line up to x is bars; the first one ends at 0, and others follow to its left."""
        period = self.bar_px + self.gap_px
        return np.where(x < 0, -(np.floor(-x / period) * self.bar_px + np.minimum(-x % period, self.bar_px)), 0.0)

    def trace(self, pixels, times_s):
        self.asked += len(pixels)
        return self.planes(pixels, times_s).astype(np.float32)

    def planes(self, pixels, times_s):
        return np.tile(self.luminance(pixels, times_s), (3, 1))

    def motion(self, start_s, end_s):
        """Bars move, the wall does not: what is seen at both ends and the longest way over the pixel."""
        way = self.speed_px * (end_s - start_s)
        seen = [self.luminance(PIXELS, t) > self.wall + 1e-9 for t in (start_s, end_s)]
        moved = np.stack([*seen, np.ones(len(PIXELS))]).reshape(3, HEIGHT, WIDTH) * way
        return np.stack([moved, np.zeros_like(moved)], axis=1).astype(np.float32)

    def cancel(self):
        pass

    def close(self):
        pass


def run(scene, fps, tolerance_us=None, duration_s=0.1, specimen=None, config=CONFIG, way_px=None, size=(WIDTH, HEIGHT)):
    tracer = None if tolerance_us is None and way_px is None else scene
    options = {"tracer": tracer, "tolerance_us": tolerance_us or 0.0, "way_px": way_px}
    detector = Detector(config, *size, scene.names, specimen=specimen, **options)
    frame = Frame(page_aligned((len(scene.names), *size[::-1])), scene.names)
    events = []
    for index in range(round(duration_s * fps) + 1):
        frame.time_us, frame.index = frame_time_us(index, fps), index
        planes = scene.planes(PIXELS, np.full(len(PIXELS), frame.time_us * 1e-6))
        frame.planes[:] = planes.reshape(frame.planes.shape)
        events.append(detector.step(frame).copy())
    stats = detector.stats
    detector.close()
    return np.concatenate(events), stats


def errors(events, reference, within_us=1000):
    return np.abs(one_to_one(events, reference, Sampling(WIDTH, HEIGHT, 30.0), within_us))


def test_a_thin_bar_that_comes_and_goes_between_frames_fires_where_it_goes():
    """1000 px/s and 0.3 px wide: at 30 frames a second no pixel shows it twice, and most never."""
    scene = Bars(1000.0)
    reference, _ = run(scene, 15_000)
    alone, _ = run(scene, 30)
    events, stats = run(scene, 30, 10.0)
    places = [np.unique(batch["x"] + WIDTH * batch["y"].astype(int)) for batch in (events, reference)]
    assert len(reference) > 5 * WIDTH * HEIGHT and len(alone) < 0.1 * len(reference)
    assert len(np.intersect1d(*places)) >= 0.99 * len(places[1])
    found = errors(events, reference)
    assert len(found) >= 0.98 * len(reference) and np.median(found) <= 40
    assert scene.asked < 4 * len(events) and stats.many_crossings == 0


@pytest.mark.parametrize("way_px", [0.9, 2.0, 7.0])
def test_between_whole_pictures_nothing_goes_farther_than_asked(monkeypatch, way_px):
    """33.3 px from frame to frame, or by less if that makes no whole number of pictures."""
    scene, times_s, trace = Bars(1000.0), set(), Bars.trace
    monkeypatch.setattr(Bars, "trace", lambda *given: times_s.update(given[2].tolist()) or trace(*given))
    run(scene, 30, duration_s=2 / 30, way_px=way_px)
    pictures_s = sorted(times_s | {frame_time_us(index, 30) * 1e-6 for index in range(3)})
    ways_px = scene.speed_px * np.diff(pictures_s)
    assert 0.8 * way_px < ways_px.max() < way_px + 2e-3


@pytest.mark.parametrize(("on", "off"), [(0.2, 0.6), (0.6, 0.2)])
@pytest.mark.parametrize("rises", [True, False])
def test_each_polarity_has_its_own_threshold_between_frames_too(on, off, rises):
    """An edge after which it is brighter, or darker, by 0.3 or 0.9: past one threshold, or both."""
    config = replace(CONFIG, threshold_on=on, threshold_off=off)
    for contrast in (0.3, 0.9):
        wall, bar = (0.1, 0.1 * np.exp(contrast)) if rises else (0.1 * np.exp(contrast), 0.1)
        scene = Bars(700.0, bar_px=1e9, wall=wall, bar=bar, day=0.0)
        reference, _ = run(scene, 15_000, config=config)
        events, _ = run(scene, 30, 10.0, config=config)
        assert (len(reference) > 0) == (contrast >= (on if rises else off))
        assert len(events) == pytest.approx(len(reference), rel=0.02)
        if len(reference):
            found = errors(events, reference)
            assert len(found) >= 0.98 * len(reference) and np.median(found) <= 40 and np.quantile(found, 0.9) <= 80


@pytest.mark.parametrize(("on", "off"), [(0.2, 0.6), (0.6, 0.2)])
@pytest.mark.parametrize("rises", [True, False])
def test_whole_pictures_between_frames_have_each_polaritys_threshold(on, off, rises):
    """A bar that is brighter, or darker, by 0.3 has come and gone again by the next frame."""
    wall, bar = (0.1, 0.1 * np.exp(0.3)) if rises else (0.1 * np.exp(0.3), 0.1)
    scene = Bars(300.0, bar_px=2.0, first_px=20.0, wall=wall, bar=bar, day=0.0)
    config = replace(CONFIG, threshold_on=on, threshold_off=off)
    events, _ = run(scene, 30, duration_s=1 / 30, config=config, way_px=0.25)
    events = events[events["x"] >= 20]  # behind, the bar was there at first
    fires = (on if rises else off) <= 0.3
    assert set(events["x"]) == (set(range(20, 30)) if fires else set()) and (events["on"] == rises).all()
    # When so much of the pixel is covered that light has grown by the threshold.
    front_us = (events["x"] - 20 + np.expm1(0.2) / np.expm1(0.3)) / 300 * 1e6
    if rises:
        np.testing.assert_allclose(events["t"], front_us, atol=30)


@pytest.mark.parametrize(("on", "off"), [(0.2, 0.6), (0.6, 0.2)])
@pytest.mark.parametrize("contrast", [0.85, -0.85])
def test_light_that_changes_unevenly_between_frames_has_each_threshold_too(on, off, contrast):
    class Dawn(Bars):
        def luminance(self, pixels, times_s):
            return super().luminance(pixels, times_s) * np.exp(contrast * (10 * times_s) ** 3)

    scene, config = Dawn(300.0, bar_px=2.0, day=0.0), replace(CONFIG, threshold_on=on, threshold_off=off)
    reference, _ = run(scene, 15_000, config=config)
    events, _ = run(scene, 30, 10.0, config=config)
    found = errors(events, reference)
    assert len(reference) > WIDTH * HEIGHT and len(events) == pytest.approx(len(reference), rel=0.02)
    assert len(found) >= 0.98 * len(reference) and np.median(found) <= 40


def test_light_that_first_hits_do_not_tell_goes_from_frame_to_frame():
    """It grows by a third in a step, while bars come and go in it."""

    class FirstHits(Bars):
        def planes(self, pixels, times_s):
            luminance = self.luminance(pixels, times_s)
            albedo, one = luminance / (1.0 + 0.3 * self.day * times_s), np.ones(len(pixels))
            return np.stack([*[luminance] * 3, *[albedo] * 3, one, 0 * one, one])

        def bounds(self):
            return None

    names = (*RADIANCE, *ALBEDO, *COVERAGE, *EMISSION, *DEPTH)
    scene = FirstHits(60.0, bar_px=6.0, gap_px=9.0, first_px=60.0, day=30.0, names=names, lit=False)
    reference, _ = run(scene, 3000)
    events, _ = run(scene, 30, 10.0)
    found = errors(events, reference)
    assert len(found) >= 0.99 * len(reference) and np.quantile(found, 0.9) < 50


def test_what_rests_until_the_middle_of_a_step_is_traced():
    class Late(Bars):
        def motion(self, start_s, end_s):
            return super().motion(start_s, end_s) if end_s - start_s > 0.02 else None

    scene = Late(300.0, bar_px=5.0, gap_px=9.0, first_px=200.0)
    reference, _ = run(Bars(300.0, bar_px=5.0, gap_px=9.0, first_px=200.0), 120, 10.0)
    events, _ = run(scene, 30, 10.0)
    assert scene.asked > 0 and len(errors(events, reference)) >= 0.99 * len(reference)


@pytest.mark.parametrize("speed_px", [6.0, 33.0], ids=["back", "hasty"])
def test_what_goes_there_and_back_or_far_and_ever_faster_within_a_step_is_traced(speed_px):
    class Swing(Bars):
        def place(self, time_s):
            return 0.5 - 0.5 * np.cos(60.0 * np.pi * time_s) if speed_px == 6.0 else (30.0 * time_s) ** 2

        def luminance(self, pixels, times_s):
            return super().luminance(pixels, self.place(times_s)) * (1.0 + 0.3 * times_s)

        def motion(self, start_s, end_s):
            moved = np.zeros((3, 2, HEIGHT, WIDTH), np.float32)
            moved[:, 0] = self.speed_px * (self.place(end_s) - self.place(start_s))
            return moved

    scene, finely = (Swing(speed_px, bar_px=5.0, gap_px=9.0, first_px=200.0, day=0.0) for _ in range(2))
    (reference, _), (events, _) = run(finely, 240, 10.0, 1 / 30), run(scene, 30, 10.0, 1 / 30)
    assert len(reference) > 0 and len(errors(events, reference)) >= 0.99 * len(reference)


def test_where_all_rests_no_frame_but_the_first_is_searched_for_flat_pixels():
    names = (*RADIANCE, *ALBEDO, *COVERAGE)
    searched = []

    class Rest(Bars):
        def motion(self, start_s, end_s):
            return None

        def bounds(self):
            searched.append(True)
            return np.zeros((HEIGHT, WIDTH), bool)

    detector = Detector(CONFIG, WIDTH, HEIGHT, names, tracer=Rest(0.0, names=names), tolerance_us=100.0)
    frame = Frame(page_aligned((len(names), HEIGHT, WIDTH)), names)
    frame.planes[:] = 0.5
    for index in range(4):
        frame.time_us, frame.index = frame_time_us(index, 30), index
        detector.step(frame)
    detector.close()
    assert len(searched) == 1


def test_what_goes_dark_within_a_step_is_traced_though_something_else_may_come_over_it():
    """A wall of squares finer than pixels: alike in both frames, and darker between them; a hole in it goes 3 px."""
    names = (*RADIANCE, *ALBEDO, *COVERAGE)
    requests = []

    class Squares(Bars):
        def luminance(self, pixels, times_s):
            return 0.5 - 0.2 * np.sin(np.pi * 30.0 * times_s) ** 2 + 0.0 * pixels

        def trace(self, pixels, times_s):
            requests.extend(zip(pixels.tolist(), times_s.tolist(), strict=True))
            return np.tile(super().trace(pixels, times_s), (3, 1))[:7]

        def motion(self, start_s, end_s):
            return np.full((3, 2, HEIGHT, WIDTH), (end_s - start_s) * 90.0, np.float32)

        def bounds(self):
            return np.tile(np.arange(WIDTH) % 4 == 0, (HEIGHT, 1))

        def steady_shadows(self):
            return np.zeros(HEIGHT * WIDTH, bool)

        def reflected(self, pixels, light, start_s, end_s, fineness):
            # Highest and lowest lie so near to each other that they are traced together.
            shares = np.tile(np.array([0.0, 0.499, 0.501, 1.0], np.float32), len(pixels))
            values = np.tile(np.array([0.5, 0.3, 0.7, 0.5], np.float32), len(pixels))
            return Reflected(pixels, pixels, 4 * np.arange(len(pixels) + 1), shares, values)

    detector = Detector(CONFIG, WIDTH, HEIGHT, names, tracer=Squares(0.0, names=names), tolerance_us=100.0)
    frame = Frame(page_aligned((len(names), HEIGHT, WIDTH)), names)
    frame.planes[:] = 0.5
    frame.planes[6] = 1.0
    for index in range(2):
        frame.time_us, frame.index = frame_time_us(index, 30), index
        events = detector.step(frame).copy()
    detector.close()
    # Twice down and once up again.
    assert set(np.unique(events["x"] % 4)) == {1, 2, 3} and len(events) == 3 * 0.75 * WIDTH * HEIGHT
    assert len(set(requests)) == len(requests), "a pixel is traced twice at a time"


@pytest.mark.parametrize("fps", [30, 60, 240])
def test_events_do_not_hang_on_the_frame_rate(fps):
    scene = Bars(300.0, bar_px=5.0, gap_px=9.0, first_px=200.0)
    reference, _ = run(scene, 120, 10.0)
    events, _ = run(scene, fps, 10.0)
    found = errors(events, reference)
    assert len(found) >= 0.99 * max(len(events), len(reference)) and np.median(found) <= 10


def test_bars_are_timed_to_the_tolerance_by_few_requests():
    scene = Bars(300.0, bar_px=5.0, gap_px=9.0, first_px=200.0)
    reference, _ = run(scene, 15_000)
    coarse, fine = (run(scene, 30, tolerance)[0] for tolerance in (100.0, 10.0))
    for events, median_us in ((coarse, 60), (fine, 35)):
        assert len(errors(events, reference)) >= 0.99 * len(reference)
        assert np.median(errors(events, reference)) <= median_us
    assert scene.asked < 2 * 4 * len(reference)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "share"),
    [
        (SensorSettings(front_end=FrontEnd(0.1, 30.0, 300.0), noise=Noise(shot=0.05)), 0.99),
        (
            SensorSettings(
                threshold=Threshold(mismatch=0.03), front_end=FrontEnd(0.1, 30.0, 300.0), refractory=Refractory(300.0)
            ),
            0.98,
        ),
    ],
)
def test_a_sensor_sees_what_goes_between_frames(sensor, share):
    """Filters, noise and rests take the levels between frames as an ideal pixel does."""
    specimen, scene = Specimen(sensor, 1), Bars(1000.0)
    reference, _ = run(scene, 15_000, specimen=specimen)
    alone, _ = run(scene, 30, specimen=specimen)
    events, _ = run(scene, 30, 10.0, specimen=specimen)
    found = errors(events, reference)
    assert len(reference) > 5 * WIDTH * HEIGHT and len(alone) < 0.2 * len(reference)
    assert len(found) >= share * max(len(events), len(reference)) and np.median(found) <= 10


def test_where_nothing_moves_nothing_is_asked():
    scene = Bars(0.0, bar_px=5.0, gap_px=9.0, first_px=200.0, day=0.0)
    events, _ = run(scene, 30, 10.0)
    assert len(events) == 0 and scene.asked == 0


@pytest.mark.parametrize("options", [{"tolerance_us": 10.0}, {"way_px": 3.0}], ids=["pixels", "pictures"])
@pytest.mark.parametrize("before_s", [[], [0.0, 0.01], [0.0, 0.04, 0.08]])
def test_after_a_reset_frames_are_followed_as_from_the_start(before_s, options):
    """Nothing is asked for the step that leads to the first, from wherever all was before."""
    scene = Bars(300.0, bar_px=5.0, gap_px=9.0, first_px=200.0)
    detector = Detector(CONFIG, WIDTH, HEIGHT, NAMES, tracer=scene, **options)
    frame = Frame(page_aligned((3, HEIGHT, WIDTH)), NAMES)

    def shown(times_s):
        found = []
        for time_s in times_s:
            frame.time_us = round(1e6 * time_s)
            frame.planes[:] = scene.planes(PIXELS, np.full(len(PIXELS), time_s)).reshape(frame.planes.shape)
            found.append(detector.step(frame).copy())
        return np.concatenate(found) if found else None

    shown(before_s)
    detector.reset()
    scene.asked = 0
    assert len(shown([0.1])) == 0 and scene.asked == 0
    events = shown([0.12, 0.15])
    detector.close()
    whole, _ = run(replace(scene, first_px=200.0 + 300.0 * 0.1), 1000, duration_s=0.05)
    assert len(events) == pytest.approx(len(whole), rel=0.02) and scene.asked > 0
    assert events["t"].min() > 100_000 and np.median(errors(events, late_by(whole, 100_000))) < 500


def late_by(events, us):
    later = events.copy()
    later["t"] += us
    return later


class Sideways:
    """Another scene's pictures turned on their side: so narrow that rows in memory are longer than the picture's."""

    def __init__(self, scene):
        self.scene, self.names, self.lit = scene, scene.names, scene.lit

    def upright(self, pixels):
        return pixels % HEIGHT * WIDTH + pixels // HEIGHT

    def trace(self, pixels, times_s):
        return self.scene.trace(self.upright(pixels), times_s)

    def planes(self, pixels, times_s):
        return self.scene.planes(self.upright(pixels), times_s)

    def motion(self, start_s, end_s):
        return self.scene.motion(start_s, end_s)[:, ::-1].transpose(0, 1, 3, 2).copy()

    def cancel(self):
        pass

    def close(self):
        pass


@pytest.mark.parametrize("sensor", [None, SensorSettings(front_end=FrontEnd(0.1, 30.0, 300.0))])
@pytest.mark.parametrize("options", [{"tolerance_us": 10.0}, {"way_px": 2.0}], ids=["pixels", "pictures"])
def test_what_goes_down_fires_as_what_goes_to_the_right(options, sensor):
    specimen = None if sensor is None else Specimen(sensor, 1)
    found = []
    for turned in (lambda scene: scene, Sideways):
        scene = turned(Bars(700.0, bar_px=5.0, gap_px=9.0, first_px=60.0))
        size = (WIDTH, HEIGHT) if isinstance(scene, Bars) else (HEIGHT, WIDTH)
        events, _ = run(scene, 30, specimen=specimen, size=size, **options)
        if isinstance(scene, Sideways):
            events["x"], events["y"] = events["y"].copy(), events["x"].copy()
        found.append(events[np.lexsort((events["t"], events["x"], events["y"]))])
    upright, sideways = found
    assert len(upright) == len(sideways) > 5 * WIDTH * HEIGHT
    for name in ("x", "y", "on"):
        np.testing.assert_array_equal(upright[name], sideways[name])
    assert np.abs(upright["t"] - sideways["t"]).max() <= 20
