"""The detector's behaviour over time, and the laws it obeys."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.observation import observe
from clsim.detect.reference import ReferenceDetector
from clsim.detector import NumpyDetector
from clsim.errors import InputError
from tests.detect.reference_scenes import make_frame, random_frames, run

METHODS = [
    {"method": "esim"},
    {"method": "wlr-esim"},
    {"gate": "delta-r"},
    {"gate": "radiance"},
]
RULES = ["frame", "interpolated"]
ALL = [{**m, "event_rule": r} for m in METHODS for r in RULES]
SMALL = {"window": 5, "box": 3, "threshold_on": 0.1, "threshold_off": 0.13, "floor": 1e-30}


def detect(frames, **options):
    detector = ReferenceDetector(
        DetectorConfig(**{**SMALL, **options}), frames[0].width, frames[0].height, frames[0].names
    )
    return run(detector, frames), detector


@pytest.mark.parametrize("options", ALL)
def test_first_frame_fires_nothing_and_still_scenes_stay_silent(options):
    frame = random_frames(2, count=1)[0]
    events, detector = detect([dataclasses.replace(frame, time_us=1000 * k, index=k) for k in range(4)], **options)
    assert len(events) == 0
    assert detector.stats.initialised == 99
    assert detector.stats.tested == 3 * 99
    if options.get("gate"):
        assert detector.stats.solved == 0


@pytest.mark.parametrize("options", ALL)
def test_events_are_sorted_in_time_and_inside_the_image(options):
    frames = random_frames(4, count=4)
    detector = ReferenceDetector(DetectorConfig(**SMALL, **options), 11, 9, frames[0].names)
    for k, frame in enumerate(frames):
        batch = detector.step(frame)
        if k == 0:
            continue
        assert len(batch) > 0
        assert (batch["t"] > frames[k - 1].time_us).all() and (batch["t"] <= frame.time_us).all()
        if options["event_rule"] == "frame":
            assert (batch["t"] == frame.time_us).all()
            assert len(np.unique(batch[["x", "y"]])) == len(batch)
        order = np.lexsort((batch["x"], batch["y"], batch["t"]))
        np.testing.assert_array_equal(order, np.arange(len(batch)))
        assert batch["x"].max() < 11 and batch["y"].max() < 9


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), method=st.sampled_from(METHODS))
def test_integrated_events_stay_within_a_threshold_of_the_level(seed, method):
    frames = random_frames(seed, count=5, noise=0.3)
    detector = ReferenceDetector(DetectorConfig(**SMALL, **method), 11, 9, frames[0].names)
    detector.step(frames[0])
    integrated = detector.ref.copy()
    for frame in frames[1:]:
        batch = detector.step(frame)
        np.add.at(integrated, (batch["y"], batch["x"]), np.where(batch["on"], 0.1, -0.13))
        np.testing.assert_allclose(integrated, detector.ref, atol=1e-12)
        assert (detector.level - integrated <= 0.1 + 1e-12).all()
        assert (detector.level - integrated >= -0.13 - 1e-12).all()


def observations(frames, options):
    detector = ReferenceDetector(DetectorConfig(**{**SMALL, **options}), 11, 9, frames[0].names)
    return detector, [observe(frame, detector.planes, detector.config) for frame in frames]


def compare(options, frames, change, change_event, change_pixels=lambda a: a, swap_thresholds=False):
    """Run plain and changed observations side by side; pixels near any threshold are left out."""
    plain, seen = observations(frames, options)
    other_options = {**options, "threshold_on": 0.13, "threshold_off": 0.1} if swap_thresholds else options
    other, same = observations(frames, other_options)
    for k, (a, b) in enumerate(zip(seen, same, strict=True)):
        events = plain.step_observation(a, 1000 * k)
        changed = other.step_observation(change(b), 1000 * k)
        clear = np.minimum(plain.margin, change_pixels(other.margin)) > 1e-6
        np.testing.assert_array_equal(plain.solved[clear], change_pixels(other.solved)[clear])
        expected = [tuple(e) for e in events if clear[e["y"], e["x"]]]
        got = [change_event(*e) for e in changed.tolist()]
        got = sorted((e for e in got if clear[e[2], e[1]]), key=lambda e: (e[2], e[1], e[0]))
        expected = sorted(expected, key=lambda e: (e[2], e[1], e[0]))
        assert len(expected) == len(got)
        for e, g in zip(expected, got, strict=True):
            assert e[1:] == g[1:] and abs(int(e[0]) - g[0]) <= 1
    assert clear.mean() > 0.9
    return plain, other


LAW = {"seed": st.integers(0, 10**6), "options": st.sampled_from([*ALL, {"gate": "radiance", "history": 2}])}


@settings(max_examples=12, deadline=None)
@given(**LAW, shift=st.floats(-20, 20))
def test_adding_a_constant_to_brightness_changes_no_event(seed, options, shift):
    def change(o):
        return dataclasses.replace(o, brightness=o.brightness + shift)

    plain, other = compare(options, random_frames(seed), change, lambda t, x, y, on: (t, x, y, on))
    np.testing.assert_allclose(other.level, plain.level + shift, atol=1e-6)


@settings(max_examples=12, deadline=None)
@given(**LAW, factor=st.floats(1e-6, 1e6), feature=st.integers(2, 9))
def test_scaling_a_feature_changes_nothing(seed, options, factor, feature):
    def change(o):
        features = o.features.copy()
        if features.shape[2] > 2:
            features[..., feature] *= factor
        return dataclasses.replace(o, features=features)

    plain, other = compare(options, random_frames(seed), change, lambda t, x, y, on: (t, x, y, on))
    np.testing.assert_allclose(other.level, plain.level, atol=1e-6)


@settings(max_examples=12, deadline=None)
@given(**LAW)
def test_mirroring_the_image_mirrors_the_events(seed, options):
    def mirror(a):
        return a[:, ::-1]

    def change(o):
        features = mirror(o.features).copy()
        features[..., 0] = 10 - features[..., 0]
        return dataclasses.replace(
            o, brightness=mirror(o.brightness), features=features, valid=mirror(o.valid), hit=mirror(o.hit)
        )

    plain, other = compare(options, random_frames(seed), change, lambda t, x, y, on: (t, 10 - x, y, on), mirror)
    np.testing.assert_allclose(mirror(other.level), plain.level, atol=1e-6)


@settings(max_examples=12, deadline=None)
@given(**LAW)
def test_negating_brightness_swaps_the_polarities(seed, options):
    def change(o):
        return dataclasses.replace(o, brightness=-o.brightness)

    plain, other = compare(
        options, random_frames(seed), change, lambda t, x, y, on: (t, x, y, not on), swap_thresholds=True
    )
    np.testing.assert_allclose(other.level, -plain.level, atol=1e-6)


def box_over_a_wall(count=8):
    """A dark box enters before a uniform wall, from the left."""
    frames = []
    for k in range(count):
        xs = np.mgrid[0:12, 0:20][1]
        inside = xs < 2 * k - 2
        frames.append(
            make_frame(
                np.where(inside, -1.5, -0.5), k, Depth=np.where(inside, 2.0, 4.0), Albedo_R=np.where(inside, 0.2, 0.6)
            )
        )
    return frames


@pytest.mark.parametrize("rule", RULES)
def test_leading_edge_of_a_box_before_a_uniform_wall(rule):
    """ΔR is blind where every feature was constant; the radiance gate is not."""
    frames = box_over_a_wall()
    blind, _ = detect(frames, gate="delta-r", event_rule=rule, threshold_on=0.4, threshold_off=0.4)
    seeing, _ = detect(frames, gate="radiance", event_rule=rule, threshold_on=0.4, threshold_off=0.4)
    reached = np.zeros((12, 20), dtype=bool)
    reached[:, :12] = True
    fired = np.zeros_like(reached)
    fired[seeing["y"], seeing["x"]] = True
    assert not seeing["on"].any()
    np.testing.assert_array_equal(fired, reached)
    # ΔR's only events are where the first frame's windows held something to regress on: nowhere.
    assert len(blind) == 0


def test_range_test_sees_what_brightness_cannot():
    """A feature that leaves its old range asks for a solve although nothing got brighter."""
    wall = [make_frame(np.zeros((7, 7)), k, Depth=4.0 if k == 0 else 2.0) for k in range(2)]
    _, detector = detect(wall, gate="radiance")
    assert detector.solved.all()
    _, detector = detect(wall, gate="delta-r")
    assert not detector.solved.any()


def ramp(count, per_frame, fps=100.0):
    return [make_frame(np.full((3, 4), -1 + per_frame * k), k, fps, Depth=1.0) for k in range(count)]


def test_crossing_times_of_a_ramp_are_exact():
    events, detector = detect(ramp(5, 0.26), method="esim", threshold_on=0.2)
    stamps = events["t"][(events["x"] == 0) & (events["y"] == 0)]
    expected = [np.ceil(n * 0.2 / 0.26 * 10_000) for n in range(1, 6)]
    assert stamps.tolist() == pytest.approx(expected, abs=1)
    np.testing.assert_allclose(detector.ref, 0.0, atol=1e-5)


def test_after_dropped_frames_interpolation_starts_at_the_last_processed_one():
    frames = ramp(9, 0.25)
    every, _ = detect(frames, method="esim", threshold_on=0.2)
    some, _ = detect([frames[0], frames[1], frames[5], frames[8]], method="esim", threshold_on=0.2)
    assert len(every) == len(some)
    assert np.abs(every["t"] - some["t"]).max() <= 2


def test_frame_rule_jumps_to_the_level():
    events, detector = detect(ramp(3, 0.25), method="esim", event_rule="frame")
    assert len(events) == 2 * 12
    np.testing.assert_allclose(detector.ref, -0.5, atol=1e-6)


def test_nan_centre_keeps_its_reference_and_the_first_valid_frame_initialises():
    frames = ramp(4, 0.25)
    frames[1].plane("G")[1, 2] = np.nan
    frames[0].plane("Depth")[0, 0] = np.inf
    detector = ReferenceDetector(DetectorConfig(method="wlr-esim", window=3), 4, 3, frames[0].names)
    kept = None
    fired, batches = [], []
    for frame in frames:
        batch = detector.step(frame)
        batches.append(batch)
        fired.append({(e["x"], e["y"]) for e in batch})
        if frame.index == 0:
            kept = detector.ref[1, 2]
            assert detector.stats.initialised == 11 and detector.stats.masked == 1
        if frame.index == 1:
            assert detector.ref[1, 2] == kept
    everywhere = {(x, y) for x in range(4) for y in range(3)}
    assert fired[0] == set()
    assert fired[1] == everywhere - {(0, 0), (2, 1)}
    assert fired[2] == fired[3] == everywhere
    counts = [int(((batch["x"] == 2) & (batch["y"] == 1)).sum()) for batch in batches]
    assert counts == [0, 0, 2, 1], "the reference of frame 0 still counts"
    assert np.isfinite(detector.level).all()


def test_reset_initialises_again_without_events():
    frames = ramp(4, 0.5)
    detector = ReferenceDetector(DetectorConfig(gate="delta-r", window=3, history=2), 4, 3, frames[0].names)
    detector.step(frames[0])
    detector.reset()
    assert len(detector.step(frames[2])) == 0
    np.testing.assert_allclose(detector.ref, 0.0, atol=1e-6)
    assert detector.stats.initialised == 24


def test_history_averages_the_noise_of_independent_frames():
    spread = []
    for history in (1, 3):
        frames = [
            make_frame(np.random.default_rng(k).normal(0, 0.2, (20, 20)), k, Depth=1.0) for k in range(3)
        ]  # fmt: skip
        _, detector = detect(frames, method="wlr-esim", history=history, threshold_on=9.0, threshold_off=9.0)
        spread.append(detector.level.std())
    assert spread[1] == pytest.approx(spread[0] / np.sqrt(3), rel=0.15)


def test_too_many_crossings_are_counted_and_capped():
    frames = [make_frame(np.zeros((2, 2)), 0), make_frame(np.full((2, 2), 3.0), 1)]
    events, detector = detect(frames, method="esim", threshold_on=0.0025)
    assert len(events) == 4 * 1000
    assert detector.stats.capped == pytest.approx(4 * 199, abs=8)
    assert detector.stats.many_crossings == 4
    assert np.all(np.abs(detector.level - detector.ref) < 0.0025 + 1e-9)


def test_moving_shadow_is_seen_by_radiance_alone():
    xs = np.mgrid[0:10, 0:16][1]
    frames = [make_frame(np.where(xs < 2 * k, -1.2, -0.4), k, Depth=3 + 0.01 * xs, Nx=0.0) for k in range(6)]
    radiance, detector = detect(frames, gate="radiance", threshold_on=0.3, threshold_off=0.3)
    blind, _ = detect(frames, gate="delta-r", threshold_on=0.3, threshold_off=0.3)
    assert len(blind) == 0
    assert len(np.unique(radiance[["x", "y"]])) >= 80
    assert 0 < detector.stats.solved_share < 0.6


def test_wrong_input_is_named():
    frame = make_frame(np.zeros((3, 4)), 0)
    detector = ReferenceDetector(DetectorConfig(method="esim"), 4, 3, frame.names)
    detector.step(frame)
    with pytest.raises(InputError, match="0 µs"):
        detector.step(frame)
    with pytest.raises(InputError, match="5×3"):
        detector.step(make_frame(np.zeros((3, 5)), 1))
    with pytest.raises(InputError, match="Depth"):
        NumpyDetector(DetectorConfig(features=("Depth",)), 4, 3, frame.names)
