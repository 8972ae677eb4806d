"""Several cameras over one world on the device: one upload, one tree, and each its own picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions, SceneData, View
from clsim.render.accel import upload_geometry
from clsim.render.kernel_input import settings_of
from clsim.scene import Sensor, Static
from tests.render import hand_worlds as hw
from tests.render.motion.test_blur import Glide, Spin, strip, view
from tests.render.test_tracer import moving_world

pytestmark = pytest.mark.usefixtures("any_lights")

OPTIONS = RenderOptions(spp=4, threads=1, variances=True)


def eyes(width=12):
    """Left and right, 6 cm apart; the right one's picture is wider."""
    poses = [hw.look_from((x, 1, 3), (x, 0, 0)) for x in (0.47, 0.53)]
    return [hw.camera(pose, width + k, 10) for k, pose in enumerate(poses)]


def shoot(source, index):
    frame = Frame(page_aligned((len(source.names), source.height, source.width)), source.names)
    source.fill(index, frame)
    return frame.planes


def alone(scene, camera, index, options=OPTIONS):
    tracer = PathTracer(hw.with_camera(scene, camera), options)
    try:
        return shoot(tracer, index)
    finally:
        tracer.close()


def test_a_stereo_pair_takes_one_upload_and_equals_two_tracers(monkeypatch):
    scene, built, refits = moving_world(), [], []
    build, refit = upload_geometry.Bvh16.__init__, upload_geometry.GeometryData.update
    monkeypatch.setattr(
        upload_geometry.Bvh16, "__init__", lambda self, *a, **k: (built.append(a), build(self, *a, **k))[1]
    )
    monkeypatch.setattr(
        upload_geometry.GeometryData, "update", lambda self, times: (refits.append(times), refit(self, times))[1]
    )
    data = SceneData(scene)
    trees = len(built)
    views = [View(data, OPTIONS, camera=camera) for camera in eyes()]
    pictures = {(index, k): shoot(each, index) for index in (0, 7) for k, each in enumerate(views)}
    for each in views:
        each.close()
    assert len(built) == trees == 3 and len(refits) == 2
    for (index, k), picture in pictures.items():
        np.testing.assert_array_equal(picture, alone(scene, eyes()[k], index))
    assert np.any(pictures[0, 0] != pictures[0, 1][:, :, :12])


def test_views_may_alternate_at_different_times():
    """A view that goes back in time finds the world as it was, whatever another has seen meanwhile."""
    data = SceneData(moving_world())
    left, right = (View(data, OPTIONS, camera=camera) for camera in eyes())
    first = shoot(left, 2)
    shoot(right, 8)
    np.testing.assert_array_equal(shoot(left, 2), first)


@pytest.mark.slow
@pytest.mark.parametrize("shutter_s", [0.0, 0.25])
def test_an_exposure_may_be_shorter_than_the_interval(shutter_s):
    """A strip glides at 1 m/s: its edges are smeared by the exposure, whatever interval the data covers."""
    scene = strip(Glide((-0.75, 0, 0)), view(shutter_s=shutter_s))
    options = replace(OPTIONS, spp=256, max_depth=1)
    data = SceneData(scene, interval_s=1.0)
    ours, lone = shoot(View(data, options), 1), alone(scene, scene.camera, 1, options)
    np.testing.assert_allclose(ours[10], lone[10], atol=1e-6 if shutter_s == 0 else 0.01)
    assert abs(ours[10].mean() - 0.25) < 0.01


@pytest.mark.slow
def test_a_camera_alone_that_moves_is_blurred_over_a_still_world():
    scene = strip(Static(hw.translation(0.25, 0, 0)), view(Glide((1, 0, 0), (-1.0, 0, 0))))
    data = SceneData(scene)
    assert not data.features.motion_blur
    turning = replace(scene.camera, motion=Spin())
    for camera in (scene.camera, turning, replace(scene.camera, shutter_s=0.0)):
        options = replace(OPTIONS, spp=16, max_depth=1)
        np.testing.assert_array_equal(shoot(View(data, options, camera=camera), 1), alone(scene, camera, 1, options))


def test_an_exposure_longer_than_the_interval_is_refused():
    scene = strip(Glide(), view(shutter_s=0.5))
    with pytest.raises(InputError, match=r"0\.5 s, expected at most .* 0\.25 s"):
        View(SceneData(scene, interval_s=0.25), OPTIONS)


@pytest.mark.parametrize(("duration_s", "fps", "frames"), [(0.29, 100.0, 30), (1.001, 30.0, 31), (0.2, 1.0, 2)])
def test_a_view_has_frames_until_its_motion_ends(duration_s, fps, frames):
    """0.29 s at 100 frames a second are 29 intervals, though 0.29 · 100 is a little less."""
    world = replace(moving_world(), duration_s=duration_s, fps=fps)
    assert View(SceneData(world), OPTIONS).frame_count == frames


@pytest.mark.parametrize("noise", ["independent", "common"])
def test_a_loop_has_the_noise_of_later_frames_where_each_has_its_own(noise):
    """The second round shows the first one's frames with the random numbers that a run without a loop would have."""
    source = View(SceneData(moving_world(0.0)), replace(OPTIONS, noise=noise), camera=eyes()[0])
    later = shoot(source, 5)
    source.noise_offset = 4
    np.testing.assert_array_equal(shoot(source, 1), later)
    source.noise_offset = 0
    assert np.array_equal(shoot(source, 1), later, equal_nan=True) == (noise == "common")
    source.close()


def test_the_darkest_light_that_pixels_see_is_their_floor_before_it_is_scaled():
    assert settings_of(OPTIONS, eyes()[0], Sensor(scale=4.0, floor=1e-3)).darkest == pytest.approx(2.5e-4)
