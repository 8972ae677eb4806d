"""Events of light that flickers, against the times at which its log crosses thresholds."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import clsim
from clsim.scene import World
from clsim.scene.modulation import Keyframed, Modulation, Pwm, Sine
from tests.simulator.stage import scene

STEP = 0.2
MOVING = "keyframes = [{ time_s = 0.0, position = [0.0, 0.0, 0.0] }, { time_s = 1.0, position = [1e-9, 0.0, 0.0] }]"
"""A box that goes nowhere: its kernel is one that other tests have compiled."""
MAINS = Sine(100.0, 0.6)


def stage(folder: Path, modulation: Modulation) -> World:
    """All light is modulated alike, and so is every pixel's."""
    world = clsim.load_scene(scene(folder, MOVING))
    lamps = tuple(replace(each, modulation=modulation) for each in world.sphere_lights)
    small = replace(world.camera, width=16, height=12)
    return replace(world, camera=small, sphere_lights=lamps, environment_modulation=modulation, duration_s=0.05)


def crossings(sine: Sine, end_s: float) -> list[tuple[float, bool]]:
    """Return when ln(1 + depth·sin θ) has moved by STEP since it last had, and whether upwards.

    From crest to trough to crest θ = m·π + (−1)^m·arcsin s, where s = (exp(k·STEP) − 1) / depth at the level k·STEP.
    """
    found, level = [], 0
    for m in range(int(2 * sine.frequency_hz * end_s) + 2):
        way = 1 if m % 2 == 0 else -1
        while abs(s := (np.exp((level + way) * STEP) - 1) / sine.depth) <= 1:
            level += way
            found.append(((m * np.pi + way * np.arcsin(s)) / (2 * np.pi * sine.frequency_hz), way > 0))
    return [(t, up) for t, up in found if t <= end_s]


def pixels_of(events: npt.NDArray[Any], world: World) -> list[npt.NDArray[Any]]:
    """Return the events of each pixel."""
    camera = world.camera
    return [events[(events["x"] == x) & (events["y"] == y)] for y in range(camera.height) for x in range(camera.width)]


@pytest.mark.parametrize(
    "options",
    [
        {},
        *(
            pytest.param(each, marks=pytest.mark.slow)
            for each in ({"quality": "draft"}, {"quality": "accurate"}, {"quality": "exact", "spp": 4})
        ),
        *(pytest.param({"method": method}, marks=pytest.mark.slow) for method in ("esim-ad", "wlr-esim", "irradiance")),
    ],
    ids=lambda options: "-".join(map(str, options.values())) or "balanced",
)
def test_mains_flicker_has_the_events_of_its_closed_form(tmp_path: Path, options: dict[str, Any]) -> None:
    """Ten frames a period, the fewest that no warning is for, and forty; the error falls with the square.

    But for a pixel in a hundred: light that is known better may ask for more rays, which see other shares.
    """
    world = stage(tmp_path, MAINS)
    for fps, tolerance_us in ((1000.0, 150), (4000.0, 12)):
        expected = crossings(MAINS, 0.038)
        with clsim.Simulator(world, fps=fps, **options) as run:
            assert not [sentence for sentence in run.warnings if "changes too fast" in sentence]
            events = run.step(38_000)
        late_us = []
        for own in pixels_of(events, world):
            assert own["on"].tolist() == [up for _, up in expected]
            late_us.append(np.abs(own["t"] - [t * 1e6 for t, _ in expected]).max())
        # In a rare pixel what is learnt of light changes the number of its rays, and so its share by a hundredth.
        assert np.quantile(late_us, 0.99) < tolerance_us and max(late_us) < 250
    # ln 1.6 is 2 steps up, ln .4 is 4 down: the first quarter, then four falls and three rises.
    assert [up for _, up in expected] == [True] * 2 + ([False] * 6 + [True] * 6) * 3 + [False] * 6


