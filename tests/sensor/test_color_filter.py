"""Colour filter arrays: each pixel fires as that of a monochrome camera behind its filter does."""

import math
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

import clsim
from clsim.detect.config import DetectorConfig
from clsim.detect.reference import ReferenceDetector
from clsim.detector import Detector
from clsim.errors import InputError
from clsim.events.color_filter import Pattern, filters_of, sidecar_color_filter
from clsim.frames import RADIANCE, Frame
from clsim.live.options import LiveOptions
from clsim.live.sensors import RecordedSensor
from clsim.live.stages import plan_stages
from clsim.sensor import SensorSettings, load_sensor
from clsim.sensor.settings import Optics

PATTERNS = get_args(Pattern)
WIDTH, HEIGHT = 33, 22
FILTERS = {"R": (0.8, 0.15, 0.05), "G": (0.2, 0.7, 0.1), "B": (0.0, 0.3, 0.7)}
DYES = {"filter_red": FILTERS["R"], "filter_green": FILTERS["G"], "filter_blue": FILTERS["B"]}
FAULTY = replace(load_sensor("davis346"), readout=SensorSettings().readout)
"""Readouts let pixels wait for others'."""


def pictures(count=6):
    rng = np.random.default_rng(7)
    return [np.exp(rng.normal(0, 0.5, (3, HEIGHT, WIDTH))).astype(np.float32) for _ in range(count)]


def shown(optics, settings):
    with clsim.Simulator.from_radiance(
        WIDTH, HEIGHT, threshold=0.15, sensor=replace(settings, optics=optics), seed=3
    ) as camera:
        return np.concatenate([camera.push(picture, 2000 * (k + 1)) for k, picture in enumerate(pictures())])


