"""Chosen pixels at chosen times: the same bits as the frame of that time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.frames import Frame, frame_time_us, page_aligned
from clsim.render import PathTracer, RenderCancelled, RenderOptions, SceneData
from clsim.render.device.launch import Tiles
from clsim.render.subframe.retracer import Retracer
from clsim.scene import ImageTexture, Instance, Material, PunctualLight, SphereLight, Static, load_world
from clsim.scene.driven import CAMERA, Driven, place_of, with_driven
from clsim.scene.motion import Keyframes
from tests.render import hand_worlds as hw
from tests.render.motion.test_blur import Glide
from tests.render.motion.test_deform import swelling

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("ordinary")]  # kernels of their own are compiled

FPS = 30.0
FRAMES = (0, 3, 4, 11)


@dataclass(frozen=True)
class Swing:
    """Turns fast about the vertical, and goes along a slope."""

    start: np.ndarray
    velocity: tuple[float, float, float] = (0.7, 0.1, 0.0)
    turns_per_s: float = 0.0
    duration_s: float = 10.0

    def pose(self, time_s):
        angle = 2 * np.pi * self.turns_per_s * time_s
        turn = np.eye(4)
        turn[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        return hw.translation(*np.multiply(time_s, self.velocity)) @ self.start @ turn


def busy_world(camera_moves=True, objects_move=True, size=(13, 11)):
    """A spinning block over a floor, under a sphere light and a spot that go their ways."""
    start = hw.look_from((0.2, 1.1, 2.5), (0, 0.2, 0))
    camera = replace(hw.camera(start, *size, fov_deg=60.0), motion=Swing(start) if camera_moves else Static(start))
    floor = hw.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6))
    block = hw.box((-0.3, 0.1, -0.3), (0.3, 0.6, 0.3), material=1)
    spin = Swing(np.eye(4), turns_per_s=11.0) if objects_move else Static(np.eye(4))

    def place(x, y, z):
        pose = hw.look_from((x, y, z), (0, 0, 0))
        return Swing(pose, (-1.5, 0.2, 0.1)) if objects_move else Static(pose)

    world = hw.world(
        floor, block, materials=(hw.GREY, Material(color=(0.7, 0.2, 0.1))), view=camera,
        motions=[hw.IDENTITY, spin], fps=FPS,
    )  # fmt: skip
    return replace(
        world,
        sphere_lights=(SphereLight(0.2, (9.0, 8.0, 7.0), place(1, 1.6, 0.5)),),
        punctual_lights=(PunctualLight("spot", (6.0, 6.0, 4.0), place(-1.0, 2.0, 1.0)),),
    )


def frames(world, options):
    tracer = PathTracer(world, options)
    frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
    try:
        for index in FRAMES:
            tracer.fill(index, frame)
            yield index, frame.copy()
    finally:
        tracer.close()


def compare(world, options, left_out=()):
    """All pixels of several frames in one list, shuffled."""
    retracer = Retracer(SceneData(world, instants=True), options)
    pixels = world.camera.width * world.camera.height
    times_s = np.repeat([frame_time_us(index, FPS) * 1e-6 for index in FRAMES], pixels)
    shuffled = np.random.default_rng(1).permutation(len(times_s))
    try:
        found = np.empty((len(retracer.names), len(times_s)), np.float32)
        found[:, shuffled] = retracer.trace((shuffled % pixels).astype(np.int32), times_s[shuffled])
        assert retracer.requests == len(times_s)
    finally:
        retracer.close()
    found = found.reshape(len(found), len(FRAMES), pixels)
    different = 0
    for k, (_, frame) in enumerate(frames(world, options)):
        for plane, name in enumerate(retracer.names):
            if name not in left_out:
                np.testing.assert_array_equal(found[plane, k], frame.plane(name).ravel(), name)
        different += int((found[:, k] != found[:, 0]).any(axis=0).sum())
    assert different > 0.2 * pixels, "the frames differ"
    return found


def test_requests_have_no_variances():
    """They have no planes for them: the kernel would write beyond its memory."""
    data = SceneData(busy_world(), instants=True)
    options = RenderOptions(variances=True)
    assert options.features(data.features, data.world.camera).variances
    assert not options.features(data.features, data.world.camera, requests=True).variances


def test_a_request_gives_the_bits_of_the_frame_where_everything_moves():
    compare(busy_world(), RenderOptions(spp=4, sampler="sobol", threads=2, tile_pixels=50))


def test_first_hits_of_a_request_are_those_of_the_frame():
    """Radiance is what shines, and direct light: requests find no other irradiance."""
    options = RenderOptions(spp=1, sampler="sobol", first_hit_rays=16, threads=2, tile_pixels=50)
    found = compare(busy_world(), options, left_out=("R", "G", "B", "Samples"))
    np.testing.assert_allclose(
        np.array([0.2126, 0.7152, 0.0722]) @ found[:3].reshape(3, -1), found[-1].ravel(), rtol=1e-3
    )
    assert (found[-1] > 0).mean() > 0.5


@pytest.mark.parametrize("moving", [(True, False), (False, True)], ids=["camera", "surfaces"])
@pytest.mark.parametrize("rays", [0, 16])
def test_a_request_gives_the_bits_of_the_frame_where_one_object_moves(moving, rays):
    left_out = ("R", "G", "B", "Samples") if rays else ()
    compare(busy_world(*moving), RenderOptions(spp=2, first_hit_rays=rays), left_out)


@pytest.mark.parametrize("camera_moves", [True, False])
def test_first_hits_of_a_request_see_specks_as_those_of_the_frame_do(camera_moves):
    world = busy_world(camera_moves)
    crumbs = [hw.box((x, y, 0.0), (x + 0.02, y + 0.02, 0.02)) for x in (-1.0, -0.3, 0.6) for y in (1.0, 1.5)]
    meshes = world.meshes + tuple(crumbs)
    instances = [Instance(len(world.meshes) + k, Glide((0.1 * k, 0.0, 0.0))) for k in range(len(crumbs))]
    world = replace(world, meshes=meshes, instances=(*world.instances, *instances))
    compare(world, RenderOptions(spp=1, first_hit_rays=16), left_out=("R", "G", "B", "Samples"))


def test_first_hits_of_a_request_are_those_of_the_frame_behind_a_wide_lens():
    """No corner tells there what a pixel shows, and none is sampled."""
    world = busy_world()
    lens = replace(world.camera.lens, aperture_radius_m=0.05, focus_distance_m=2.0)
    blurred = replace(world, camera=replace(world.camera, lens=lens))
    compare(blurred, RenderOptions(spp=1, sampler="sobol", first_hit_rays=16), left_out=("R", "G", "B", "Samples"))


def test_first_hits_of_a_request_see_a_texture_as_those_of_the_frame_do():
    """Many texels a pixel: what is read of them are coarser levels, here and there."""
    world = busy_world(objects_move=False)
    texels = np.random.default_rng(5).integers(0, 256, (128, 128, 4), dtype=np.uint8)
    materials = (replace(world.materials[0], texture=0), *world.materials[1:])
    tiles = ImageTexture(texels, uv_matrix=((16.0, 0.0, 0.0), (0.0, 16.0, 0.0)))
    world = replace(world, textures=(tiles,), materials=materials)
    compare(world, RenderOptions(spp=1, first_hit_rays=16), left_out=("R", "G", "B", "Samples"))


def test_what_cannot_be_traced_at_instants_is_told():
    world = busy_world(size=(2, 2))
    blurred = replace(world, camera=replace(world.camera, shutter_s=0.01))
    with pytest.raises(InputError, match="`noise` common only, got independent"):
        Retracer(SceneData(world, instants=True), RenderOptions(noise="independent"))
    with pytest.raises(InputError, match=r"exposes for 0\.01 s; expected 0"):
        Retracer(SceneData(blurred, instants=True), RenderOptions())


@dataclass(frozen=True)
class Carried:
    """A shape that goes to the right, with nothing to tell it but its vertices."""

    rest: object
    duration_s: float = 10.0

    def vertices_at(self, time_s):
        return np.add(self.rest.vertices, (1.5 * time_s, 0.0, 0.0), dtype=np.float32), None


@pytest.mark.parametrize("deforms", [False, True])
def test_ways_on_the_image_are_those_of_the_pinhole(deforms):
    """A wall that goes to the right before a camera that goes back; at the pixels' middles, by plain projection."""
    wall = hw.quad((-9, -9, -2), (18, 0, 0), (0, 18, 0))
    motion = Glide((0.0, 0.0, 0.0), (1.5, 0.0, 0.0))
    if deforms:
        wall, motion = replace(wall, normals=None, deformation=Carried(wall)), hw.IDENTITY
    view = replace(hw.camera(width=16, height=12, fov_deg=90.0), motion=Glide((0.0, 0.0, 0.0), (0.0, 0.0, 3.0)))
    world = hw.world(wall, view=view, motions=[motion], fps=FPS)
    retracer = Retracer(SceneData(world, instants=True), RenderOptions(spp=1, max_depth=1))
    ways = retracer.motion(0.0, 0.1)
    retracer.close()
    x, y = np.meshgrid(np.arange(16) + 0.5 - 8, np.arange(12) + 0.5 - 6)
    # 8 pixels are 45°: what is seen at 2 m has gone .15 m to the right, and is at 2.3 m then.
    start = np.stack([(x * 2 / 8 + 0.15) * 8 / 2.3 - x, y * 2 / 2.3 - y])
    end = np.stack([x - (x * 2.3 / 8 - 0.15) * 8 / 2, y - y * 2.3 / 2])
    np.testing.assert_allclose(ways[0], start, atol=2e-4)
    np.testing.assert_allclose(ways[1], end, atol=2e-4)
    longest = np.hypot(*ways[2])
    assert (
        np.all(longest >= np.hypot(*start) - 0.01) and longest.max() <= np.hypot(*ways[:2].swapaxes(0, 1)).max() + 0.2
    )
    assert Retracer(SceneData(busy_world(False, False), instants=True), RenderOptions()).motion(0.0, 0.1) is None


