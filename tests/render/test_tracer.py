"""The tracer as a frame source: repeatable, quick to stop, safe with odd worlds, clear about wrong input."""

from __future__ import annotations

import subprocess
import sys
import threading
from dataclasses import dataclass, replace

import numpy as np
import pytest
import warp as wp

from clsim.errors import InputError
from clsim.frames import ALL_PLANES, BASE_PLANES, Frame, page_aligned
from clsim.render import (
    PathTracer,
    RenderCancelled,
    RenderOptions,
    check_device,
    describe_build,
    list_render_devices,
    scene_data,
)
from clsim.scene import (
    CheckerTexture,
    EnvironmentMap,
    ImageTexture,
    Instance,
    Lens,
    Material,
    Mesh,
    PunctualLight,
    SphereLight,
    Static,
)
from tests.render import hand_worlds as hw

pytestmark = pytest.mark.usefixtures("any_lights")

LAMP = Material(color=(0.0, 0.0, 0.0), emission=(5.0, 5.0, 5.0), emits_behind=False)


@dataclass(frozen=True)
class Slide:
    """A straight motion that turns about +y on its way."""

    velocity: tuple[float, float, float] = (1.0, 0.2, -0.3)
    duration_s: float = 1.0

    def pose(self, time_s):
        angle = 0.7 * time_s
        matrix = hw.translation(*(time_s * v for v in self.velocity))
        matrix[0, 0] = matrix[2, 2] = np.cos(angle)
        matrix[0, 2], matrix[2, 0] = np.sin(angle), -np.sin(angle)
        return matrix


def lit_world(**rest):
    return hw.world(
        hw.quad((-2, -0.5, 2), (4, 0, 0), (0, 0, -4)),
        hw.ball(0.5, rings=8),
        hw.quad((-0.5, 1.5, -0.5), (1, 0, 0), (0, 0, 1), material=1),
        materials=(hw.GREY, LAMP),
        view=hw.camera(hw.look_from((0.5, 1, 3), (0, 0, 0)), 12, 10),
        **rest,
    )


def moving_world(time_s=None):
    """A block and a lamp that move, or, at a given time, stand where they would be."""
    motions = [Static(np.eye(4)), Slide(), Slide((-0.5, 0.0, 0.4))]
    if time_s is not None:
        motions = [Static(motion.pose(time_s)) for motion in motions]
    scene = lit_world()
    instances = tuple(Instance(i, motion) for i, motion in enumerate(motions))
    return replace(scene, instances=instances, fps=10.0)


def test_threads_and_tiles_do_not_change_a_bit():
    one = hw.render(lit_world(), spp=4, threads=1).planes
    for options in ({"threads": 2, "tile_pixels": 7}, {"threads": 5, "tile_pixels": 1}, {"tile_pixels": 120}):
        np.testing.assert_array_equal(hw.render(lit_world(), spp=4, **options).planes, one)


def test_variances_are_an_addition():
    full, base = (hw.render(lit_world(), spp=4, variances=v) for v in (True, False))
    assert full.names == ALL_PLANES and base.names == BASE_PLANES
    np.testing.assert_array_equal(base.planes, full.planes[: len(BASE_PLANES)])


def test_a_seed_is_a_picture():
    pictures = [hw.render(lit_world(), spp=2, seed=seed).plane("R") for seed in (0, 0, 1, 2**63 + 1)]
    np.testing.assert_array_equal(pictures[0], pictures[1])
    assert (pictures[0] != pictures[2]).mean() > 0.5 and (pictures[2] != pictures[3]).mean() > 0.5


def test_common_noise_keeps_a_still_scene_still_and_independent_does_not():
    common = [hw.render(lit_world(), index=i, spp=2).planes for i in (0, 1, 50)]
    np.testing.assert_array_equal(common[0], common[1])
    np.testing.assert_array_equal(common[0], common[2])
    own = [hw.render(lit_world(), index=i, spp=2, noise="independent").plane("R") for i in (0, 1, 1)]
    assert (own[0] != own[1]).mean() > 0.5
    np.testing.assert_array_equal(own[1], own[2])


