"""Parallel rays, against closed forms: where they go, what they show, and where that goes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions, SceneData
from clsim.render.subframe.retracer import Retracer
from clsim.scene import Camera, Instance, Lens, Material, Static, World
from clsim.scene.motion import Keyframes
from clsim.scene.validate import validate
from clsim.scene.world import CheckerTexture
from tests.render import hand_worlds as hw
from tests.render.camera.test_camera import trace_rays
from tests.render.truth.test_truth import PLANES, filled, moving

pytestmark = pytest.mark.slow  # kernels of their own are compiled

LENS = Lens(model="orthographic", view_width_m=3.0)
POSE = hw.look_from((0.4, 1.5, 2.5), (0.1, 0.0, -0.2), up=(0.2, 1.0, 0.0))
T0_S, T1_S = 0.1, 0.18
STRAIGHT = ((0.0, 0.0, 0.0, 1.0),) * 2


def through(pose, camera):
    """Where rays through pixels' centres begin ``[n, 3]``, and which way they go."""
    y, x = np.meshgrid(np.arange(camera.height) + 0.5, np.arange(camera.width) + 0.5, indexing="ij")
    per_m = camera.width / camera.lens.view_width_m
    off = np.stack([x - camera.width / 2, -(y - camera.height / 2)], axis=-1).reshape(-1, 2) / per_m
    return pose[:3, 3] + off @ pose[:3, :2].T, -pose[:3, 2]


def on_image(pose, camera, points):
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    per_m = camera.width / camera.lens.view_width_m
    return np.stack([camera.width / 2 + local[:, 0] * per_m, camera.height / 2 - local[:, 1] * per_m], axis=1)


@pytest.mark.parametrize(
    "lens",
    [LENS, replace(LENS, principal_point=(0.1, -0.2)), replace(LENS, mirrored=True), replace(LENS, aspect=0.5)],
)
def test_rays_are_parallel_and_begin_in_a_plane(lens) -> None:
    camera = Camera(64, 48, 45.0, Static(POSE), lens=lens)
    xy = np.random.default_rng(0).random((500, 2)).astype(np.float32) * (64, 48)
    origins, directions, exists = trace_rays(camera, xy)
    assert exists.all()
    np.testing.assert_allclose(directions, np.tile([0.0, 0.0, 1.0], (500, 1)), atol=1e-6)
    local = (origins - POSE[:3, 3]) @ POSE[:3, :3]
    per_m = 64 / 3.0
    across = (xy[:, 0] - 64 * (0.5 + lens.principal_point[0])) / per_m * (-1 if lens.mirrored else 1)
    down = (xy[:, 1] - (24 + 64 * lens.principal_point[1])) / per_m * lens.aspect
    np.testing.assert_allclose(local, np.stack([across, -down, np.zeros(500)], axis=1), atol=1e-5)


def tilted(camera_motion) -> World:
    camera = Camera(32, 24, 45.0, camera_motion, lens=LENS)
    wall = hw.quad((-9, -9, 0), (18, 0, 0), (0, 18, 0))
    passes = moving((0.0, 0.0, -1.0), (0.9, 0.3, -0.5), (10, 20, 5), (20, -30, 15))
    return World("tilted", camera, (wall,), (Instance(0, passes, "wall"),), (hw.GREY,), environment=(1.0, 1.0, 1.0))


def test_depth_and_flow_of_a_plane_that_turns_before_a_camera_that_turns() -> None:
    camera_motion = moving((0.0, 0.2, 3.0), (0.3, 0.1, 2.7), end_turn_deg=(2, 6, 30))
    world = tilted(camera_motion)
    camera = world.camera
    found = filled(world, planes=PLANES)
    now, then = camera_motion.pose(T0_S), camera_motion.pose(T1_S)
    wall = world.instances[0].motion
    before, after = wall.pose(T0_S), wall.pose(T1_S)
    origins, axis = through(now, camera)
    depth = ((before[:3, 3] - origins) @ before[:3, 2]) / (axis @ before[:3, 2])
    points = origins + depth[:, None] * axis
    moved = (points - before[:3, 3]) @ before[:3, :3] @ after[:3, :3].T + after[:3, 3]
    flow = (on_image(then, camera, moved) - on_image(now, camera, points)).reshape(24, 32, 2)
    np.testing.assert_allclose(found["Z"].ravel(), depth, rtol=3e-6)
    np.testing.assert_allclose(found["Truth.Depth"].ravel(), depth, rtol=3e-6)
    assert np.abs(np.stack([found["Flow.forward.X"], found["Flow.forward.Y"]], axis=-1) - flow).max() < 1e-3
    assert found["Flow.forward.valid"].all() and np.abs(flow).max() > 2
    ends = on_image(then, camera, moved)
    inside = ((ends > 1e-3) & (ends < (32 - 1e-3, 24 - 1e-3))).all(axis=1).reshape(24, 32)
    assert found["Flow.forward.covisible"][inside].all()


def test_the_sky_has_no_flow() -> None:
    world = replace(tilted(Static(hw.translation(0, 0, -5))), environment=(1.0, 1.0, 1.0))
    found = filled(world, planes=PLANES)
    assert np.isinf(found["Z"]).all() and not found["Flow.forward.valid"].any()


