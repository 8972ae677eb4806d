"""Pixels that are about to fire get more primary rays, and others fewer: that saves rays, and moves no event."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.frames import SAMPLES, InterestBoard, rendered_planes
from clsim.render import RenderOptions
from clsim.render.motion.standstill import Standstill
from clsim.render.primary.refinement import SHARE_ERROR, NextEvent, error_allowed, fire
from clsim.scene import Material
from tests.render import hand_worlds as hw
from tests.render.cache.test_light_cache import luminance, panning
from tests.render.primary.test_steered import Run, interest

pytestmark = pytest.mark.usefixtures("ordinary")

ON, OFF = 0.25, 0.125
"""Sums of these are exact."""


@wp.kernel
def follow(event: NextEvent, levels: wp.array(dtype=float), out_fired: wp.array2d(dtype=float)):
    """Of a pixel that comes from level to level: what it fired at before each, and the error that is allowed then."""
    fired = levels[0] / 0.0 * 0.0
    for i in range(levels.shape[0]):
        out_fired[0, i] = fired
        out_fired[1, i] = error_allowed(levels[i], fired, event)
        fired = fire(levels[i], fired, event)


def followed(levels):
    event = NextEvent()
    event.on, event.off = ON, OFF
    out = wp.zeros((2, len(levels)), dtype=float, device="cpu")
    wp.launch(follow, dim=1, inputs=[event, wp.array(levels, dtype=float, device="cpu"), out], device="cpu")
    return out.numpy()


@given(st.lists(st.integers(-80, 80).map(lambda n: n / 32), min_size=2, max_size=20))
def test_a_pixel_remembers_what_the_ideal_sensor_remembers(levels):
    """Levels are such that all sums are exact; between them references move one threshold at a time."""
    fired, allowed = followed(levels)
    reference = levels[0]
    assert np.isnan(fired[0]) and allowed[0] == np.float32(SHARE_ERROR)
    for i, level in enumerate(levels[1:], start=1):
        assert fired[i] == reference
        left = (ON if level > reference else OFF) - abs(level - reference)
        assert allowed[i] == pytest.approx(max(left, SHARE_ERROR), abs=1e-6)
        while level - reference >= ON:
            reference += ON
        while reference - level >= OFF:
            reference -= OFF


def fence():
    """Narrow bars of three colours, close together, before a bright sky."""
    colours = (0.05, 0.3, 0.9)
    bars = [
        hw.quad((x, -2.0, 0.03 * (k % 2)), (0.021, 0, 0), (0.3 * (k % 3 - 1), 4.0, 0), material=k % 3)
        for k, x in enumerate(np.arange(-1.5, 1.5, 0.047))
    ]
    view = hw.camera(hw.look_from((0.1, 0.0, 4.0), (0, 0, 0)), 24, 18)
    materials = tuple(Material(color=(c, c, c)) for c in colours)
    return panning(hw.world(*bars, materials=materials, view=view, environment=(1.0, 1.0, 1.0)))


def run(frames, **options):
    """Return levels ``[frames, H·W]`` of the fence, and how many primary rays they took."""
    given = {"light_cache": True, "spp": 4, "probe_spp": 1, "first_hit_rays": 16, "fps": 15.0}
    each = Run(fence(), **given | options)
    levels = np.stack([np.log(luminance(each.fill(index))).ravel() for index in range(frames)])
    return levels, each.tracer.first_hit_rays


def events(levels, threshold):
    """Return how often each pixel fires in each frame, OFF as negative numbers, ``[frames − 1, H·W]``."""
    reference, fired = levels[0].copy(), []
    for level in levels[1:]:
        fired.append(np.trunc((level - reference) / threshold))
        reference += fired[-1] * threshold
    return np.stack(fired)


@pytest.mark.slow
def test_fewer_rays_are_traced_where_no_event_is_near_and_the_same_events_fire():
    """The truth is told by many rays in each pixel; without thresholds, contrast alone decides how many there are."""
    threshold = 0.16
    truth = events(run(18, first_hit_rays=256)[0], threshold)
    found, spent = {}, {}
    for name, fires_at in (("untold", None), ("told", (threshold, threshold)), ("never", (50.0, 50.0))):
        levels, spent[name] = run(18, fires_at=fires_at)
        found[name] = np.abs(events(levels, threshold) - truth).sum()
    assert np.abs(truth).sum() > 60
    assert spent["never"] < 0.5 * spent["told"] < 0.4 * spent["untold"]
    assert found["told"] < found["untold"] < 0.7 * found["never"]


@pytest.mark.slow
@pytest.mark.parametrize("threshold", [0.02, 0.5])
def test_a_still_picture_keeps_its_rays_and_stays_as_it_is(monkeypatch, threshold):
    """In the first frame no event is far, and then fewer rays would do: they would show something else."""
    monkeypatch.setattr(Standstill, "repeat", lambda *_: False)
    world = fence()
    still = replace(world, camera=replace(world.camera, motion=hw.camera(world.camera.motion.pose(0.0)).motion))
    each = Run(still, light_cache=True, spp=4, probe_spp=1, first_hit_rays=16, fires_at=(threshold, threshold))
    levels = np.stack([np.log(luminance(each.fill(index))).ravel() for index in range(6)])
    assert np.ptp(levels, axis=0).max() < 1e-4


def test_thresholds_are_for_light_that_is_cached_in_frames_alone():
    for wrong in ({"light_cache": False}, {"light_hz": 120.0}, {"fires_at": (0.2, 0.0)}):
        with pytest.raises(
            InputError, match=r"`fires_at` .* needs positive thresholds, `light_cache` and no `light_hz`"
        ):
            RenderOptions(**{"first_hit_rays": 16, "light_cache": True, "fires_at": (0.2, 0.2)} | wrong)


@pytest.mark.slow
def test_without_a_cache_what_changes_near_an_event_gets_more_rays_and_still_pixels_stay():
    world = fence()
    still = replace(world, camera=replace(world.camera, motion=hw.camera(world.camera.motion.pose(0.0)).motion))
    columns = np.tile(np.arange(24), (18, 1))
    near, around, moving = columns % 8 == 0, np.isin(columns % 8, (7, 0, 1)), columns < 12

    def samples(rays, **options):
        board = InterestBoard()
        each = Run(still, board, spp=2, probe_spp=1, first_hit_rays=rays, **options)
        shown = []
        for index in range(4):
            shown.append(each.fill(index).planes)
            map_ = interest(index, near)
            board.publish(replace(map_, change=np.where(moving, 1e-4, 0.0).astype(np.float32)))
        return np.stack(shown)[:, rendered_planes(first_hit_rays=True).first(SAMPLES[0])], np.stack(shown)[:, :3]

    counts, shown = samples(16)
    many = counts[0] > 31
    assert many.mean() > 0.3, "shares are counted there, by twice as many rays at least"
    np.testing.assert_array_equal(counts[1] > 31, many, "there is no map yet")
    np.testing.assert_array_equal(counts[3][many] > 31, (around | ~moving)[many])
    np.testing.assert_allclose(shown[3][:, ~moving], shown[0][:, ~moving], rtol=1e-4)
    assert samples(8)[0].max() < 31, "few rays are traced everywhere where few are wanted"
    assert samples(16, light_hz=120.0)[0].max() < 31, "and where pixels are seen between frames too"
