"""Rays of the camera against OpenCV's formulae, written out in float64, and against OpenCV itself."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.render import RenderOptions
from clsim.render.camera.camera import CameraData, CameraState, invertible, make_camera, make_projection
from clsim.render.device.devices import start_warp
from clsim.render.motion.shutter import quaternions
from clsim.scene import Camera, Lens, Material, Static
from clsim.scene.validate import validate
from tests.render import hand_worlds as hw

pytestmark = pytest.mark.usefixtures("any_lights")

POSE = hw.look_from((1.0, 2.0, 3.0), (0.2, 0.1, -1.0), up=(0.1, 1.0, 0.2))
BROWN = (-0.28, 0.09, 0.0012, -0.0008, -0.013)
KANNALA = (-0.031, 0.012, -0.009, 0.0017)


def camera(lens=None, width=64, height=48, fov_deg=70.0, pose=POSE):
    return Camera(width, height, fov_deg, Static(pose), lens=lens or Lens())


def trace_rays(view, xy, lens=None, time=None, time_s=0.0, scene=None):
    """Origins, unit directions (in the camera's frame: x right, y down, z forward) and whether rays exist."""
    start_warp()
    scene = hw.with_camera(scene or hw.world(hw.ball(1.0)), view)
    features = RenderOptions().features_of(scene)
    camera_ray = make_camera(features)

    @wp.kernel(module="unique", enable_backward=False)
    def rays(
        view: CameraState,
        xy: wp.array(dtype=wp.vec2),
        lens: wp.array(dtype=wp.vec2),
        time: wp.array(dtype=float),
        out_origins: wp.array(dtype=wp.vec3),
        out_directions: wp.array(dtype=wp.vec3),
        out_exists: wp.array(dtype=int),
    ):
        i = wp.tid()
        ray = camera_ray(view, xy[i][0], xy[i][1], lens[i], time[i])
        out_origins[i] = ray.origin
        out_directions[i] = ray.direction
        out_exists[i] = int(ray.exists)

    n = len(xy)
    lens = np.zeros((n, 2)) if lens is None else lens
    time = np.zeros(n) if time is None else time
    inputs = [
        wp.array(values, dtype=kind, device="cpu")
        for values, kind in ((xy, wp.vec2), (lens, wp.vec2), (time, wp.float32))
    ]
    outputs = [wp.zeros(n, dtype=kind, device="cpu") for kind in (wp.vec3, wp.vec3, wp.int32)]
    model = CameraData(view, features, np.zeros(3), "cpu").at(time_s)
    wp.launch(rays, n, inputs=[model, *inputs], outputs=outputs, device="cpu")
    origins, directions, exists = (a.numpy().astype(np.float64) for a in outputs)
    axes = view.motion.pose(time_s)[:3, :3] * (1, -1, -1)
    return origins, directions @ axes, exists.astype(bool)


def positions(view, seed=0, count=2000):
    """Image positions all over the picture, corners among them, as jitter makes them."""
    size = view.width, view.height
    xy = np.random.default_rng(seed).random((count, 2)) * size
    return np.concatenate([xy, [(0, 0), size, (0, size[1]), (size[0], 0)]]).astype(np.float32)


def intrinsics(view):
    """Focal length and principal point in OpenCV's pixels, whose centres are at whole numbers."""
    fov = np.radians(view.fov_deg)
    f = view.width / fov if view.lens.model == "fisheye" else view.width / 2 / np.tan(fov / 2)
    px, py = view.lens.principal_point
    across = -f if view.lens.mirrored else f
    centre = view.width * (0.5 + px) - 0.5, view.height / 2 + view.width * py - 0.5
    return (across, f / view.lens.aspect), *centre


def project(view, directions):
    """OpenCV's projection: calib3d's pinhole model, or the fisheye model, as documented there."""
    f, cx, cy = intrinsics(view)
    k = (*view.lens.distortion, 0, 0, 0, 0, 0)[:5]
    x, y, z = directions.T
    if view.lens.model == "fisheye":
        r = np.hypot(x, y)
        theta = np.arctan2(r, z)
        distorted = theta * (1 + k[0] * theta**2 + k[1] * theta**4 + k[2] * theta**6 + k[3] * theta**8)
        x2, y2 = distorted * x / r, distorted * y / r
    else:
        x, y = x / z, y / z
        k1, k2, p1, p2, k3 = k
        r2 = x * x + y * y
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        x2 = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        y2 = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([f[0] * x2 + cx, f[1] * y2 + cy], axis=1)


VIEWS = {
    "pinhole": camera(),
    "principal point": camera(Lens(principal_point=(0.06, -0.04))),
    "brown-conrady": camera(Lens(distortion=BROWN, principal_point=(-0.03, 0.02))),
    "pincushion": camera(Lens(distortion=(0.3, 0.1)), fov_deg=60.0),
    "tangential": camera(Lens(distortion=(0.0, 0.0, 0.02, -0.03)), fov_deg=50.0),
    "fisheye": camera(Lens(model="fisheye", distortion=KANNALA, principal_point=(0.02, 0.01)), fov_deg=170.0),
    "mirrored": camera(Lens(principal_point=(0.06, -0.04), mirrored=True)),
    "mirrored brown-conrady": camera(Lens(distortion=BROWN, mirrored=True)),
    "wide pixels": camera(Lens(principal_point=(0.06, -0.04), aspect=0.5)),
    "high pixels of a fisheye": camera(Lens(model="fisheye", aspect=1.5), fov_deg=100.0),
    "equidistant": camera(Lens(model="fisheye"), fov_deg=120.0),
}


@pytest.mark.parametrize("name", VIEWS)
def test_rays_project_back_to_where_they_came_from(name):
    view = VIEWS[name]
    xy = positions(view)
    origins, directions, exists = trace_rays(view, xy)
    assert exists.all()
    np.testing.assert_allclose(project(view, directions) + 0.5, xy, atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(origins, np.tile(POSE[:3, 3], (len(xy), 1)), rtol=1e-6)


@pytest.mark.oracle
@pytest.mark.parametrize("name", VIEWS)
def test_opencv_projects_our_rays_back(name):
    cv2 = pytest.importorskip("cv2", reason="opencv-python-headless is not installed")
    view = VIEWS[name]
    xy = positions(view)
    _, directions, _ = trace_rays(view, xy)
    f, cx, cy = intrinsics(view)
    matrix = np.array([[f[0], 0, cx], [0, f[1], cy], [0, 0, 1]])
    if view.lens.model == "fisheye":
        k = np.array((*view.lens.distortion, 0, 0, 0, 0)[:4], np.float64)
        ahead = directions[:, 2] > 0.02
        pixels, _ = cv2.fisheye.projectPoints(directions[ahead, None], np.zeros(3), np.zeros(3), matrix, k)
        assert ahead.mean() > 0.8
        xy = xy[ahead]
    else:
        k = np.array((*view.lens.distortion, 0, 0, 0, 0, 0)[:5], np.float64)
        pixels, _ = cv2.projectPoints(directions, np.zeros(3), np.zeros(3), matrix, k)
    np.testing.assert_allclose(pixels[:, 0] + 0.5, xy, atol=1e-3)


def test_a_lens_without_distortion_is_a_pinhole():
    """The general code with k = 0 against the plain one: the same picture but for rounding."""
    scene = hw.world(hw.ball(0.5, rings=8), view=hw.camera(hw.look_from((0.5, 1, 3), (0, 0, 0))), environment=(1, 1, 1))
    barely = replace(scene.camera, lens=Lens(distortion=(1e-12,)))
    plain, general = hw.render(scene, spp=4), hw.render(hw.with_camera(scene, barely), spp=4)
    same = np.isclose(plain.planes[:11], general.planes[:11], rtol=1e-3, atol=1e-4)
    assert same.mean() > 0.97


def test_where_distortion_folds_there_are_no_rays():
    """r·(1 − 0.5·r²) grows up to r = √(2/3), where it is .544: what lies beyond is black, and hits nothing."""
    lens = Lens(distortion=(-0.5,))
    np.testing.assert_allclose(invertible(lens.distortion, False), 2 / 3)
    view = camera(lens, 64, 64, fov_deg=90.0)
    xy = positions(view)
    radius = np.linalg.norm((xy - 32) / 32, axis=1)
    _, directions, exists = trace_rays(view, xy)
    edge = 2 / 3 * np.sqrt(2 / 3)
    assert exists[radius < 0.995 * edge].all() and not exists[radius > 1.001 * edge].any()
    np.testing.assert_allclose(
        (project(view, directions) + 0.5)[radius < 0.99 * edge], xy[radius < 0.99 * edge], atol=5e-3
    )
    room = hw.world(hw.box((-9, -9, -9), (9, 9, 9)), view=view, environment=(1, 1, 1))
    frame = hw.render(room, spp=8)
    x, y = np.meshgrid(np.arange(64) + 0.5 - 32, np.arange(64) + 0.5 - 32)
    beyond = np.hypot(x, y) / 32 > edge + 0.04
    assert np.all(frame.planes[:11, beyond] == 0) and np.all(frame.plane("Samples") == 8)
    assert np.all(frame.plane("Coverage")[np.hypot(x, y) / 32 < edge - 0.04] == 1)


def projected(view, directions):
    """What kernels have for where these directions (x right, y down, z forward) are seen, and whether they are."""
    start_warp()
    features = RenderOptions().features_of(hw.with_camera(hw.world(hw.ball(1.0)), view))
    project_way = make_projection(features)

    @wp.kernel(module="unique", enable_backward=False)
    def projections(view: CameraState, ways: wp.array(dtype=wp.vec3), out_places: wp.array(dtype=wp.vec3)):
        out_places[wp.tid()] = project_way(view, ways[wp.tid()], 0)

    ways = directions * (1, -1, -1) @ view.motion.pose(0.0)[:3, :3].T
    found = wp.zeros(len(ways), dtype=wp.vec3, device="cpu")
    model = CameraData(view, features, np.zeros(3), "cpu").at(0.0)
    wp.launch(projections, len(ways), [model, wp.array(ways, dtype=wp.vec3, device="cpu"), found], device="cpu")
    return found.numpy()[:, :2], found.numpy()[:, 2] > 0


@pytest.mark.parametrize(
    ("lens", "widest_deg"),
    [
        (Lens(distortion=BROWN), None),
        (Lens(distortion=(-0.5,)), np.degrees(np.arctan(np.sqrt(2 / 3)))),
        (Lens(model="fisheye", distortion=(-0.2,)), np.degrees(np.sqrt(1 / 0.6))),
        (Lens(model="fisheye"), 180.0),
    ],
    ids=["brown-conrady", "folds", "fisheye that folds", "fisheye"],
)
def test_what_is_seen_is_where_opencv_has_it_and_nothing_is_seen_beyond_the_lens(lens, widest_deg):
    """θ·(1 − 0.2·θ²) grows up to θ = √(1 / 0.6) alone, and what is farther aside must not be told at another place."""
    view = camera(lens, fov_deg=90.0)
    directions = np.random.default_rng(0).normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    aside_deg = np.degrees(np.arccos(directions[:, 2]))
    places, seen = projected(view, directions)
    widest_deg = np.degrees(np.arctan(np.sqrt(invertible(BROWN, False)))) if widest_deg is None else widest_deg
    np.testing.assert_array_equal(seen, aside_deg <= widest_deg)
    assert seen.sum() > 100 and (widest_deg == 180.0 or (~seen).sum() > 100)
    np.testing.assert_allclose(places[seen], project(view, directions[seen]) + 0.5, rtol=1e-5, atol=2e-4)


def test_a_fisheye_sees_behind_itself_and_no_farther_than_straight_back():
    view = camera(Lens(model="fisheye"), 64, 64, fov_deg=270.0)
    xy = positions(view)
    angle = np.linalg.norm(xy - 32, axis=1) / 64 * np.radians(270)
    _, directions, exists = trace_rays(view, xy)
    np.testing.assert_array_equal(exists, angle <= np.pi)
    np.testing.assert_allclose(directions[exists, 2], np.cos(angle[exists]), atol=1e-6)


@pytest.mark.parametrize("lens", [Lens(0.1, 2.5), Lens(0.1, 2.5, distortion=BROWN), Lens(0.1, 2.5, "fisheye")])
def test_rays_from_all_over_the_aperture_meet_in_focus(lens):
    """They meet where the pinhole's ray meets the plane at the focus distance (the sphere for a fisheye)."""
    view = camera(lens)
    rng = np.random.default_rng(1)
    pixels = rng.random((20, 2)) * (64, 48)
    xy, pairs = np.repeat(pixels, 200, axis=0), rng.random((4000, 2))
    origins, directions, _ = trace_rays(view, xy, lens=pairs)
    _, straight, _ = trace_rays(replace(view, lens=replace(lens, aperture_radius_m=0.0)), pixels)
    axes = POSE[:3, :3] * (1, -1, -1)
    start = (origins - POSE[:3, 3]) @ axes
    assert np.abs(start[:, 2]).max() < 1e-5
    radius2 = (start[:, :2] ** 2).sum(axis=1) / 0.1**2
    assert radius2.max() <= 1 + 1e-5 and abs(radius2.mean() - 0.5) < 4 * np.sqrt(1 / 12 / 4000)
    distance = 2.5 / (1.0 if lens.model == "fisheye" else straight[:, 2:])
    focus = np.repeat(straight * distance, 200, axis=0)
    along = ((focus - start) * directions).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(start + along * directions, focus, atol=3e-5)


def test_what_is_out_of_focus_is_blurred_to_the_circle_of_confusion():
    """A small lamp at distance d, focus at f: its image at d is a disc of radius a·|1 − d/f| (similar triangles)."""
    aperture, focus, d = 0.2, 2.0, 4.0
    lamp = hw.quad((-0.01, -0.01, -d), (0.02, 0, 0), (0, 0.02, 0))
    view = Camera(48, 48, 20.0, hw.IDENTITY, lens=Lens(aperture, focus))
    frame = hw.render(hw.world(lamp, materials=(Material(emission=(1e4, 1e4, 1e4)),), view=view), spp=1024, max_depth=1)
    x, y = np.meshgrid(np.arange(48) + 0.5 - 24, np.arange(48) + 0.5 - 24)
    pixel = 2 * np.tan(np.radians(10)) / 48 * d
    bright = frame.plane("R").astype(np.float64)
    expected_radius = aperture * abs(1 - d / focus) / pixel
    # The mean squared radius of a uniform disc is half of its radius squared.
    radius = np.sqrt(2 * (bright * (x**2 + y**2)).sum() / bright.sum())
    assert abs(radius - expected_radius) < 0.05 * expected_radius
    in_focus = hw.render(
        hw.world(lamp, materials=(Material(emission=(1e4, 1e4, 1e4)),), view=replace(view, lens=Lens(aperture, d))),
        spp=256,
    )
    assert np.count_nonzero(in_focus.plane("R")) <= 4


def test_quaternions_turn_as_their_matrices():
    rng = np.random.default_rng(0)
    matrices = np.linalg.qr(rng.normal(size=(500, 3, 3)))[0]
    matrices *= np.linalg.det(matrices)[:, None, None]
    turns = np.array([np.diag(d) for d in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))], float)
    matrices = np.concatenate([matrices, turns])
    q = quaternions(matrices)
    v, w = q[:, None, :3], q[:, None, 3:]
    vectors = rng.normal(size=(1, 7, 3))
    turned = vectors + 2 * np.cross(v, np.cross(v, vectors) + w * vectors)
    np.testing.assert_allclose(
        turned, np.einsum("nij,nkj->nki", matrices, np.broadcast_to(vectors, (len(q), 7, 3))), atol=1e-12
    )
    assert np.all((q[1:] * q[:-1]).sum(axis=1) >= 0)


