"""The OpenCL detector against the float64 reference, and against itself."""

import dataclasses

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.methods import esim_ad as detector_module
from clsim.detect.reference import ReferenceDetector
from clsim.detector import Detector
from clsim.errors import InputError
from clsim.frames import Frame
from clsim.opencl.device import choose_device
from tests.detect.reference_scenes import FEATURES, make_frame, random_frames, run

METHODS = [
    {"method": "esim"},
    {"method": "wlr-esim"},
    {"method": "esim-ad", "gate": "delta-r"},
    {"method": "esim-ad", "gate": "radiance"},
    {"method": "irradiance"},
]
RULES = ["frame", "interpolated", "linear-light"]
# Options that have nothing to do with each other share a run: each set compiles kernels of its own.
VARIANTS = [
    {"history": 3, "box": 9, "gate_scale": 0.7, "threshold_off": 0.1},
    {"stride": 2, "window": 7, "response": "lin-log", "luminance": "rec601", "scale": 0.3},
    {"kernel": "epanechnikov", "bandwidth_h": 0.5, "features": ("Depth", "Albedo.G"), "gate_scale": 2.0},
    {"regress": "linear", "gate": "delta-r", "scale": 0.3, "floor": 0.1},
    {"regress": "linear", "shrink": 1.5, "history": 2},
    {"regress": "linear", "shrink": 1.0, "method": "wlr-esim", "scale": 3.0, "ridge": 0.01, "response": "lin-log"},
]


def spoil(frames, share=0.02):
    """Make some pixels NaN or infinite, each in one plane, in all frames but the first."""
    rng = np.random.default_rng(5)
    for frame in frames[1:]:
        bad = rng.random(frame.planes.shape[1:]) < share
        ys, xs = np.nonzero(bad)
        frame.planes[rng.integers(0, len(frame.names), len(ys)), ys, xs] = rng.choice([np.nan, np.inf])
    return frames


def config_of(**options):
    return DetectorConfig(**{"window": 5, "threshold_on": 0.15, "threshold_off": 0.12, **options})


def both(config, frames, device=None):
    first = frames[0]
    size = (first.width, first.height, first.names)
    return Detector(config, *size, device=device), ReferenceDetector(config, *size)


def levels(detector):
    """The level of each pixel after the last step, NaN where it has none."""
    estimator = detector.estimator
    return estimator.stages.place.read(estimator.levels.end)[:, : detector.width]


def keep(events, where):
    return events[where[events["y"], events["x"]]]


def assert_same(config, frames, *, alpha_error, margin, time_error_us=0, decided=0.5):
    """Kernels and reference agree wherever no decision was closer than ``margin``."""
    kernels, reference = both(config, frames)
    total = 0
    for frame in frames:
        got, expected = kernels.step(frame), reference.step(frame)
        clear = reference.margin > margin
        ready = np.isfinite(levels(kernels)) & clear
        assert clear.mean() >= decided
        assert np.abs(levels(kernels) - reference.level)[ready].max(initial=0) < alpha_error
        got, expected = keep(got, clear), keep(expected, clear)
        assert len(got) == len(expected)
        # Errors of stamps may reorder events: compare pixel by pixel.
        got, expected = (e[np.lexsort((e["t"], e["x"], e["y"]))] for e in (got, expected))
        for name in ("x", "y", "on"):
            np.testing.assert_array_equal(got[name], expected[name])
        assert np.abs(got["t"] - expected["t"]).max(initial=0) <= time_error_us
        total += len(expected)
    kernels.close()
    return total


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("method", METHODS, ids=lambda m: "-".join(m.values()))
def test_float64_kernels_equal_the_reference(method, rule):
    frames = spoil(random_frames(1, height=17, width=23))
    config = config_of(**method, event_rule=rule, precision="float64")
    assert assert_same(config, frames, alpha_error=1e-9, margin=1e-9, time_error_us=1) > 100


@pytest.mark.parametrize("method", ["esim", "wlr-esim", "irradiance"])
def test_float32_kernels_are_near_the_reference(method):
    frames = spoil(random_frames(2, height=17, width=23))
    assert assert_same(config_of(method=method), frames, alpha_error=5e-4, margin=5e-3, time_error_us=200) > 100


