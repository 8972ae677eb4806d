"""A run says what was chosen and why, and whether there is light enough."""

from dataclasses import replace

import numpy as np
import pytest

from clsim.frames import Frame
from clsim.live.options import LiveOptions
from clsim.live.sensors import RecordedSensor, meter_for
from clsim.live.stages import plan_stages
from clsim.scene import Sensor, load_world
from clsim.sensor import load_sensor
from clsim.sensor.settings import SensorSettings, Threshold


@pytest.mark.parametrize(
    ("options", "light", "times"),
    [
        ({"scene": "two-boxes"}, "nothing but the camera of two-boxes moves", "120 times a second, in frames"),
        ({"scene": "cornell"}, "paths that meet that are traced again, of 64 or more", "in frames"),
        ({"scene": "cornell", "sampling": "adaptive"}, "`sampling` adaptive: light is traced anew", "in frames"),
        ({"scene": "two-boxes", "quality": "exact"}, "`sampling` uniform: light is traced anew", "in frames"),
        ({"scene": "cornell", "time": "adaptive"}, "traced again", "between them where it changes, to 100 µs"),
    ],
)
def test_how_light_is_known_and_when_brightness_is_found(options: dict[str, str], light: str, times: str) -> None:
    stages = plan_stages(LiveOptions(**options))
    quality, about_light, about_times = stages.chosen
    assert quality.startswith(f"`quality` {options.get('quality', 'balanced')}: ")
    assert light in about_light and times in about_times


def test_thresholds_are_the_options_else_the_sensors_else_the_scenes() -> None:
    world = replace(load_world("still"), sensor=Sensor(threshold_on=0.3, threshold_off=0.4))
    for given, expected in (({}, (0.3, 0.4)), ({"threshold": (0.1, 0.2)}, (0.1, 0.2))):
        detector = plan_stages(LiveOptions("still", **given), world).detector
        assert (detector.threshold_on, detector.threshold_off) == expected
    half = SensorSettings(threshold=Threshold(off=0.5))
    detector = plan_stages(LiveOptions("still", sensor=half), world).detector
    assert (detector.threshold_on, detector.threshold_off) == (0.3, 0.5)


def test_where_lights_are_set_from_outside_they_are_followed() -> None:
    assert "traced again" in plan_stages(LiveOptions(scene="two-boxes"), lights_set=True).chosen[1]


@pytest.mark.parametrize(("dark_pixels", "told"), [(49, False), (51, True)])
def test_it_is_too_dark_where_half_of_the_picture_is_however_bright_the_rest(dark_pixels: int, told: bool) -> None:
    """0.04 lux leave a DAVIS346 29 % of the contrast; pixels without a level, as of NaN, do not count."""
    lux = np.full(120, 1e4, np.float32)
    lux[:dark_pixels], lux[100:] = 0.04, np.nan
    meter = meter_for(load_sensor("davis346"), Sensor(scale=4.0, lux_per_unit=100.0))
    assert meter is not None
    meter.show_frame(Frame(np.zeros((1, 10, 12), np.float32), ("R",)), np.log(4.0 * lux / 100.0).reshape(10, 12))
    assert (meter.told is not None and "darker than 0.04 lux" in meter.told) is told


@pytest.mark.parametrize("given", [{}, {"threshold_off": 0.5}])
def test_recorded_frames_are_seen_with_the_sensors_thresholds_unless_told_otherwise(given: dict[str, float]) -> None:
    sensor = SensorSettings(threshold=Threshold(0.3, 0.4))
    assert RecordedSensor(sensor).detector(given, "esim") == {"threshold_on": 0.3, "threshold_off": 0.4} | given