def test_where_the_camera_alone_moves_a_pixel_of_each_block_is_followed():
    """A wall before a camera that goes back: the first pixel of a block of four, or the last, as on a chessboard."""
    wall = hw.quad((-9, -9, -2), (18, 0, 0), (0, 18, 0))
    view = replace(hw.camera(width=13, height=11, fov_deg=90.0), motion=Glide((0.0, 0.0, 0.0), (0.0, 0.0, 3.0)))
    retracer = Retracer(SceneData(hw.world(wall, view=view, fps=FPS), instants=True), RenderOptions(spp=1, max_depth=1))
    ways = retracer.motion(0.0, 0.1)
    retracer.close()
    x, y = np.meshgrid(np.arange(13), np.arange(11))
    last = (x // 2 + y // 2) % 2
    x, y = 2 * (x // 2) + last + 0.5 - 6.5, 2 * (y // 2) + last + 0.5 - 5.5
    np.testing.assert_allclose(ways[0], np.stack([x, y]) * (2 / 2.3 - 1), atol=2e-4)
    np.testing.assert_allclose(ways[1], np.stack([x, y]) * (1 - 2.3 / 2), atol=2e-4)


def test_what_goes_there_and_back_within_a_step_neither_rests_nor_goes_straight():
    """A camera that is at its end where it was at its start, or nearer to that than in between."""
    wall, turn = hw.quad((-9, -9, -2), (18, 0, 0), (0, 18, 0)), (0.0, 0.0, 0.0, 1.0)

    def retracer_of(*far):
        places = tuple((0.0, 0.0, z) for z in far)
        view = replace(
            hw.camera(width=13, height=11, fov_deg=90.0), motion=Keyframes((0.0, 0.1, 0.2), places, (turn,) * 3)
        )
        data = SceneData(hw.world(wall, view=view, fps=FPS), instants=True)
        return Retracer(data, RenderOptions(spp=1, max_depth=1))

    back = retracer_of(0.0, 0.3, 0.0)
    assert back.motion(0.0, 0.2) is not None and back.motion(0.3, 0.4) is None
    assert back._turns((0, 200_000)) and not back._turns((0, 100_000))
    for middle, turns in ((0.1, False), (0.2, False), (0.25, True), (0.3, True), (-0.3, True)):
        assert retracer_of(0.0, middle, 0.2)._turns((0, 200_000)) == turns


def test_what_is_seen_from_a_pose_is_remembered_and_is_what_would_be_traced(monkeypatch):
    """A camera that goes on, jumps back and is moved: ways have the bits of a tracer that knows no other step."""
    world = busy_world(objects_move=False)
    camera = Driven(world.camera.motion)
    world = with_driven(world, {CAMERA: camera})
    told, run = [], Tiles.run

    def noted(tiles, end, changed, begin=0):
        told.append(changed["seen"])
        return run(tiles, end, changed, begin)

    monkeypatch.setattr(Tiles, "run", noted)
    retracer = Retracer(SceneData(world, instants=True), RenderOptions(spp=1))

    def follow(start_s, end_s, known):
        told.clear()
        ways = retracer.motion(start_s, end_s)
        assert sum(told) == known
        fresh = Retracer(SceneData(world, instants=True), RenderOptions(spp=1))
        np.testing.assert_array_equal(ways, fresh.motion(start_s, end_s))
        fresh.close()

    follow(0.0, 0.1, known=0)
    follow(0.0, 0.05, known=1)
    follow(0.1, 0.2, known=1)
    follow(0.0, 0.1, known=2)
    for time_s, x in ((0.0, 0.3), (0.2, -0.2)):
        camera.set(time_s, place_of(hw.look_from((x, 1.0, 2.4), (0, 0.2, 0))))
    follow(0.0, 0.1, known=0)
    retracer.close()


def test_which_of_many_lights_is_drawn_is_of_the_instant_alone():
    """Lamps of a tree that move, at several instants: their bounds are those of each."""
    world = busy_world(size=(7, 5))
    places = np.random.default_rng(0).uniform((-2, 0.3, -2), (2, 2, 2), (12, 3))
    lamps = [SphereLight(0.05, (9.0, 8.0, 7.0), Swing(hw.translation(*place), (-1.5, 0.2, 0.1))) for place in places]
    world = replace(world, sphere_lights=tuple(lamps))
    compare(world, RenderOptions(spp=4))


def test_what_deforms_is_traced_in_the_shape_of_its_time():
    """Several instants at a time, each with shapes and trees of its own: exactly what a frame shows."""
    scene = replace(swelling(moving=True), fps=FPS)
    compare(scene, RenderOptions(spp=2, max_depth=3))


def test_first_hits_of_a_request_see_soft_shadows_as_those_of_the_frame_do():
    """Whether a pixel lies in one, corners next to its own tell."""
    slats = [hw.box((x, 1, -2), (x + 0.1, 1.02, 2)) for x in np.arange(-2, 2, 0.2)]
    start = hw.look_from((0, 0.9, 0.01), (0, 0, 0), up=(0, 0, -1))
    camera = replace(hw.camera(start, 13, 11), motion=Swing(start, velocity=(0.3, 0.0, 0.1)))
    sun = SphereLight(0.5, (40.0, 40.0, 40.0), Static(hw.translation(0.3, 3.5, 0.2)))
    world = hw.world(hw.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), *slats, sphere_lights=(sun,), view=camera, fps=FPS)
    compare(world, RenderOptions(spp=1, sampler="sobol", first_hit_rays=8), left_out=("R", "G", "B", "Samples"))


@pytest.mark.parametrize("light_hz", [None, 30.0])
def test_a_request_sees_the_cached_light_that_the_frame_was_rendered_in(light_hz):
    """At the frame's time it has the frame's bits, whatever the frame's own paths have found."""
    world = load_world("two-boxes", resolution=(32, 24))
    options = RenderOptions(
        spp=4, probe_spp=1, probe_every=2, first_hit_rays=16, sampler="sobol", light_cache=True, threads=2,
        light_hz=light_hz,
    )  # fmt: skip
    tracer = PathTracer(world, options)
    retracer = Retracer(SceneData(world, instants=True), options, lambda: tracer)
    frame = Frame(page_aligned((len(tracer.names), 24, 32)), tracer.names)
    pixels = np.random.default_rng(3).permutation(24 * 32).astype(np.int32)
    differ = tracer.names.index("Samples")
    try:
        for index in (0, 1, 2, 8, 9):
            tracer.fill(index, frame)
            found = retracer.trace(pixels, np.full(len(pixels), frame_time_us(index, tracer.fps) * 1e-6))
            expected = frame.planes.reshape(len(tracer.names), -1)[:, pixels]
            np.testing.assert_array_equal(np.delete(found, differ, 0), np.delete(expected, differ, 0))
    finally:
        retracer.close()
        tracer.close()


def test_what_has_turned_into_view_has_the_light_between_frames_that_the_frame_shows():
    """Not that which the frame's own paths have found there, of which nothing was known."""
    floor, block = hw.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), hw.box((-0.5, 0.1, -0.5), (0.5, 1.1, 0.5))
    view = hw.camera(hw.look_from((0.2, 1.1, 2.5), (0, 0.5, 0)), 26, 22)
    world = hw.world(
        floor, block, view=view, motions=[hw.IDENTITY, Swing(np.eye(4), (0, 0, 0), 2.3)], fps=FPS,
        environment=(1.0, 1.0, 1.0),
    )  # fmt: skip
    options = RenderOptions(
        spp=4, probe_spp=1, probe_every=2, first_hit_rays=16, sampler="sobol", light_cache=True, threads=2,
        light_hz=FPS / 3, stored_paths=16,
    )  # fmt: skip
    tracer = PathTracer(world, options)
    retracer = Retracer(SceneData(world, instants=True), options, lambda: tracer)
    frame = Frame(page_aligned((len(tracer.names), 22, 26)), tracer.names)
    off = []
    try:
        for index in range(10):
            tracer.fill(index, frame)
            found = retracer.trace(
                np.arange(22 * 26, dtype=np.int32), np.full(22 * 26, frame_time_us(index, FPS) / 1e6)
            )
            shown = np.maximum(frame.planes[1].ravel(), 1e-4)
            off.append(np.abs(np.log(np.maximum(found[1], 1e-4) / shown)) > 0.1)
    finally:
        retracer.close()
        tracer.close()
    assert np.mean(off) < 0.03


def test_once_it_is_cancelled_nothing_half_done_is_returned():
    retracer = Retracer(SceneData(busy_world(), instants=True), RenderOptions(spp=1))
    assert retracer.motion(0.0, 0.1) is not None
    retracer.cancel()
    with pytest.raises(RenderCancelled):
        retracer.motion(0.1, 0.2)
    with pytest.raises(RenderCancelled):
        retracer.trace(np.zeros(1, np.int32), np.zeros(1))
    retracer.close()