def test_samples_are_a_prefix():
    """Of two samples a and b the mean is a ± its standard error, |a − b| / 2: so the first alone gives a."""
    first, both = (hw.render(lit_world(), spp=spp) for spp in (1, 2))
    for name in ("R", "G", "B", "Depth"):
        valid = both.plane("Coverage") == 1
        off = np.abs(first.plane(name) - both.plane(name))[valid]
        half = np.sqrt(both.plane(f"Variance.{name}"))[valid]
        assert (half > 0).mean() > 0.3
        np.testing.assert_allclose(off, half, rtol=1e-3, atol=1e-5)


@pytest.mark.slow  # kernels of their own are compiled
@pytest.mark.parametrize("scene", [lit_world, moving_world])
def test_both_trees_give_one_picture(scene):
    ours, warps = (hw.render(scene(), 3, spp=16, tree=tree) for tree in ("bvh16", "warp"))
    for name in ALL_PLANES[:12]:
        a, b = ours.plane(name), warps.plane(name)
        assert np.isclose(a, b, rtol=1e-3, atol=1e-4).mean() > 0.95, name
        assert abs(a.mean() - b.mean()) < 0.01 * (np.abs(b).mean() + 1e-3), name


@pytest.mark.parametrize("index", [0, 7])
def test_what_moves_is_where_its_motion_says(index):
    moved, placed = hw.render(moving_world(), index, spp=16), hw.render(moving_world(index / 10), spp=16)
    assert moved.time_us == index * 100_000 and moved.index == index
    for name in ALL_PLANES[:12]:
        a, b = moved.plane(name), placed.plane(name)
        # Roundings differ, so that a path may fall on the other side of an edge now and then.
        close = np.isclose(a, b, rtol=1e-3, atol=1e-4)
        assert close.mean() > 0.95, name
        assert abs(a.mean() - b.mean()) < 0.01 * (np.abs(b).mean() + 1e-3), name


@dataclass(frozen=True)
class Leave:
    """From the middle to a place of its own."""

    place: tuple[float, float, float]
    duration_s: float = 1.0

    def pose(self, time_s):
        return hw.translation(*(time_s * p for p in self.place))


def test_a_tree_of_instances_is_rebuilt_as_they_disperse(monkeypatch):
    """What was next to each other is so no more; the picture is that of a world placed there."""
    rng = np.random.default_rng(1)
    motions = [Leave(tuple(2 * rng.random(3) - 1)) for _ in range(30)]
    ball = hw.ball(0.1, rings=4)

    def scene(time_s=None):
        placed = motions if time_s is None else [Static(motion.pose(time_s)) for motion in motions]
        still = hw.world(ball, view=hw.camera(hw.look_from((0, 0, 4), (0, 0, 0)), 32, 32), fps=2.0)
        return replace(still, instances=tuple(Instance(0, motion) for motion in placed))

    rebuilt = []
    rebuild = wp.Bvh.rebuild
    monkeypatch.setattr(wp.Bvh, "rebuild", lambda tree: (rebuilt.append(tree), rebuild(tree))[1])
    moved, placed = (hw.render(s, index, spp=4, max_depth=1) for s, index in ((scene(), 2), (scene(1.0), 0)))
    assert len(rebuilt) == 1
    assert np.isclose(moved.plane("Depth"), placed.plane("Depth"), rtol=1e-4).mean() > 0.99
    assert 0.1 < placed.plane("Coverage").mean() < 0.5


def test_motion_is_seen():
    start, later = (hw.render(moving_world(), index, spp=4).plane("Depth") for index in (0, 7))
    assert (np.abs(start - later) > 0.05).mean() > 0.05