def cut_of(pattern, monochrome):
    """Return the events of three monochrome cameras' pixels as the pattern has them."""
    parts = []
    for place, colour in enumerate(pattern):
        events = monochrome[colour]
        parts.append(events[(events["y"] % 2 == place // 2) & (events["x"] % 2 == place % 2)])
    events = np.concatenate(parts)
    return events[np.lexsort((events["x"], events["y"], events["t"]))]


@pytest.mark.parametrize("settings", [SensorSettings(), FAULTY], ids=["ideal", "faulty"])
def test_it_fires_what_three_monochrome_cameras_behind_its_filters_fire(settings):
    monochrome = {colour: shown(Optics(spectral=weights), settings) for colour, weights in FILTERS.items()}
    assert min(map(len, monochrome.values())) > 2000
    for pattern in PATTERNS:
        events = shown(Optics(color_filter=pattern, **DYES), settings)
        np.testing.assert_array_equal(events, cut_of(pattern, monochrome))


def test_events_are_as_many_as_the_light_behind_each_filter_says():
    before, after, threshold = np.array([0.9, 0.2, 0.05]), np.array([0.9, 0.5, 0.4]), 0.1
    sensor = SensorSettings(optics=Optics(color_filter="GRBG"))
    with clsim.Simulator.from_radiance(6, 4, threshold=threshold, sensor=sensor) as camera:
        camera.push(np.broadcast_to(before, (4, 6, 3)), 0)
        events = camera.push(np.broadcast_to(after, (4, 6, 3)), 1000)
    counts = np.zeros((4, 6), int)
    np.add.at(counts, (events["y"], events["x"]), 1)
    red, green, blue = (math.floor(math.log(b / a) / threshold) for a, b in zip(before, after, strict=True))
    assert (red, green, blue) == (0, 9, 20)
    np.testing.assert_array_equal(counts, np.tile([[green, red], [blue, green]], (2, 3)))
    named = filters_of(events, "GRBG")
    assert set(named) == {1, 2} and (np.bincount(named) == [0, 12 * green, 6 * blue]).all()


def test_kernels_do_as_the_reference():
    mosaic = Optics(color_filter="BGGR", **DYES).mosaic
    config = DetectorConfig(method="esim", mosaic=mosaic, scale=2.0, precision="float64")
    detectors = Detector(config, WIDTH, HEIGHT, RADIANCE), ReferenceDetector(config, WIDTH, HEIGHT, RADIANCE)
    for k, picture in enumerate(pictures(3)):
        frame = Frame(picture, RADIANCE, 1000 * k, k)
        events, expected = (detector.step(frame) for detector in detectors)
        np.testing.assert_array_equal(events, expected)
    assert len(events) > 1000


@pytest.mark.slow
@pytest.mark.parametrize("quality", ["draft", "exact"])
def test_rendered_scenes_are_seen_through_the_filters(quality):
    """With cached light too: what a pixel learns of it is no event in the light that it sees."""

    def seen(optics):
        sensor = SensorSettings(optics=optics)
        size = {"resolution": (32, 24), "threshold": 0.1, "quality": quality, "spp": 8 if quality == "exact" else None}
        with clsim.Simulator("cornell", sensor=sensor, **size) as simulator:
            return simulator.step(50_000).copy()

    monochrome = {colour: seen(Optics(spectral=weights)) for colour, weights in FILTERS.items()}
    events = seen(Optics(color_filter="RGGB", **DYES))
    assert len(events) > 50
    assert len({len(each) for each in monochrome.values()}) == 3
    np.testing.assert_array_equal(events, cut_of("RGGB", monochrome))


def test_video_and_arrays_are_seen_through_them_too():
    sensor = SensorSettings(optics=Optics(color_filter="GBRG"))
    frames = [np.moveaxis(picture, 0, 2) for picture in pictures()]
    times_us = [2000 * (k + 1) for k in range(len(frames))]
    found = clsim.events_from(frames, times_us, transfer="linear", sensor=sensor, threshold_on=0.15, threshold_off=0.15)
    events = np.concatenate([batch.copy() for batch in found])
    np.testing.assert_array_equal(events, shown(sensor.optics, SensorSettings()))


def test_recorded_frames_are_seen_pixel_by_pixel_unless_told_otherwise():
    seen_by = RecordedSensor(SensorSettings(optics=Optics(color_filter="RGGB")))
    assert seen_by.detector({}, "esim-ad")["method"] == "esim"
    assert seen_by.detector({"method": "irradiance"}, "irradiance")["method"] == "irradiance"


@pytest.mark.parametrize("method", ["irradiance", "wlr-esim", "esim-ad"])
def test_methods_that_mix_neighbours_are_refused(method):
    with pytest.raises(InputError, match=f"color_filter needs `method` esim, got {method}"):
        DetectorConfig(method=method, mosaic=Optics(color_filter="RGGB").mosaic)


def test_what_cannot_be_is_told():
    with pytest.raises(InputError, match="`spectral` is of pixels without filters"):
        Optics(spectral="silicon", color_filter="RGGB")
    with pytest.raises(InputError, match="`color_filter` must be"):
        Optics(color_filter="RGBW")
    with pytest.raises(InputError, match="`filter_green` must be weights"):
        Optics(color_filter="RGGB", filter_green=(0, -1, 2))
    sensor = SensorSettings(optics=Optics(color_filter="RGGB"))
    with pytest.raises(InputError, match="color_filter needs `time` fixed, got adaptive"):
        clsim.Simulator("moving-light", sensor=sensor, quality="balanced", time="adaptive")
    slow = LiveOptions("edge", fps=20, quality="balanced")  # so slow that pixels would be traced between frames
    assert plan_stages(slow).retracing is not None and plan_stages(replace(slow, sensor=sensor)).retracing is None


def test_a_sidecar_of_another_pattern_is_refused(tmp_path):
    (tmp_path / "a.csv.json").write_text('{"color_filter": "XYZ"}')
    with pytest.raises(InputError, match=r"`color_filter` is 'XYZ', expected one of RGGB, GRBG"):
        sidecar_color_filter(tmp_path / "a.csv")
    assert sidecar_color_filter(tmp_path / "b.csv") is None
