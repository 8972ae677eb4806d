"""How narrow things are and how far nothing is, in closed form, and pixels that need no ray for what is narrower."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.render import SceneData
from clsim.render.accel.placement import place
from clsim.render.accel.smallest import smallest_of
from clsim.render.camera.camera import CameraData
from clsim.render.camera.pixel_width import pixel_of, widest_pixel
from clsim.render.features.features import view_features
from clsim.render.features.scene_features import scene_features
from clsim.scene import Camera, ImageTexture, Lens, Material, Mesh, SphereLight, Static
from clsim.scene.motion import Keyframes
from tests.render import hand_worlds as hw
from tests.render.motion.test_blur import Glide
from tests.render.primary.test_steered import Run, textured_world

SCALED = np.diag([2.0, 2.0, 2.0, 1.0])
MOVING = Keyframes((0.0, 1.0), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), ((0.0, 0.0, 0.0, 1.0),) * 2)


def width_of(world):
    return min(extent.width_m for extent in smallest_of(place(world), world.sphere_lights).extents)


def clear_of(world, places, narrow=(2e-3, 0.0), time_s=0.0):
    """Return how far nothing is narrow, as seen from some places."""
    smallest = smallest_of(place(world), world.sphere_lights)
    return smallest.clear_m(np.array(places), np.full(len(places), time_s), narrow, lambda motion, at: motion.pose(at))


def triangles(*corners):
    """Triangles that have no vertex in common but by its place."""
    count = len(corners) // 3
    return Mesh(
        np.array(corners, np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3), np.zeros(count, int)
    )


@pytest.mark.parametrize(
    ("mesh", "motion", "expected"),
    [
        (hw.quad((0, 0, 0), (3, 0, 0), (0, 4, 0)), Static(np.eye(4)), 2.4),
        (hw.quad((0, 0, 0), (3, 0, 0), (0, 4, 0)), Static(SCALED), 4.8),
        (hw.box((0, 0, 0), (3, 4, 4)), MOVING, 2.4),
        (hw.quad((0, 0, 0), (3, 0, 0), (0, 4, 0)), MOVING, 0.0),
        (triangles((0, 0, 0), (3, 0, 0), (1.5, 3.0, 0)), Static(np.eye(4)), 3 * 3 / np.hypot(3.0, 1.5)),
        (triangles((0, 0, 0), (3, 0, 0), (1.5, 3.3, 0)), Static(np.eye(4)), 0.0),
        (hw.quad((0, 0, 0), (3, 0, 0), (0, 0, 0)), Static(np.eye(4)), np.inf),
        (hw.box((0, 0, 0), (1.0, 1.0, 1e-3)), Static(np.eye(4)), 1e-3),
    ],
    ids=["quad", "scaled", "moving", "moving sheet", "blunt", "tip", "without area", "thin box"],
)
def test_it_is_the_lowest_height_of_a_triangle(mesh, motion, expected):
    assert width_of(hw.world(mesh, motions=[motion])) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_what_shrinks_one_way_while_it_moves_is_as_narrow_as_it_becomes(axis):
    class Shrinks:
        duration_s = 1.0

        def pose(self, time_s):
            scale = np.ones(4)
            scale[axis] = 1.0 - 0.9 * time_s
            return np.diag(scale)

    told = width_of(hw.world(hw.box((0, 0, 0), (1, 1, 1)), motions=[Shrinks()]))
    assert 0.05 < told <= 0.1 / np.hypot(1.0, 0.1)


def test_it_is_no_more_than_a_lamps_diameter():
    lamp = SphereLight(0.25, (1.0, 1.0, 1.0), Static(np.eye(4)))
    assert width_of(hw.world(hw.box((0, 0, 0), (1, 1, 1)), sphere_lights=(lamp,))) == 0.5


@pytest.mark.slow  # kernels of their own are compiled
@pytest.mark.usefixtures("ordinary")
def test_no_ray_searches_for_what_cannot_be_there():
    """A crumb behind the camera brings rays into all pixels; that costs rays, and shows nothing else."""
    scene = textured_world()
    floor, _, lamp = scene.meshes
    still, camera = scene.instances[0], replace(scene.camera, width=36, height=30)

    def seen(*meshes):
        instances = tuple(replace(still, mesh=number) for number in range(len(meshes)))
        run = Run(replace(scene, meshes=meshes, instances=instances, camera=camera), spp=1)
        return run.fill(0), run.spent[1]

    crumb = hw.quad((0, 50.0, 0), (1e-3, 0, 0), (0, 1e-3, 0))
    (plain, few), (sought, many) = seen(floor, lamp), seen(floor, lamp, crumb)
    whole = plain.plane("Samples") < sought.plane("Samples")
    assert whole.mean() > 0.2
    assert whole[plain.plane("Coverage") == 0].mean() > 0.9
    assert many - few == (sought.plane("Samples") - plain.plane("Samples")).sum()
    for name in ("G", "Albedo.G", "Depth", "Ny"):
        np.testing.assert_allclose(plain.plane(name)[whole], sought.plane(name)[whole], rtol=1e-3)


@pytest.mark.parametrize(
    ("mesh", "sheets"),
    [
        (hw.quad((0, 0, 0), (3, 0, 0), (0, 4, 0)), 2),
        (hw.box((0, 0, 0), (3, 4, 4)), 0),
        (hw.ball(2.0), 0),
        (hw.join([hw.box((0, 0, 0), (3, 4, 4)), hw.quad((9, 0, 0), (3, 0, 0), (0, 3, 0))]), 2),
    ],
    ids=["quad", "box", "ball", "both"],
)
def test_a_sheet_is_what_is_not_closed(mesh, sheets):
    world = hw.world(mesh)
    assert len(smallest_of(place(world), ()).sheets) == sheets


def test_what_is_folded_flat_is_as_good_as_a_sheet():
    """A closed wedge without ends, of four triangles in two planes: its sharp edge alone tells."""

    def wedge(half):
        a, b, c, d = (0, 0, 0), (3, 0, 0), (1.5, 3, half), (1.5, 3, -half)
        return triangles(a, b, c, b, a, d, a, c, d, c, b, d)

    flat, thick = (smallest_of(place(hw.world(wedge(half))), ()) for half in (0.5, 1.5))
    assert len(flat.sheets) and not len(thick.sheets)


def test_seen_on_its_edge_a_sheet_has_no_width():
    """As seen from 10 m at height h a sheet of 4 m is about 0.4 h/14 rad wide, for triangles a little less."""
    sheet = hw.world(hw.quad((-20, 0, -14), (40, 0, 0), (0, 0, 4)))
    above, low = clear_of(sheet, [[0.0, height, 0.0] for height in (0.3, 0.02)])
    assert above == width_of(sheet) / 2e-3 and above > 1500.0
    assert low <= 10.0


@pytest.mark.parametrize("motion", [Static(hw.translation(0, -30, 0)), Glide((0.0, -30.0, 0.0), (0.5, -1.0, 0.0))])
def test_what_is_far_is_narrow_for_nobody_who_looks_less_far(motion):
    """A room of boxes 2 m wide, which 2 mrad see wide up to a kilometre, and a box of 1 cm 30 m below."""
    room, speck = hw.box((-2, 0, -2), (2, 2, 2)), hw.box((-0.005,) * 3, (0.005,) * 3)
    alone = clear_of(hw.world(room, motions=[MOVING]), [(0, 1, 0)])
    for time_s in (0.0, 2.0):
        both = clear_of(hw.world(room, speck, motions=[MOVING, motion]), [(0, 1, 0)], time_s=time_s)
        way_m = np.linalg.norm(motion.pose(time_s)[:3, 3] - (0, 1, 0))
        assert way_m - 0.01 < both < way_m < alone


@pytest.mark.parametrize(
    "sheet", [hw.quad((-1, 0, -51), (2, 0, 0), (0, 0, 2)), hw.quad((-1, 0, 51), (2, 0, 0), (0, 0, -2))]
)
def test_a_sheet_on_its_edge_is_narrow_for_nobody_who_looks_less_far(sheet):
    assert 46.0 < clear_of(hw.world(hw.join([hw.box((-3, -3, -3), (3, 3, 3)), sheet])), [(0, 0, 0)])[0] <= 50.0


def test_before_how_far_it_is_clear_nothing_is_narrow():
    """Boxes and lamps of random sizes at random places, which move; narrow ones are no nearer than is told."""
    random = np.random.default_rng(5)
    sizes, starts = 10 ** random.uniform(-2.5, 0.5, 12), random.normal(size=(12, 3)) * 20
    ways = [
        Glide(tuple(start), tuple(velocity))
        for start, velocity in zip(starts, random.normal(size=(12, 3)), strict=True)
    ]
    boxes = [hw.box((-size / 2,) * 3, (size / 2,) * 3) for size in sizes[:9]]
    lamps = tuple(SphereLight(size / 2, (1.0, 1.0, 1.0), way) for size, way in zip(sizes[9:], ways[9:], strict=True))
    world = replace(hw.world(*boxes, motions=ways[:9]), sphere_lights=lamps)
    widths = np.append(sizes[:9] / np.sqrt(2), sizes[9:])
    for time_s, place_m in zip((0.0, 0.5, 1.5), random.normal(size=(3, 3)) * 9, strict=True):
        clear = clear_of(world, [place_m], (0.02, 0.0), time_s)[0]
        middles_m = np.array([np.linalg.norm(way.pose(time_s)[:3, 3] - place_m) for way in ways])
        near_m = middles_m - sizes / 2 * np.append(np.full(9, np.sqrt(3)), np.ones(3))
        assert clear == pytest.approx(np.maximum(near_m, widths / 0.02).min(), rel=1e-4)


def test_parallel_rays_tell_narrow_things_however_far_they_are():
    """Of a box of 1 m, whose triangles are .7 m high."""
    box = hw.world(hw.box((99.0, 0.0, 0.0), (100.0, 1.0, 1.0)))
    assert clear_of(box, [(0, 0, 0)], (0.0, 0.70))[0] == np.inf and clear_of(box, [(0, 0, 0)], (0.0, 0.71))[0] == 0.0


def seen_coverage(mesh, crumb=()):
    """Return how much of each pixel of a column dark sheets cover before the sky."""
    scene = hw.world(
        mesh, *crumb, view=hw.camera(hw.translation(0, 0, 5), 36, 30, 40.0), environment=(1.0, 1.0, 1.0),
        materials=(Material(color=(0.02, 0.02, 0.02)), Material(kind="conductor", color=(1.0, 1.0, 1.0))),
    )  # fmt: skip
    frame = Run(scene, spp=1, first_hit_rays=16).fill(0)
    return 1.0 - frame.plane("Emission")[:, 12]


@pytest.mark.parametrize(
    ("lens", "fov_deg"),
    [
        (Lens(), 40.0),
        (Lens(), 160.0),
        (Lens(distortion=(-0.3, 0.05)), 80.0),
        (Lens(model="fisheye"), 200.0),
        (Lens(model="fisheye", distortion=(-0.05,)), 150.0),
        (Lens(distortion=(-0.2, 0.05), principal_point=(-0.2, 0.1)), 60.0),
        (Lens(model="fisheye", distortion=(-0.05,), principal_point=(0.15, -0.1)), 120.0),
        (Lens(distortion=(-0.28, 0.0), principal_point=(0.0, 0.4)), 40.0),
    ],
    ids=["narrow", "wide", "barrel", "fisheye", "distorted fisheye", "barrel aside", "fisheye aside", "barrel below"],
)
def test_the_widest_pixel_is_that_of_the_rays(lens, fov_deg):
    """Rays by OpenCV's models, and how far they turn for a hundredth of a pixel to the right and down."""
    camera = Camera(64, 48, fov_deg, hw.IDENTITY, lens=lens)
    k = [*lens.distortion, 0.0, 0.0]
    fisheye, fov = lens.model == "fisheye", np.radians(fov_deg)
    focal = 64 / fov if fisheye else 32 / np.tan(fov / 2)
    table = np.linspace(0, fov if fisheye else np.tan(np.radians(88)), 100_001)
    radial = (1 + table**2 * (k[0] + table**2 * k[1])) * table
    rising = slice(0, np.argmax(np.diff(radial) <= 0) or None)

    def rays(x, y):
        size = np.hypot(x, y) / focal
        found = np.interp(size, radial[rising], table[rising], right=np.nan)
        angle = found if fisheye else np.arctan(found)
        return np.stack([x / focal / size * np.sin(angle), y / focal / size * np.sin(angle), np.cos(angle)], axis=-1)

    x, y = np.meshgrid(np.arange(-31.995, 32, 0.5), np.arange(-23.995, 24, 0.5))
    x, y = x - 64 * lens.principal_point[0], y - 64 * lens.principal_point[1]
    turns = np.stack([rays(x + 0.01, y) - rays(x, y), rays(x, y + 0.01) - rays(x, y)], axis=-1) / 0.01
    widest = np.linalg.svd(turns[np.isfinite(turns).all(axis=(-2, -1))], compute_uv=False).max()
    assert widest_pixel(camera) == pytest.approx(widest, rel=0.03)