def test_a_moving_sphere_light_lights_as_one_placed_there():
    lamp = SphereLight(0.2, (5.0, 5.0, 5.0), Slide((0.8, 1.0, 0.0)))
    moving = replace(lit_world(), materials=(hw.GREY, hw.GREY), sphere_lights=(lamp,), fps=10.0)
    placed = replace(moving, sphere_lights=(replace(lamp, motion=Static(lamp.motion.pose(0.5))),))
    np.testing.assert_array_equal(hw.render(moving, 5, spp=4).planes, hw.render(placed, spp=4).planes)
    assert np.any(hw.render(moving, 0, spp=4).planes[:3] != hw.render(placed, spp=4).planes[:3])


def test_frames_are_written_in_place():
    tracer = PathTracer(lit_world(), RenderOptions(spp=1, threads=2))
    frames = [Frame(page_aligned((12, 10, 12)), tracer.names) for _ in range(40)]
    for index, frame in enumerate(frames):
        frame.planes[...] = -7
        tracer.fill(index, frame)
        assert frame.index == index and np.all(frame.plane("Samples") == 1)
    np.testing.assert_array_equal(frames[0].planes, frames[-1].planes)
    with pytest.raises(ValueError, match="12x10"):
        tracer.fill(0, Frame(page_aligned((12, 12, 10)), tracer.names))
    tracer.close()
    tracer.close()


def odd_worlds():
    flat = Mesh(np.zeros((3, 3), np.float32), np.array([[0, 1, 2], [0, 0, 0]], np.int32), np.array([1, 1], np.int32))
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], np.float32)
    sliver = Mesh(line, np.array([[0, 1, 2]], np.int32), np.array([1], np.int32), normals=np.zeros_like(line))
    hidden = SphereLight(0.1, (9.0, 9.0, 9.0), Static(np.eye(4)))
    around = SphereLight(30.0, (9.0, 9.0, 9.0), Static(np.eye(4)))
    point = SphereLight(1e-30, (9.0, 9.0, 9.0), Static(hw.translation(0, 1, 0)))
    scene = lit_world()
    return {
        "nothing": hw.world(materials=()),
        "zero-area lights": hw.world(flat, sliver, materials=(hw.GREY, LAMP)),
        "zero-area lights among others": replace(
            scene,
            meshes=(*scene.meshes, flat, sliver),
            instances=(*scene.instances, Instance(3, hw.IDENTITY), Instance(4, Slide())),
        ),
        "a light inside the ball": replace(scene, sphere_lights=(hidden,)),
        "a light half in the floor": replace(
            scene, sphere_lights=(SphereLight(0.5, (9.0, 9.0, 9.0), Static(hw.translation(0.8, -0.6, 0.5))),)
        ),
        "all inside a light": replace(scene, sphere_lights=(around,)),
        "a light of no size": replace(scene, sphere_lights=(point,)),
        "huge radiance": replace(scene, materials=(hw.GREY, replace(LAMP, emission=(1e30, 1e30, 1e30)))),
        "far away": replace(
            scene, camera=hw.camera(hw.look_from((1e6, 1e6, 1e6), (0, 0, 0))), environment=(1.0, 1.0, 1.0)
        ),
        "camera in the floor": replace(scene, camera=hw.camera(hw.look_from((0, -0.5, 1), (0, -0.5, 0)))),
    }


@pytest.mark.parametrize("name", odd_worlds())
def test_odd_worlds_give_finite_pictures(name):
    frame = hw.render(odd_worlds()[name], spp=8)
    assert np.isfinite(frame.planes[:12]).all()
    if name != "huge radiance":
        assert np.all(frame.plane("Samples") == 8)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_sample_that_is_not_finite_is_dropped_and_missed_in_the_count(monkeypatch):
    """Of radiance that no scene may have: light that is allowed does not add up to so much."""
    monkeypatch.setattr(scene_data, "validate", lambda *_: None)
    glaring = replace(lit_world(), materials=(hw.GREY, replace(LAMP, emission=(3e38, 3e38, 3e38))))
    glaring = replace(glaring, materials=(replace(glaring.materials[0], emission=(3e38,) * 3), glaring.materials[1]))
    samples = hw.render(glaring, spp=8).plane("Samples")
    assert samples.min() < 8 and samples.max() == 8


