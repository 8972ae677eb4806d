"""Curves of a sensor against closed forms."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from clsim.errors import InputError
from clsim.scene import Sensor
from clsim.sensor import SensorSettings, characteristics, load_sensor
from clsim.sensor.lab import Lab, thresholds_of
from clsim.sensor.pixel_stages import Defects, FrontEnd, Leak, Noise, Threshold
from clsim.sensor.settings import Readout

LUX = np.array([0.1, 10.0, 1000.0])


def test_the_bandwidth_of_two_poles_loses_three_decibels():
    front = FrontEnd(dark_lux=0.5, receptor_hz_per_lux=2.0, follower_hz=21.0)
    hz = characteristics.bandwidth_hz(front, LUX)
    poles = [2.0 * (LUX + 0.5), 21.0]
    assert np.prod([1 + (hz / pole) ** 2 for pole in poles], axis=0) == pytest.approx(2)
    assert hz[1] == pytest.approx(21 * math.sqrt(math.sqrt(2) - 1))  # both poles are one


def test_the_bandwidth_of_one_pole_is_the_pole():
    for front, expected in (
        (FrontEnd(receptor_hz_per_lux=3.0), 3 * LUX),
        (FrontEnd(follower_hz=7.0), [7.0] * 3),
        (FrontEnd(dark_lux=1.0), [math.inf] * 3),
    ):
        assert characteristics.bandwidth_hz(front, LUX) == pytest.approx(np.array(expected))


def test_noise_rates_are_those_of_the_settings():
    settings = SensorSettings(leak=Leak(0.5), noise=Noise((0.0, 0.0), (0.4, 0.1), lux=(0.1, 1000.0)))
    rates = characteristics.noise_rates(settings, LUX)
    watched_s = characteristics.PIXELS * rates.seconds
    for found, expected in zip(rates.off_hz, (0.4, 0.25, 0.1), strict=True):
        assert found == pytest.approx(expected, abs=4 * math.sqrt(expected / watched_s))
    # An OFF event takes back what had leaked: ON fires only where none comes for 2 s, and 2 s later again.
    for found, off in zip(rates.on_hz, (0.4, 0.25, 0.1), strict=True):
        assert found == pytest.approx(off / math.expm1(2 * off), rel=0.03)


def test_a_polarity_whose_rate_is_not_told_has_no_noise():
    noisy = SensorSettings(noise=Noise(off_hz=2.0))
    rates = characteristics.noise_rates(noisy, LUX[:1])
    assert rates.on_hz == [0] and rates.off_hz == pytest.approx([2.0], rel=0.02)
    noisier = replace(noisy, noise=Noise(off_hz=200.0))
    assert characteristics.step_responses(noisier).on[0] == 0, "an OFF event is no answer to a step up"


def test_rates_are_of_the_time_that_is_watched_and_not_of_the_start():
    """A leak alone fires like clockwork, first after 0.67 s: what comes before pixels are at ease is not counted."""
    rates = characteristics.noise_rates(SensorSettings(leak=Leak(1.5)), LUX)
    assert rates.on_hz == pytest.approx(np.full(3, 1.5), rel=1e-6) and not rates.off_hz.any()


def test_latency_is_that_of_a_pole_and_thresholds_are_normal():
    tau_s = 1 / (2 * math.pi * 100)
    settings = SensorSettings(threshold=Threshold(0.3, 0.2, mismatch=0.03), front_end=FrontEnd(follower_hz=100.0))
    latencies = characteristics.step_latencies(settings, LUX)
    for rows, nominal in ((latencies.on_s, 0.3), (latencies.off_s, 0.2)):
        reached = nominal + 0.03 * stats.norm.ppf([[0.1], [0.5], [0.9]])
        expected = -tau_s * np.log(1 - reached / math.log(2))
        assert rows == pytest.approx(np.broadcast_to(expected, rows.shape), rel=0.06)
    for found, nominal in zip(characteristics.thresholds(settings, 2000), (0.3, 0.2), strict=True):
        assert len(found) == 2000 and found.mean() == pytest.approx(nominal, abs=0.003)
        assert found.std() == pytest.approx(0.03, rel=0.07)
    # In 10 ms, 1.3 time constants of such a follower, it has followed seven tenths of a step.
    tau_s = 1 / (2 * math.pi * 20)
    responses = characteristics.step_responses(replace(settings, front_end=FrontEnd(follower_hz=20.0)))
    for shares, nominal in ((responses.on, 0.3), (responses.off, 0.2)):
        expected = stats.norm.cdf(responses.steps * (1 - math.exp(-0.01 / tau_s)), nominal, 0.03)
        assert abs(shares - expected).max() < 4 * math.sqrt(0.25 / characteristics.PIXELS)


@pytest.mark.slow  # of kernels of its own
def test_what_a_curve_is_not_of_is_left_out():
    """Noise and leak fire before a step does, and defects are of few pixels."""
    plain = SensorSettings(threshold=Threshold(0.3, 0.2, mismatch=0.03), front_end=FrontEnd(follower_hz=100.0))
    leaking = replace(plain, leak=Leak(100.0), defects=Defects(hot_share=0.3, dead_share=0.3))
    noisy, calm = (SensorSettings(noise=Noise(0.0, hz)) for hz in (100.0, 1.0))
    faulty = replace(leaking, noise=noisy.noise)
    for found, expected in (
        (characteristics.step_latencies(each, LUX).on_s for each in (faulty, plain)),
        (characteristics.thresholds(each, 400)[0] for each in (faulty, plain)),
        (characteristics.step_responses(each).on for each in (leaking, plain)),
        (characteristics.noise_rates(each, LUX[:1]).on_hz for each in (replace(calm, defects=leaking.defects), calm)),
    ):
        np.testing.assert_array_equal(found, expected)


def test_pixels_without_faults_are_ideal():
    ideal = SensorSettings()
    rates = characteristics.noise_rates(ideal, LUX)
    assert not rates.on_hz.any() and not rates.off_hz.any()
    assert (characteristics.step_latencies(ideal, LUX).on_s == 1e-6).all()
    assert all(found == pytest.approx(np.full(50, 0.2)) for found in characteristics.thresholds(ideal, 50))


@pytest.mark.parametrize("size", [(5, 3), (16, 2), (33, 4)])
def test_each_pixel_of_a_lab_sees_what_it_is_told(size):
    width, height = size
    levels = 0.25 * np.arange(width * height).reshape(height, width)
    lab = Lab(SensorSettings(threshold=Threshold(0.2, 0.2)), width, height)
    assert len(lab.to(0, 0.0).events) == 0
    events = lab.to(1_000, levels).events
    counts = np.zeros((height, width), int)
    np.add.at(counts, (events["y"], events["x"]), 1)
    assert events["on"].all() and (counts == np.floor(levels / 0.2 + 1e-9)).all()


@pytest.mark.parametrize(("on", "off"), [(None, None), (0.3, None), (None, 0.3), (0.3, 0.4)])
def test_a_lab_has_a_scenes_threshold_where_the_sensor_names_none(on, off):
    found = thresholds_of(SensorSettings(threshold=Threshold(on, off)))
    assert (found.on, found.off) == (on or Sensor().threshold_on, off or Sensor().threshold_off)


def test_a_lab_is_as_bright_as_it_is_told():
    lab = Lab(SensorSettings(leak=Leak(parasitic_hz_per_lux=0.01)), 64, lux=1000.0)
    lab.to(0, 0.0)
    assert len(lab.to(100_000_000, 0.0).events) == pytest.approx(64_000, rel=0.02)


def test_readouts_let_as_much_through_as_their_numbers_say():
    def read(asked, **numbers):
        return characteristics.read_rates(SensorSettings(readout=Readout(**numbers)), np.array([asked]))[0]

    assert read(1e6) == pytest.approx(1e6, rel=0.02)
    assert read(4e6, event_us=1.0) == pytest.approx(1e6, rel=1e-3)
    # Rows that all ask are read once a round, with all of their 640 pixels that asked in its time.
    round_s = 480e-6
    assert read(2e7, arbiter="rows", row_us=1.0) == pytest.approx(2e7, rel=0.02)
    pixel_hz = 3e8 / (640 * 480)
    full = -np.expm1(-pixel_hz * round_s) * 640 * 480 / round_s
    assert read(3e8, arbiter="rows", row_us=1.0) == pytest.approx(full, rel=0.02)
    # A scan of 500 µs reads each pixel that asked once.
    assert read(3e8, scan_us=500.0) == pytest.approx(-np.expm1(-pixel_hz * 500e-6) * 640 * 480 / 500e-6, rel=0.02)


@pytest.mark.slow
def test_a_plot_is_a_picture(tmp_path):
    matplotlib = pytest.importorskip("matplotlib.image")
    sensor_plot = pytest.importorskip("clsim.cli.plots.sensor_plot")
    sensor_plot.plot_sensors([SensorSettings()], tmp_path / "a.png")
    sensor_plot.plot_sensors([SensorSettings(), load_sensor("gen3.1")], tmp_path / "b.png")
    one, two = (matplotlib.imread(tmp_path / name) for name in ("a.png", "b.png"))
    assert one.shape == two.shape == (800, 1500, 4) and (one != two).any()


def test_numbers_without_a_measurement_are_marked():
    sensor_plot = pytest.importorskip("clsim.cli.plots.sensor_plot")
    lines, marked = sensor_plot._numbers(load_sensor("dvs128"))
    stars = {line.split("*")[0].strip() for line in lines if "*" in line}
    assert marked and {"front_end.dark_lux", "noise.off_hz", "refractory.us"} <= stars
    assert not stars & {"threshold.mismatch", "optics.width", "front_end.follower_hz"}
    written = [line.split() for line in sensor_plot._numbers(load_sensor("gen4.1"))[0]]
    assert ["readout.arbiter", "rows"] in written and ["readout.row_stamps", "yes"] in written
    assert sensor_plot._numbers(SensorSettings())[1] is False


def test_a_picture_that_cannot_be_written_is_told_so(tmp_path):
    sensor_plot = pytest.importorskip("clsim.cli.plots.sensor_plot")
    with pytest.raises(InputError, match=r"cannot write .*a\.png: there is no folder"):
        sensor_plot.plot_sensors([SensorSettings()], tmp_path / "no" / "a.png")
    with pytest.raises(InputError, match="more than 8 sensors apart in one picture, got 9"):
        sensor_plot.plot_sensors([SensorSettings()] * 9, tmp_path / "a.png")
    assert not list(tmp_path.iterdir())


LOSES = [
    ("gen4.1", 0.0013, 0.006),
    ("genx320", 0.0053, 0.024),
    ("dvxplorer", 0.0079, 0.032),
    ("gen3.1", 0.0094, 0.67),
    ("davis346", 0.52, 0.88),
]


@pytest.mark.parametrize(("name", "at_25_million", "at_100_million"), LOSES)
def test_cameras_lose_as_much_of_25_and_100_million_events_a_second_as_their_page_says(
    name, at_25_million, at_100_million
):
    asked = np.array([25e6, 100e6])
    read = characteristics.read_rates(load_sensor(name), asked)
    # Half a million requests and more are counted, twice.
    np.testing.assert_allclose(1 - read / asked, [at_25_million, at_100_million], atol=0.004)
    page = (Path(__file__).parents[2] / "docs" / "sensor.md").read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if line.startswith(f"| `{name}` |") and "%:" in line)
    told = [float(share) / 100 for share in re.findall(r"([\d.]+) %", row)]
    assert told == pytest.approx([at_25_million, at_100_million], rel=0.06)


@pytest.mark.parametrize(("on", "off"), [(0.1, 0.3), (0.3, 0.1)])
def test_contrasts_go_to_twice_the_larger_threshold(on: float, off: float) -> None:
    """So that where all pixels fire is in the picture, of ON and of OFF."""
    shares = characteristics.step_responses(SensorSettings(threshold=Threshold(on, off, mismatch=0.01)))
    assert shares.steps[-1] == pytest.approx(0.6) and shares.on[-1] == shares.off[-1] == 1.0
    assert shares.on[shares.steps < on - 0.05].max() == shares.off[shares.steps < off - 0.05].max() == 0.0