def test_a_pixel_of_parallel_rays_is_as_wide_as_its_share_of_the_view():
    camera = Camera(64, 48, 60.0, Static(np.eye(4)), lens=Lens(model="orthographic", view_width_m=2.0))
    assert pixel_of(camera) == (0.0, 2.0 / 64)


def test_wide_pixels_show_less_of_what_is_small():
    """A box of 1 m, from 135° on by a pinhole."""
    world, widths = hw.world(hw.box((0, 0, 0), (1, 1, 1))), []
    told = SceneData(world)
    for fov_deg in (90.0, 130.0, 160.0):
        camera = Camera(64, 48, fov_deg, hw.IDENTITY)
        features = view_features(scene_features(world, 0.0), camera)
        data = CameraData(camera, features, np.zeros(3), "cpu", told.clear_m)
        # As far as this a box of so many metres is two average pixels wide.
        widths.append(float(data.at(0.0).clear_m.numpy()[0]) * 2 * np.radians(fov_deg) / 64)
    assert widths[0] == pytest.approx(width_of(world)) and widths[1] == pytest.approx(width_of(world))
    wider = np.tan(np.radians(80)) / np.radians(80) / 2
    assert widths[2] == pytest.approx(width_of(world) / wider, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plane", "materials"),
    [
        ("Emission", [Material(color=(0.0, 0.0, 0.0), emission=(1.0, 1.0, 1.0), emission_texture=0)]),
        ("Albedo.G", [Material(blend_with=1, blend_share=1.0), Material(color=(1.0, 1.0, 1.0), texture=0)]),
    ],
    ids=["emission", "blend"],
)
def test_textures_finer_than_a_pixel_are_seen_in_whole_pixels(plane, materials):
    """Lines of a third of a pixel on a large sheet, on which the corners of all pixels lie."""
    side = 3 * 12
    checks = np.full((side, side, 4), 255, np.uint8)
    checks[::3, :, :3] = checks[:, ::3, :3] = 0
    size = 2 * np.tan(np.radians(20)) * 5
    low = -size / 2 - size / side / 2
    sheet = hw.quad((low, low, 0), (size, 0, 0), (0, size, 0))
    world = hw.world(sheet, materials=materials, view=hw.camera(hw.translation(0, 0, 5), 12, 12, 40.0))
    world = replace(world, textures=(ImageTexture(checks, nearest=True),))
    frame = Run(world, spp=1, first_hit_rays=64).fill(0)
    assert frame.plane(plane)[2:-2, 2:-2].mean() == pytest.approx(4 / 9, abs=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("place_px", [0.1, 0.5, 0.9])
def test_a_sheet_on_its_edge_between_corners_is_seen(place_px):
    pixel_m = 2 * np.tan(np.radians(20)) / 36 * 5
    low, high = (place_px - 0.3) * pixel_m, (place_px + 0.3) * pixel_m * 7 / 5
    mesh = hw.quad((-1, low, 0), (2, 0, 0), (0, high - low, -2))
    assert seen_coverage(mesh).sum() == pytest.approx(0.6, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("place_px", [0.1, 0.5, 0.9])
def test_what_a_mirror_shows_is_as_far_as_it_is(place_px):
    """A beam behind the camera, in the sky of a mirror before it: wider than two pixels there, but not where it is."""
    pixel_m = 2 * np.tan(np.radians(20)) / 36 * 35
    middle = place_px * pixel_m
    beam = hw.box((-9, middle - 0.2 * pixel_m, 33), (9, middle + 0.2 * pixel_m, 33.3))
    mirror = hw.quad((-20, -20, 4), (40, 0, 0), (0, 40, 0), material=1)
    assert seen_coverage(hw.join([mirror, beam])).sum() == pytest.approx(0.4, abs=0.15)


def test_no_sphere_is_seen_narrower_than_is_told():
    """Next to what moves, where a lamp might hide between the corners of a pixel; they move too."""
    random = np.random.default_rng(6)
    lamps = [
        SphereLight(float(radius_m), (1.0, 1.0, 1.0), Glide(tuple(start), tuple(velocity)))
        for radius_m, start, velocity in zip(
            random.uniform(0.05, 0.5, 5), random.uniform(-9, 9, (5, 3)), random.normal(size=(5, 3)), strict=True
        )
    ]
    world = replace(hw.world(hw.box((-1, -1, -1), (1, 1, 1)), motions=[Glide()]), sphere_lights=tuple(lamps))
    data = SceneData(world)
    for time_s, eye in zip((0.0, 0.4, 2.0), random.uniform(-20, 20, (3, 3)), strict=True):
        ways_m = [np.linalg.norm(eye - lamp.motion.pose(time_s)[:3, 3]) for lamp in lamps]
        seen = min(2 * np.arcsin(lamp.radius_m / way_m) for lamp, way_m in zip(lamps, ways_m, strict=True))
        assert 0.98 * seen < data.least_sphere_rad(eye, time_s) <= seen


@pytest.mark.parametrize("far_m", [0.0, 4e4])
def test_what_is_smaller_than_a_pixel_is_seen_wherever_it_flies(far_m):
    """A black tile before the sky, half as wide as a pixel, which lies between its corners most of the time."""
    pixel_m = 2 * 5.0 * np.tan(np.radians(20.0)) / 36
    half = 0.25 * pixel_m
    speck = hw.box((-half, -half, -1e-3), (half, half, 1e-3))
    flies = Glide((far_m + 0.03, 0.04, 0.0), (3.1 * pixel_m, 1.7 * pixel_m, 0.0))
    view = hw.camera(hw.translation(far_m, 0, 5), 36, 30, 40.0)
    scene = hw.world(
        speck, view=view, motions=[flies], environment=(1.0, 1.0, 1.0), materials=(Material(color=(0.0, 0.0, 0.0)),)
    )
    run = Run(replace(scene, fps=7.0), spp=1, first_hit_rays=64)
    covered = np.array([(1.0 - run.fill(index).plane("Emission")).sum() for index in range(20)])
    np.testing.assert_allclose(covered, 0.25, atol=0.09)
    assert covered.mean() == pytest.approx(0.25, abs=0.03)


def test_ways_to_what_is_small_are_those_to_it_and_of_many_the_widest_are_told():
    random = np.random.default_rng(3)
    middles, sizes = random.uniform((-30, -30, 60), (30, 30, 120), (200, 3)), random.uniform(0.01, 0.1, 200)
    boxes = [hw.box((-s, -s, -s), (s, s, s)) for s in sizes]
    motions = [Glide(tuple(middle)) for middle in middles]
    lamp = SphereLight(0.05, (1.0, 1.0, 1.0), Static(hw.translation(0, 0, -70)))
    data = SceneData(replace(hw.world(*boxes, motions=motions), sphere_lights=(lamp,)))
    data.move(2.0)
    eye = np.array([0.5, -1.0, 2.0])
    ways = np.vstack([middles + np.array((2, 0, 0)), (0, 0, -70)]) - eye
    lengths = np.linalg.norm(ways, axis=1)
    seen = np.append(np.sqrt(3.0) * sizes, 0.05) / lengths
    (told,) = data.specks(eye[None], 0.1).numpy()
    widest = np.argsort(-seen)[: len(told) - 1]
    assert len(told) == 129
    np.testing.assert_allclose(told[0, :3], eye - data.origin_m, atol=1e-5)
    np.testing.assert_allclose(told[1:, :3], ways[widest], atol=1e-4)
    np.testing.assert_allclose(told[1:, 3], seen[widest] + 0.1, rtol=1e-5)
    assert data.specks(eye[None], seen.min() / 3).shape == (0, 0)


@pytest.mark.parametrize("moves", ["lamp", "box", "both", "neither"])
def test_ways_to_what_is_small_are_told_for_as_many_times_as_are_asked_however_many_there_were(moves):
    lamp = Glide((0.0, 3.0, 0.0)) if moves in ("lamp", "both") else Static(hw.translation(0, 3, 0))
    box = Glide() if moves in ("box", "both") else Static(np.eye(4))
    world = hw.world(hw.box((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1)), motions=[box])
    data = SceneData(replace(world, sphere_lights=(SphereLight(0.05, (1.0, 1.0, 1.0), lamp),)), instants=True)
    for count in (1, 5, 3):
        times_s = np.linspace(0.0, 2.0, count)
        data.move_to(times_s)
        told = data.specks(np.tile((0.0, 0.0, 50.0), (count, 1)), 0.1).numpy()
        for time_s, (_, of_box, of_lamp) in zip(times_s, told, strict=True):
            for found, motion in ((of_box, box), (of_lamp, lamp)):
                np.testing.assert_allclose(found[:3], motion.pose(time_s)[:3, 3] - (0, 0, 50), atol=1e-5)