def test_a_switched_lamp_fires_at_its_edges_and_nowhere_else(tmp_path: Path) -> None:
    """At 1/4 of its light the log is ln 4 = 1.39 lower: five steps of .25 down, six of .2 up."""
    led = Pwm(200.0, 0.4, low=0.25)
    world = stage(tmp_path, led)
    with clsim.Simulator(world, fps=4000.0, threshold=(0.2, 0.25)) as run:
        events = run.step(11_000)
    for own in pixels_of(events, world):
        assert own["on"].tolist() == ([False] * 5 + [True] * 6) * 2
        for first, edge_us in ((0, 2_000), (5, 5_000), (11, 7_000), (16, 10_000)):
            times_us = own["t"][first : first + 5]
            assert edge_us - 250 < times_us.min() <= times_us.max() <= edge_us


def test_a_lamp_at_the_frame_rate_looks_constant_and_a_warning_says_so(tmp_path: Path) -> None:
    with clsim.Simulator(stage(tmp_path, Sine(200.0, 0.6)), fps=200.0) as run:
        assert len(run.step(30_000)) == 0
        assert run.warnings == (
            "the light of the environment changes too fast for 200 frames per simulated second, so that it looks "
            "slower than it is, or constant: expected `fps` of at least 2000",
        )


def test_darkness_is_dark_whatever_was_cached_before(tmp_path: Path) -> None:
    """What steered samples remember of the light that was must not shine on; few first-hit rays are always the same."""
    off = Keyframed((0.0, 0.01, 0.02), ((1.0,) * 3, (0.0,) * 3, (2.0,) * 3), step=True)
    with clsim.Simulator(stage(tmp_path, off), fps=400.0, first_hit_rays=8) as run:
        pictures = []
        for until_us in (7_500, 12_500, 22_500):
            run.step(until_us)
            pictures.append(run.frame().planes[:3])
    lit, dark, twice = pictures
    assert lit.max() > 0.1 and dark.max() == 0
    np.testing.assert_allclose(twice, 2 * lit, rtol=5e-3, atol=1e-6)


@pytest.mark.slow
def test_light_within_an_exposure_is_its_mean(tmp_path: Path) -> None:
    """Over a whole period flicker is gone; over half of one, crest and trough are 1 ± 2·depth/π, halfway it is 1."""
    extremes = 1 + 1.2 / np.pi, 1 - 1.2 / np.pi
    for shutter_s, phase_deg, expected in ((0.01, 90.0, (1.0, 1.0)), (0.005, 90.0, extremes), (0.005, 0.0, (1.0, 1.0))):
        world = stage(tmp_path, replace(MAINS, phase_deg=phase_deg))
        world = replace(world, camera=replace(world.camera, shutter_s=shutter_s))
        with clsim.Simulator(world, fps=200.0, method="esim") as run:
            run.step(0)
            crest = run.frame().planes[:3].mean()
            run.step(5_000)
            trough = run.frame().planes[:3].mean()
        assert trough / crest == pytest.approx(expected[1] / expected[0], rel=1e-4)


def test_a_gate_that_does_not_see_changing_light_says_so(tmp_path: Path) -> None:
    world = stage(tmp_path, Sine(10.0))
    with clsim.Simulator(world, fps=200.0, quality="published") as run:
        assert run.warnings == ("`gate` delta-r sees what moves, but no light that changes: expected radiance",)


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"quality": "exact", "spp": 4}], ids=["balanced", "exact"])
def test_pixels_between_frames_are_seen_in_the_light_of_their_time(tmp_path: Path, options: dict[str, Any]) -> None:
    """Something moves, so they are traced; frames are as many as the flicker needs, and exact follows it between."""
    world = stage(tmp_path, Sine(24.0, 0.6))
    expected = crossings(Sine(24.0, 0.6), 0.05)
    with clsim.Simulator(world, time="adaptive", time_tolerance_us=20.0, **options) as run:
        assert run.fps == 240.0
        events = run.step(50_000)
    for own in pixels_of(events, world):
        assert own["on"].tolist() == [up for _, up in expected]
        late_us = np.abs(own["t"] - [t * 1e6 for t, _ in expected])
        assert late_us.max() < (60 if options else 500)