@pytest.mark.parametrize("gate", ["delta-r", "radiance"])
def test_float32_gates_decide_as_the_reference_but_for_a_few_pixels(gate):
    """Predictions multiply the small errors of β by δ, so single pixels near a threshold may differ, and then go on."""
    frames = spoil(random_frames(2, height=17, width=23))
    kernels, reference = both(config_of(gate=gate), frames)
    counts = []
    for detector in (kernels, reference):
        events = run(detector, frames)
        counts.append(np.zeros((2, 17, 23), dtype=int))
        np.add.at(counts[-1], (events["on"].astype(int), events["y"], events["x"]), 1)
    assert counts[1].sum() > 100
    assert (counts[0] != counts[1]).mean() < 0.01


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda v: "-".join(v))
def test_every_option_means_the_same_as_in_the_reference(variant):
    frames = spoil(random_frames(3, height=13, width=19))
    config = config_of(**{"precision": "float64", **variant})
    assert assert_same(config, frames, alpha_error=1e-6, margin=1e-6, time_error_us=1) > 30


@pytest.mark.parametrize(
    ("size", "precision"),
    [
        ((1, 1), "float64"),
        ((1, 9), "float64"),
        pytest.param((9, 1), "float64", marks=pytest.mark.slow),
        ((2, 40), "float64"),
        ((3, 4), "float32"),
    ],
    ids=str,
)
def test_frames_smaller_than_the_window(size, precision):
    frames = random_frames(4, height=size[0], width=size[1])
    exact = precision == "float64"
    config = config_of(precision=precision)
    error, margin = (1e-9, 1e-9) if exact else (1e-2, 1e-2)
    # With fewer pixels than unknowns the slopes, and so the predictions, are set by the ridge.
    assert_same(config, frames, alpha_error=error, margin=margin, time_error_us=1 if exact else 2000, decided=0)


def variants_of(frames, planes):
    """The same frames with some planes replaced."""
    for frame in frames:
        for name, value in planes.items():
            frame.plane(name)[...] = value(frame) if callable(value) else value
    return frames


@pytest.mark.parametrize(
    "planes",
    [
        dict.fromkeys(FEATURES, 0.7),
        {"Nx": lambda f: f.plane("Ny"), "Nz": lambda f: 2 * f.plane("Albedo.R")},
        {"Depth": lambda f: 1e6 + f.plane("Depth")},
        {"Coverage": 0.0},
        {"R": 0.0, "G": 0.0, "B": 0.0},
    ],
    ids=["constant", "collinear", "large depth", "nothing hit", "black"],
)
@pytest.mark.parametrize("precision", [pytest.param("float32", marks=pytest.mark.slow), "float64"])
def test_degenerate_features(planes, precision):
    frames = variants_of(random_frames(5, height=13, width=17), planes)
    exact = precision == "float64"
    config = config_of(method="wlr-esim", precision=precision)
    # Collinear features: α is set by the ridge, and float32 resolves 1e-5 of a variance to a few per cent.
    error, margin = (1e-7, 1e-7) if exact else (5e-3, 1e-2)
    assert_same(config, frames, alpha_error=error, margin=margin, time_error_us=1 if exact else 800)


def test_directions_of_which_rounding_leaves_nothing_are_left_out():
    """Where features are copies of each other and the ridge is below rounding, α is off by several otherwise."""
    share = {"Nx": ("Ny", 1), "Depth": ("Ny", 5), "Nz": ("Albedo.R", 2), "Albedo.G": ("Albedo.R", 3)}
    copies = {name: lambda f, of=of, by=by: by * f.plane(of) for name, (of, by) in share.items()}
    for seed in (1, 2, 3):
        frames = variants_of(random_frames(seed, height=13, width=17), copies)
        kernels, reference = both(config_of(method="wlr-esim", ridge=1e-8), frames)
        for frame in frames:
            kernels.step(frame)
            reference.step(frame)
            assert np.nanmax(np.abs(levels(kernels) - reference.level)) < 0.3