def a_room() -> World:
    """A box on a finely chequered floor, below a lamp, seen from above at a slant."""
    floor = hw.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6))
    crate = hw.box((-0.4, 0.0, -0.4), (0.4, 0.7, 0.4), material=1)
    lamp = hw.quad((-0.5, 3, -0.5), (1, 0, 0), (0, 0, 1), material=2)
    checks = CheckerTexture((0.8, 0.8, 0.8), (0.2, 0.2, 0.2), 6.0)
    materials = (Material(texture=0, color=(1.0, 1.0, 1.0)), hw.GREY, Material(emission=(9.0, 9.0, 9.0)))
    instances = tuple(Instance(i, hw.IDENTITY) for i in range(3))
    camera = Camera(40, 30, 45.0, moving((0.0, 3.0, 3.0), (0.4, 3.0, 3.0), (-40, 0, 0), (-40, 0, 0)), lens=LENS)
    return World("room", camera, (floor, crate, lamp), instances, materials, (checks,), environment=(0.1, 0.1, 0.1))


def planes_of(world: World, options: RenderOptions, frames: int = 1):
    tracer = PathTracer(world, options)
    try:
        frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
        for index in range(frames):
            tracer.fill(index, frame)
        return dict(zip(tracer.names, frame.planes.copy(), strict=True))
    finally:
        tracer.close()


def test_first_hit_rays_and_cached_light_show_what_paths_show() -> None:
    """Flat textures, edges and cells of light are as wide as metres of a pixel ask for."""
    world = a_room()
    paths = planes_of(world, RenderOptions(spp=1024, threads=2), 2)
    for more in ({}, {"light_cache": True, "probe_spp": 8}):
        found = planes_of(world, RenderOptions(spp=64, first_hit_rays=64, threads=2, **more), 2)
        off = found["Albedo.G"] - paths["Albedo.G"]
        assert np.sqrt((off**2).mean()) < 0.02, more
        assert np.sqrt(((found["Depth"] - paths["Depth"]) ** 2).mean()) < 0.01, more
        ratio = found["G"].mean() / paths["G"].mean()
        assert ratio == pytest.approx(1.0, abs=0.02), more


def test_textures_close_before_the_camera_are_not_seen_in_perspective() -> None:
    """At the picture's bottom rays begin just above the floor: each row is several times as far as the one below."""
    low = Static(hw.look_from((0.0, 1.0, 0.0), (0.0, 1.0 - np.tan(np.pi / 6), -1.0)))
    room = a_room()
    world = replace(room, camera=replace(room.camera, motion=low))
    paths = planes_of(world, RenderOptions(spp=1024, threads=2))["Albedo.G"]
    found = planes_of(world, RenderOptions(spp=64, first_hit_rays=64, threads=2))["Albedo.G"]
    assert np.abs(found - paths)[-4:].max() < 0.05


def test_pixels_between_frames_are_those_of_frames() -> None:
    world = a_room()
    options = RenderOptions(spp=16, first_hit_rays=32, noise="common", threads=2)
    expected = planes_of(replace(world, fps=10.0), options, 2)
    tracer = Retracer(SceneData(world, instants=True), options)
    try:
        pixels = np.arange(40 * 30, dtype=np.int32)
        planes = tracer.trace(pixels, np.full(len(pixels), 0.1))
        found = dict(zip(tracer.names, planes.reshape(-1, 30, 40), strict=True))
    finally:
        tracer.close()
    for name in ("Albedo.G", "Depth", "Coverage"):
        np.testing.assert_allclose(found[name], expected[name], atol=1e-4)


def test_ways_on_the_image_are_the_same_at_any_distance() -> None:
    """A wall and a box before it go to the right by the same way, whatever the camera does along its axis."""
    wall, box = hw.quad((-9, -9, -2), (18, 0, 0), (0, 18, 0)), hw.box((-0.5, -0.5, -1), (0.5, 0.5, 0))
    goes = Keyframes((0.0, 1.0), ((0, 0, 0), (1.5, 0, 0)), STRAIGHT)
    back = Keyframes((0.0, 1.0), ((0, 0, 1), (0, 0.5, 4)), STRAIGHT)
    view = Camera(16, 12, 45.0, back, lens=replace(LENS, view_width_m=4.0))
    world = hw.world(wall, box, view=view, motions=[goes, goes], fps=10.0)
    tracer = Retracer(SceneData(world, instants=True), RenderOptions(spp=1, max_depth=1))
    ways = tracer.motion(0.0, 0.1)
    tracer.close()
    expected = np.broadcast_to(np.array([0.15, 0.05])[:, None, None] * 4, (2, 12, 16))
    np.testing.assert_allclose(ways[:2], np.stack([expected, expected]), atol=2e-4)


@pytest.mark.parametrize(
    ("lens", "problem"),
    [
        (Lens(model="orthographic"), "view_width_m is 0.0"),
        (replace(LENS, aperture_radius_m=0.1), "no aperture_radius_m"),
        (replace(LENS, distortion=(0.1,)), "no distortion"),
    ],
)
def test_what_parallel_rays_do_not_have_is_refused(lens, problem) -> None:
    world = hw.with_camera(hw.world(hw.ball(1.0)), Camera(8, 8, 45.0, hw.IDENTITY, lens=lens))
    with pytest.raises(InputError, match=problem):
        validate(world, "here")