@pytest.mark.parametrize("radius", [0.1, 30.0])
def test_a_light_inside_a_body_or_around_everything_lights_nothing(radius):
    """Light leaves a sphere light outwards only."""
    lamp = SphereLight(radius, (9.0, 9.0, 9.0), Static(np.eye(4)))
    scene = replace(lit_world(), materials=(hw.GREY, hw.GREY), sphere_lights=(lamp,))
    assert np.all(hw.render(scene, spp=16).planes[:3] == 0)


def test_cancel_ends_a_frame_and_all_later_ones():
    # Hours of work: only a cancel can end it.
    scene = hw.with_camera(lit_world(), hw.camera(hw.look_from((0.5, 1, 3), (0, 0, 0)), 256, 256))
    tracer = PathTracer(scene, RenderOptions(spp=4096, threads=2))
    frame = Frame(page_aligned((12, 256, 256)), tracer.names)
    raised = []

    def work():
        try:
            tracer.fill(0, frame)
        except RenderCancelled as error:
            raised.append(error)

    worker = threading.Thread(target=work)
    worker.start()
    tracer.cancel()
    worker.join(timeout=30)
    assert not worker.is_alive() and len(raised) == 1
    with pytest.raises(RenderCancelled):
        tracer.fill(1, frame)
    tracer.close()


@pytest.mark.parametrize(
    ("option", "value", "text"),
    [
        ("spp", 0, "`spp` must be at least 1, got 0"),
        ("spp", 1 << 21, "`spp` must be at most 1048576, got 2097152"),
        ("first_hit_rays", 100_000, "`first_hit_rays` must be at most 4096, got 100000"),
        ("max_depth", 0, "`max_depth` must be at least 1"),
        ("max_depth", 1000, "`max_depth` must be at most 127, got 1000"),
        ("threads", 0, "`threads`"),
        ("frames", 0, "`frames`"),
        ("fps", float("nan"), "`fps` must be a positive number"),
        ("seed", -1, "`seed` must be from 0"),
        ("noise", "blue", "`noise` must be one of common, independent, got 'blue'"),
    ],
)
def test_wrong_options_are_named(option, value, text):
    with pytest.raises(InputError) as error:
        RenderOptions(**{option: value})
    assert text in str(error.value)


def test_wrong_devices_and_worlds_are_named():
    assert list_render_devices()[0] == "cpu"
    with pytest.raises(InputError, match=r"tpu:7.*expected one of cpu"):
        check_device("tpu:7")
    with pytest.raises(InputError, match="tpu:7"):
        PathTracer(lit_world(), RenderOptions(device="tpu:7"))
    broken = lit_world()
    broken.meshes[1].triangles[0, 0] = 10_000
    with pytest.raises(InputError, match="10000"):
        PathTracer(broken, RenderOptions())


def test_the_number_of_frames():
    def count(**options):
        tracer = PathTracer(replace(lit_world(), fps=24.0, duration_s=2.0), RenderOptions(**options))
        tracer.close()
        return tracer.frame_count

    assert (count(), count(fps=100), count(frames=3)) == (49, 201, 3)


