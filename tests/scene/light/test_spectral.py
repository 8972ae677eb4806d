"""Weights of R, G and B: where silicon's are from, and that the events follow them in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import clsim
from clsim.errors import InputError
from clsim.frames import Frame, page_aligned
from clsim.live.options import LiveOptions
from clsim.live.stages import plan_stages
from clsim.render import PathTracer, RenderOptions
from clsim.scene import load_world
from clsim.scene.light.spectral import WEIGHTS, spectral_weights
from clsim.sensor import load_sensor

WALL = """
fps = 100
duration_s = 0.1
[camera]
position = [0.0, 0.0, 0.0]
resolution = [8, 6]
[materials.glow]
color = [0.0, 0.0, 0.0]
emission = [0.8, 0.1, 0.05]
modulation = { kind = "keyframes", keyframes = [{ time_s = 0.0, factor = 1.0 },
    { time_s = 0.1, factor = [1.0, 1.0, 9.0] }] }
[[objects]]
shape = "quad"
size = [40.0, 40.0]
position = [0.0, 0.0, -2.0]
rotation_deg = [90.0, 0.0, 0.0]
material = "glow"
"""
"""A wall that shines in red, green and ever more blue."""
BANDS_NM = {"R": (580, 700), "G": (490, 580), "B": (400, 490)}
NM = np.arange(400, 701, 20)
# Extinction coefficient of silicon at 295 K (Schinke et al. 2015), and CIE D65, every 20 nm from 400 nm.
EXTINCTION = [
    0.32627, 0.17694, 0.11201, 0.079105, 0.059817, 0.048542, 0.039531, 0.029896, 0.026551, 0.021896, 0.018521,
    0.016809, 0.014693, 0.013608, 0.012045, 0.010623,
]  # fmt: skip
DAYLIGHT = [
    82.7549, 93.4318, 104.865, 117.812, 115.923, 109.354, 104.790, 104.405, 100.000, 95.7880, 90.0062, 87.6987,
    83.6992, 80.2146, 78.2842, 71.6091,
]  # fmt: skip


def test_silicon_absorbs_these_shares_of_daylight():
    per_um = 4 * np.pi * np.array(EXTINCTION) / (NM * 1e-3)
    photons = np.array(DAYLIGHT) * NM * (1 - np.exp(-3.0 * per_um))
    fine = np.arange(400, 700, 0.5) + 0.25
    found = np.interp(fine, NM, photons)
    shares = [found[(fine > low) & (fine < high)].sum() / found.sum() for low, high in BANDS_NM.values()]
    np.testing.assert_allclose(WEIGHTS["silicon"], shares, atol=3e-3)


def test_weights_are_shares_and_white_is_as_bright_as_ever():
    assert spectral_weights((0.0, 3.0, 1.0)) == (0.0, 0.75, 0.25)
    for name in WEIGHTS:
        assert sum(spectral_weights(name)) == pytest.approx(1.0, abs=1e-6)


def scene(tmp_path, spectral):
    path = tmp_path / "wall.toml"
    path.write_text(WALL + ("" if spectral is None else f"[sensor]\nspectral = {spectral}\n"))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spectral", "weights"),
    [
        (None, WEIGHTS["luminance"]),
        ('"luminance"', WEIGHTS["luminance"]),
        ('"silicon"', WEIGHTS["silicon"]),
        ("[0, 0, 2]", (0.0, 0.0, 1.0)),
        ("[1, 0, 0]", (1.0, 0.0, 0.0)),
    ],
)
def test_events_are_those_of_the_weighted_light(tmp_path, spectral, weights):
    """Each pixel fires as often as 0.2 goes into the change of ln of the weighted sum."""
    first, last = (np.dot(weights, (0.8, 0.1, blue)) for blue in (0.05, 0.45))
    expected = int(np.log(last / first) / 0.2 + 1e-6)
    with clsim.stream(scene(tmp_path, spectral), method="esim", spp=1) as run:
        events = np.concatenate([batch.copy() for batch in run])
    assert len(events) == 48 * expected
    assert np.all(events["on"])


def test_the_sensor_files_weights_hold_and_not_the_scenes(tmp_path):
    camera = tmp_path / "camera.toml"
    camera.write_text("[optics]\nspectral = [0.0, 1.0, 1.0]\n")
    stages = plan_stages(LiveOptions(str(scene(tmp_path, '"silicon"')), sensor=str(camera)))
    assert stages.world.sensor.spectral == (0.0, 1.0, 1.0)
    assert stages.detector.luminance == (0.0, 0.5, 0.5)
    without = plan_stages(LiveOptions(str(scene(tmp_path, '"silicon"')), sensor="ideal"))
    assert without.detector.luminance == WEIGHTS["silicon"]


def test_footage_is_seen_by_the_sensors_weights(tmp_path):
    camera = tmp_path / "camera.toml"
    camera.write_text("[optics]\nspectral = [0, 0, 1]\n")
    pictures = np.full((2, 4, 4, 3), 0.5, np.float32)
    pictures[1, ..., 2] = 1.0
    batches = [len(b) for b in clsim.events_from(pictures, [0, 1000], transfer="linear", sensor=str(camera))]
    assert sum(batches) == 16 * int(np.log(2) / 0.2)


@pytest.mark.parametrize("spectral", ["[0, 1]", '"infrared"', "[0, 0, 0]", "[1, -1, 1]", "true", "[1, nan, 1]"])
def test_other_values_are_refused(tmp_path, spectral):
    with pytest.raises(InputError, match=r"sensor.spectral: expected luminance, silicon, or weights"):
        load_world(scene(tmp_path, spectral))
    if spectral != '"infrared"':
        camera = tmp_path / "camera.toml"
        camera.write_text(f"[optics]\nspectral = {spectral}\n")
        with pytest.raises(InputError, match="`spectral` must be"):
            load_sensor(str(camera))


@pytest.mark.slow
@pytest.mark.parametrize("light_cache", [False, True])
def test_what_frames_hold_of_brightness_follows_the_weights(tmp_path, light_cache):
    world = load_world("two-boxes" if light_cache else "cornell", resolution=(40, 30))
    red = replace(world, sensor=replace(world.sensor, spectral=(1.0, 0.0, 0.0)))
    noisy = render(red, RenderOptions(spp=8, variances=True))
    np.testing.assert_allclose(noisy.plane("Variance.Luminance"), noisy.plane("Variance.R"), rtol=1e-5)
    options = RenderOptions(spp=8, first_hit_rays=16, light_cache=light_cache)
    frames = {name: render(each, options) for name, each in (("eye", world), ("red", red))}
    lamps = {name: frame.plane("Emission") for name, frame in frames.items()}
    # Where a surface reflects, that plane has light straight from lamps as well.
    shining = (lamps["eye"] > 0) & (frames["eye"].plane("Albedo.R") < 0.01)
    assert shining.any()
    lamp = world.environment if light_cache else (38.0, 30.0, 19.0)
    expected = lamp[0] / np.dot(WEIGHTS["luminance"], lamp)
    np.testing.assert_allclose(lamps["red"][shining] / lamps["eye"][shining], expected, rtol=1e-4)


def render(world, options):
    tracer = PathTracer(world, options)
    frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
    tracer.fill(0, frame)
    tracer.close()
    return frame