@pytest.mark.parametrize(
    ("view", "text"),
    [
        (camera(fov_deg=180.0), "fov_deg is 180.0"),
        (camera(Lens(model="fisheye"), fov_deg=360.0), "fov_deg is 360.0, expected more than 0 and less than 360"),
        (camera(Lens(distortion=(0.1,) * 6)), "expected at most 5 finite numbers"),
        (camera(Lens(model="fisheye", distortion=(0.1, np.nan))), "expected at most 4 finite numbers"),
        (camera(Lens(aperture_radius_m=-1.0)), "aperture radius -1.0 m"),
        (camera(Lens(0.1, focus_distance_m=0.0)), "focus distance 0.0 m"),
    ],
)
def test_wrong_lenses_are_named(view, text):
    with pytest.raises(InputError, match=re.escape(text)):
        validate(hw.world(hw.ball(1.0), view=view), "test")


@given(st.tuples(*[st.integers(-50, 50).map(lambda hundredths: hundredths / 100)] * 5))
def test_a_lens_is_inverted_as_far_as_its_radius_grows(distortion):
    """r·(1 + k1·r² + k2·r⁴ + k3·r⁶) grows up to there, and no farther; p1 and p2 move what is seen aside."""
    k1, k2, p1, p2, k3 = distortion
    limit = invertible(distortion, False)
    assert limit == invertible((k1, k2, -p2, p1, k3), False)

    def growth(r2):
        return 1 + 3 * k1 * r2 + 5 * k2 * r2**2 + 7 * k3 * r2**3

    assert (growth(np.linspace(0.0, 0.999 * min(limit, 1e6), 1000)) > -1e-9).all()
    if 1e-3 < limit < 1e6:
        assert abs(growth(limit)) < 1e-6 * (1 + abs(k1) * limit + abs(k2) * limit**2 + abs(k3) * limit**3) * 10


@pytest.mark.parametrize("name", ["pinhole", "fisheye"])
def test_a_camera_that_is_placed_with_a_scale_sees_as_without(name):
    view = VIEWS[name]
    large = replace(view, motion=Static(POSE @ np.diag((2.5, 2.5, 2.5, 1.0))))
    xy = positions(view, count=50)
    origins, directions, exists = trace_rays(view, xy)
    found, scaled, also = trace_rays(large, xy)
    np.testing.assert_array_equal(also, exists)
    np.testing.assert_allclose(found, origins, rtol=1e-6)
    np.testing.assert_allclose(scaled / 2.5, directions, atol=1e-6)