def test_the_build_is_described():
    plain = describe_build(hw.world(hw.ball(1.0)), RenderOptions())
    assert plain["built in"] == ["diffuse materials"]
    assert (plain["device"], plain["tree"]) == ("cpu", "bvh16")
    chosen = describe_build(hw.world(hw.ball(1.0)), RenderOptions(tree="warp"))
    assert chosen["tree"] == "warp"
    assert describe_build(hw.world(hw.ball(1.0)), RenderOptions(device="cuda:0"))["tree"] == "warp"
    scene = moving_world()
    rich = replace(
        scene,
        textures=(CheckerTexture((1, 1, 1), (0, 0, 0)), ImageTexture(np.zeros((1, 1, 4), np.uint8))),
        materials=(
            Material(kind="principled", texture=0, roughness_texture=1, normal_texture=1, metallic=1.0),
            replace(LAMP, texture=1, kind="plastic", emission_texture=1, roughness_texture=1, alpha_mode="mask"),
        ),
        environment=(1.0, 1.0, 1.0),
        sphere_lights=(SphereLight(1.0, (1, 1, 1), hw.IDENTITY),),
        punctual_lights=(PunctualLight("point", (1, 1, 1), hw.IDENTITY),),
        meshes=(hw.ball(1.0, smooth=True), *scene.meshes[1:]),
        camera=replace(scene.camera, lens=Lens(aperture_radius_m=0.1), shutter_s=0.01),
    )
    facts = describe_build(rich, RenderOptions(variances=True))
    assert {"moving and deforming objects (two-level tree)", "motion blur", "depth of field (thin lens)"} <= set(
        facts["built in"]
    )
    others = ("diffuse", "conductor", "dielectric", "thin-dielectric", "disney")
    backs = [
        "what glossy metal and frosted glass show, by primary rays",
        "surfaces that are black behind",
        "surfaces that the camera does not see from behind",
    ]
    lenses = [
        "tree over sphere lights",
        "environment map",
        "motion blur of deforming objects",
        "fisheye projection",
        "orthographic projection",
    ]
    lenses += ["lens distortion"]
    sampling = ["Sobol's sequence", "first-hit rays and steered samples", "cached light"]
    sampling += [
        "stored paths that follow the light",
        "light of coats, cached separately",
        "light straight from lamps in closed form",
    ]
    kinds = [f"{kind} materials" for kind in others]
    maps = ["bump maps"]
    lobes = ["Beckmann's microfacets", "roughness that differs along u and v", "glass that dims light within"]
    assert facts["left out"] == [
        *("colours of vertices", *kinds, *maps, *lobes, "blends of materials"),
        *(*backs, *lenses, *sampling),
    ]
    assert sampling[1] in describe_build(scene, RenderOptions(first_hit_rays=4))["built in"]
    mapped = replace(rich, environment_map=EnvironmentMap(np.ones((1, 1, 3), np.float32), np.eye(3)))
    assert "constant environment" in describe_build(mapped, RenderOptions())["left out"]


@pytest.mark.parametrize("channel", range(3))
def test_light_of_one_colour_is_light(channel):
    color = tuple(float(k == channel) for k in range(3))
    pixels = ImageTexture(np.full((1, 1, 4), 255, np.uint8))
    lamp = Material(emission=color, emission_texture=0, emits_behind=False)
    glass = Material(kind="dielectric", absorption=color)
    balls = hw.ball(1.0), hw.ball(2.0, material=1)
    scene = hw.world(*balls, materials=(lamp, glass), textures=(pixels,), environment=color)
    needed = {"textures of emission", "triangle area lights", "constant environment"}
    needed |= {"lamps that shine from one side", "glass that dims light within"}
    assert needed <= set(describe_build(scene, RenderOptions())["built in"])


def test_a_blend_with_the_first_material_keeps_its_picture():
    pixels = ImageTexture(np.full((1, 1, 4), 255, np.uint8))
    second = Material(blend_with=0, blend_texture=0)
    scene = hw.world(hw.ball(1.0, material=1), materials=(Material(), second), textures=(pixels,))
    assert {"blends of materials", "image textures"} <= set(describe_build(scene, RenderOptions())["built in"])


def test_starting_is_silent():
    code = "import clsim.render as r; r.list_render_devices()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