@pytest.mark.parametrize(
    ("lanes", "options"),
    [
        (16, {}),
        pytest.param(1, {}, marks=pytest.mark.slow),
        pytest.param(8, {"history": 2, "stride": 2}, marks=pytest.mark.slow),
        pytest.param(8, {}, marks=pytest.mark.slow),
        pytest.param(8, {"precision": "float64"}, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_listed_pixels_are_solved_bit_for_bit_as_all_pixels(lanes, options, monkeypatch):
    device = dataclasses.replace(choose_device(), lanes=lanes)
    frames = spoil(random_frames(6, height=13, width=21))
    results = []
    for share in (-1.0, 2.0):
        monkeypatch.setattr(detector_module, "SPARSE_SHARE", share)
        kernels, _ = both(config_of(**options), frames, device)
        events = run(kernels, frames)
        results.append((events.tobytes(), levels(kernels).tobytes()))
        assert len(events) > 100
    assert results[0] == results[1]


def test_windows_wider_than_a_vector_are_gathered_whole(monkeypatch):
    frames = random_frames(7, count=2, height=25, width=27)
    results = []
    for share in (-1.0, 2.0):
        monkeypatch.setattr(detector_module, "SPARSE_SHARE", share)
        kernels, _ = both(config_of(window=21), frames)
        results.append((run(kernels, frames).tobytes(), levels(kernels).tobytes()))
    assert results[0] == results[1]


def test_bad_values_in_a_constant_plane_make_a_pixel_invalid():
    frames = random_frames(16, height=9, width=11, count=2)
    for frame in frames:
        frame.plane("Nx")[...] = 0.5
        frame.plane("Nx")[3, 4] = np.nan
    config = config_of(precision="float64")
    kernels, reference = both(config, frames)
    for detector in (kernels, reference):
        run(detector, frames)
        assert detector.stats.masked == 2
    assert "Nx" not in kernels.features


@pytest.mark.parametrize("method", METHODS, ids=lambda m: "-".join(m.values()))
def test_two_runs_are_identical_and_sorted(method):
    frames = spoil(random_frames(8, height=17, width=40))
    first, second = (run(both(config_of(**method), frames)[0], frames) for _ in range(2))
    assert first.tobytes() == second.tobytes()
    order = np.lexsort((first["x"], first["y"], first["t"]))
    np.testing.assert_array_equal(order, np.arange(len(first)))


def test_frames_are_read_where_they_are():
    """A slot is rewritten between steps, as a ring does; the detector must see the new values without being told."""
    frames = random_frames(9)
    slot = frames[0].copy()
    config = config_of()
    kernels, _ = both(config, frames)
    separate, _ = both(config, frames)
    for frame in frames:
        slot.planes[...] = frame.planes
        slot.time_us, slot.index = frame.time_us, frame.index
        np.testing.assert_array_equal(kernels.step(slot), separate.step(frame))


@pytest.mark.parametrize("gate", ["radiance", "delta-r"])
def test_planes_that_begin_to_vary_join_the_regression(gate):
    """Pixels that were no numbers before are not in it then."""
    late = spoil(random_frames(10, count=6, height=13, width=17))
    for frame in late[:2]:
        for name in ("Nx", "Albedo.R", "Albedo.G"):
            frame.plane(name)[...] = 0.5
    # It changes as a whole, and right after others have joined.
    for k, frame in enumerate(late):
        frame.plane("Nz")[...] = -0.25 if k < 3 else 0.5
    # How far misses are, only their windows tell: depth is never known to be constant.
    late[0].plane("Depth")[...] = 4.0
    config = config_of(precision="float64", history=2, gate=gate)
    kernels, _ = both(config, late)
    kernels.step(late[0])
    assert set(kernels.features) == set(FEATURES) - {"Nx", "Nz", "Albedo.R", "Albedo.G"}
    run(kernels, late[1:])
    assert set(kernels.features) == set(FEATURES)
    assert assert_same(config, late, alpha_error=1e-9, margin=1e-9, time_error_us=1) > 50


def test_a_frame_in_which_nothing_may_fire_is_in_the_history_too():
    frames = random_frames(9, count=3, height=13, width=19)
    frames[1].planes[...] = frames[0].planes
    config = config_of(history=2, precision="float64")
    detector, _ = both(config, frames)
    run(detector, frames[:2])
    assert detector.stats.tested > 0 and detector.stats.solved == 0
    assert assert_same(config, frames, alpha_error=1e-6, margin=1e-6, time_error_us=1) > 30


@pytest.mark.parametrize("method", ["esim-ad", "wlr-esim"])
def test_statistics_equal_the_references(method):
    frames = spoil(random_frames(11, height=17, width=23))
    kernels, reference = both(config_of(method=method, precision="float64", threshold_on=0.02), frames)
    run(kernels, frames)
    run(reference, frames)
    assert kernels.stats == reference.stats and kernels.stats.frames == 4
    assert kernels.stats.masked > 0 and kernels.stats.many_crossings > 0


@pytest.mark.parametrize("rule", RULES)
def test_the_most_crossings_of_a_pixel_are_known(rule):
    """Over all steps and over more pixels than one work-item counts."""
    frames = [make_frame(np.full((20, 20), value), k) for k, value in enumerate((0.0, 0.25, 0.0))]
    frames[1].planes[:, 10, 7] *= np.exp(0.4)
    config = config_of(method="esim", threshold_on=0.1, event_rule=rule)
    for detector in both(config, frames):
        run(detector, frames)
        assert detector.stats.most_crossings == (1 if rule == "frame" else 6)


def test_too_many_crossings_are_capped_and_counted():
    frames = [make_frame(np.full((2, 3), value), k) for k, value in enumerate((0.0, 2.0, 2.0005))]
    kernels, reference = both(config_of(method="esim", threshold_on=1e-3, precision="float64"), frames)
    for frame in frames:
        got, expected = kernels.step(frame), reference.step(frame)
        assert len(got) == len(expected)
    assert kernels.stats.capped == reference.stats.capped > 5000
    assert kernels.stats.events == 6000


def test_reset_initialises_again_without_events():
    frames = random_frames(12)
    kernels, reference = both(config_of(precision="float64"), frames)
    for detector in (kernels, reference):
        run(detector, frames)
        detector.reset()
    assert len(kernels.step(frames[0])) == len(reference.step(frames[0])) == 0
    assert len(kernels.step(frames[1])) == len(reference.step(frames[1])) > 0


def test_pixels_that_turn_invalid_keep_their_reference():
    frames = [make_frame(np.full((3, 5), value), k) for k, value in enumerate((0.0, 9.0, 0.2))]
    frames[1].planes[:, 1, 2] = np.nan
    kernels, _ = both(config_of(method="esim", threshold_on=0.15), frames)
    kernels.step(frames[0])
    at_nan = kernels.step(frames[1])
    assert not ((at_nan["x"] == 2) & (at_nan["y"] == 1)).any() and len(at_nan) > 0
    after = kernels.step(frames[2])
    after = after[(after["x"] == 2) & (after["y"] == 1)]
    assert after["on"].tolist() == [True]


def test_time_is_exact_after_a_million_seconds():
    start = 10**12
    frames = [make_frame(np.full((1, 1), value)) for value in (0.0, 0.25)]
    frames[0].time_us, frames[1].time_us = start, start + 1000
    kernels, _ = both(config_of(method="esim", threshold_on=0.2, precision="float64"), frames)
    assert run(kernels, frames)["t"].tolist() == [start + 800]


def test_wrong_input_is_named():
    frame = random_frames(13, count=1)[0]
    with pytest.raises(InputError, match="no OpenCL device is named 'quantum'"):
        choose_device("quantum")
    with pytest.raises(InputError, match="no plane 'G'"):
        Detector(config_of(), 4, 4, ("R", "Depth"))
    kernels = Detector(config_of(), frame.width + 1, frame.height, frame.names)
    with pytest.raises(InputError, match=f"expected {frame.width + 1}×"):
        kernels.step(frame)
    kernels = Detector(config_of(), frame.width, frame.height, frame.names)
    kernels.step(frame)
    with pytest.raises(InputError, match="expected a time after 0"):
        kernels.step(frame)
    with pytest.raises(InputError, match="has the planes"):
        kernels.step(Frame(frame.planes[:3].copy(), ("R", "G", "B"), 9))


def test_new_frame_sizes_use_the_same_programs():
    from clsim.opencl.workplace import _build

    config = config_of()
    sizes = [(9, 11), (10, 40)]
    misses = []
    for height, width in sizes:
        frames = random_frames(14, count=2, height=height, width=width)
        run(Detector(config, width, height, frames[0].names), frames)
        misses.append(_build.cache_info().misses)
    assert misses[0] == misses[1]


def test_how_bright_a_luminance_is_makes_no_new_programs_but_where_it_matters(monkeypatch):
    """The extremes of windows, box means and the regression itself are of any brightness; compiling them takes long."""
    from clsim.opencl import workplace as program

    built, build = [], program._build

    def recorded(context, *what):
        built[-1].add(what)
        return build(context, *what)

    monkeypatch.setattr(program, "_build", recorded)
    frames = random_frames(14, count=2)
    for options in ({}, {"floor": 0.01}, {"response": "lin-log"}, {"regress": "linear"}):
        built.append(set())
        run(Detector(config_of(**options), 11, 9, frames[0].names), frames)
    assert [len(each) for each in built] == [7] * 4
    assert len(set.intersection(*built)) == 5
