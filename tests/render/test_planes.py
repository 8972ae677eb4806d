"""The planes of a frame against analytic rays, and their variances against many renders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.frames import ALL_PLANES, BASE_PLANES, VARIANCE_PLANES
from clsim.scene import Camera, CheckerTexture, Material, SphereLight, Static
from tests.render import hand_worlds as hw

pytestmark = pytest.mark.usefixtures("anything")


def analytic_rays(view: Camera, per_pixel=32):
    """Origin and unit directions ``[H, W, S, 3]`` through a regular grid in each pixel, in float64."""
    offsets = (np.arange(per_pixel) + 0.5) / per_pixel
    sx, sy = (a.ravel() for a in np.meshgrid(offsets, offsets))
    x = (np.arange(view.width)[None, :, None] + sx) * 2 / view.width - 1
    y = (1 - (np.arange(view.height)[:, None, None] + sy) * 2 / view.height) * view.height / view.width
    half = np.tan(np.radians(view.fov_deg) / 2)
    x, y = np.broadcast_arrays(x * half, y * half)
    local = np.stack([x, y, -np.ones_like(x)], axis=-1)
    pose = view.motion.pose(0.0)
    world = local @ pose[:3, :3].T
    return pose[:3, 3], world / np.linalg.norm(world, axis=-1, keepdims=True)


def assert_plane_agrees(frame, name, expected):
    """Within the plane's own standard error, and a rounding of the analytic grid."""
    spread = np.ptp(expected) + np.abs(expected).max()
    # One sample more or less is forgiven: samples that all missed a sliver know of no variance.
    one = spread / np.maximum(frame.plane("Samples"), 1)
    error = np.sqrt(np.nan_to_num(frame.plane(f"Variance.{name}"), nan=0.0) + one**2)
    off = np.abs(frame.plane(name) - expected)
    assert np.all(off <= 5 * error + 2e-3 * spread), (name, off.max())
    assert np.abs(off).mean() <= 0.01 * spread


def test_a_tilted_floor_with_a_checker():
    view = hw.camera(hw.look_from((0.3, 1.2, 3.0), (0.2, 0.2, 0.0)), 20, 12, fov_deg=60)
    checker = CheckerTexture((0.9, 0.8, 0.7), (0.1, 0.2, 0.3), scale=4)
    floor = hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4))
    scene = hw.world(floor, materials=(Material(color=(1.0, 0.5, 1.0), texture=0),), textures=(checker,), view=view)
    frame = hw.render(scene, spp=256, max_depth=1)

    origin, d = analytic_rays(view)
    with np.errstate(divide="ignore"):
        t = -origin[1] / d[..., 1]
    p = origin + d * t[..., None]
    hit = (t > 0) & (np.abs(p[..., 0]) < 2) & (np.abs(p[..., 2]) < 2)
    hits = np.maximum(hit.sum(axis=-1), 1)
    assert 0.2 < hit.mean() < 0.8
    assert_plane_agrees(frame, "Coverage", hit.mean(axis=-1))
    solid = hit.all(axis=-1) | ~hit.any(axis=-1)

    def mean(values):
        return np.where(solid, np.where(hit, values, 0).sum(axis=-1) / hits, 0)

    frame.planes[:, ~solid] = 0
    assert_plane_agrees(frame, "Depth", mean(t))
    for name, value in zip(("Nx", "Ny", "Nz"), (0, 1, 0), strict=True):
        assert_plane_agrees(frame, name, mean(np.full(t.shape, float(value))))
    squares = np.floor(p[..., 0] + 2) + np.floor(2 - p[..., 2])
    for c, name in enumerate(("Albedo.R", "Albedo.G", "Albedo.B")):
        a, b = (color[c] * (1.0, 0.5, 1.0)[c] for color in (checker.color_a, checker.color_b))
        assert_plane_agrees(frame, name, mean(np.where(squares % 2 == 0, a, b)))


@pytest.mark.parametrize("kind", ["sphere light", "smooth ball"])
def test_a_sphere(kind):
    centre, radius = np.array([0.2, -0.1, -3.0]), 0.8
    if kind == "sphere light":
        lamp = SphereLight(radius, (2.0, 2.0, 2.0), Static(hw.translation(*centre)))
        scene = hw.world(sphere_lights=(lamp,), materials=())
    else:
        ball = hw.ball(radius, rings=96, smooth=True)
        scene = hw.world(ball, motions=[Static(hw.translation(*centre))])
    frame = hw.render(scene, spp=256, max_depth=1)
    origin, d = analytic_rays(scene.camera)
    along = d @ (centre - origin)
    with np.errstate(invalid="ignore"):
        half_chord = np.sqrt(radius**2 - (np.sum((centre - origin) ** 2) - along**2))
    hit = np.isfinite(half_chord)
    t = np.where(hit, along - half_chord, 0)
    normal = (origin + d * t[..., None] - centre) / radius
    if kind == "sphere light":
        assert_plane_agrees(frame, "Coverage", hit.mean(axis=-1))
        np.testing.assert_allclose(frame.plane("R"), 2 * frame.plane("Coverage"), rtol=1e-6)
    solid = hit.all(axis=-1)
    assert solid.sum() > 30
    frame.planes[:, ~solid] = 0
    assert_plane_agrees(frame, "Depth", np.where(solid, t.mean(axis=-1), 0))
    for c, name in enumerate(("Nx", "Ny", "Nz")):
        assert_plane_agrees(frame, name, np.where(solid, normal[..., c].mean(axis=-1), 0))
    expected = (0, 0, 0) if kind == "sphere light" else hw.GREY.color
    for c, name in enumerate(("Albedo.R", "Albedo.G", "Albedo.B")):
        np.testing.assert_allclose(frame.plane(name)[solid], expected[c], rtol=1e-6)


def test_normals_face_the_camera_from_behind_too():
    back = hw.quad((1, -1, -2), (-2, 0, 0), (0, 2, 0))
    frame = hw.render(hw.world(back), spp=2)
    np.testing.assert_allclose(frame.plane("Nz")[8, 8], 1.0)


def _noisy_world():
    lamp = SphereLight(0.3, (3.0, 6.0, 9.0), Static(hw.translation(-0.6, 1.2, 0.2)))
    return hw.world(
        hw.ball(0.7, rings=6),
        hw.quad((-1.5, -0.7, 1.5), (3, 0, 0), (0, 0, -3)),
        view=hw.camera(hw.look_from((0.5, 0.8, 3.2), (0, 0, 0)), 6, 5, fov_deg=60),
        materials=(Material(color=(1.0, 1.0, 1.0), texture=0),),
        textures=(CheckerTexture((0.9, 0.8, 0.7), (0.1, 0.2, 0.3), scale=7),),
        sphere_lights=(lamp,),
    )


@pytest.mark.slow
def test_variances_are_those_of_many_renders():
    """The mean of the variance plane is the variance of the mean plane over seeds, for every plane."""
    runs, scene = 300, _noisy_world()
    planes = np.stack([hw.render(scene, seed=seed, spp=8).planes for seed in range(runs)]).astype(np.float64)
    y = np.tensordot(planes[:, :3], (0.2126, 0.7152, 0.0722), axes=(1, 0))
    hits = planes[:, BASE_PLANES.index("Coverage")] * 8
    for name in VARIANCE_PLANES:
        what = name.removeprefix("Variance.")
        means = y if what == "Luminance" else planes[:, BASE_PLANES.index(what)]
        claimed = planes[:, ALL_PLANES.index(name)]
        if what.startswith(("Albedo", "N", "Depth")):
            # 1/hits varies from run to run where a pixel is half covered; take those that always hit.
            full = (hits == 8).all(axis=0)
            assert full.sum() > 5
            means, claimed = means[:, full], claimed[:, full]
        empirical, mean_claimed = means.var(axis=0, ddof=1).sum(), claimed.mean(axis=0).sum()
        assert empirical > 0
        assert mean_claimed == pytest.approx(empirical, rel=0.12), name


def test_variances_are_nan_with_fewer_than_two_samples_or_hits():
    frame = hw.render(_noisy_world(), spp=1)
    for name in VARIANCE_PLANES:
        assert np.isnan(frame.plane(name)).all(), name
    scene = hw.with_camera(_noisy_world(), hw.camera(hw.look_from((0.5, 0.8, 3.2), (0, 0, 0)), 24, 24, fov_deg=60))
    frame = hw.render(scene, spp=4)
    hits = frame.plane("Coverage") * 4
    assert ((hits > 0) & (hits < 2)).any() and (hits == 0).any() and (hits == 4).any()
    for name in VARIANCE_PLANES:
        of_hits = name.removeprefix("Variance.").startswith(("Albedo", "N", "Depth"))
        np.testing.assert_array_equal(np.isnan(frame.plane(name)), hits < 2 if of_hits else np.zeros_like(hits, bool))
    assert np.isfinite(frame.planes[: len(BASE_PLANES)]).all()


def test_features_are_zero_on_a_miss():
    frame = hw.render(_noisy_world(), spp=2)
    missed = frame.plane("Coverage") == 0
    assert missed.any()
    for name in ("Albedo.R", "Nx", "Ny", "Nz", "Depth"):
        assert np.all(frame.plane(name)[missed] == 0)


def test_a_wide_picture_keeps_square_pixels_and_row_0_is_the_top():
    lamp = SphereLight(0.1, (1.0, 1.0, 1.0), Static(hw.translation(0.0, 0.3, -2.0)))
    scene = hw.world(sphere_lights=(lamp,), materials=(), view=hw.camera(None, 32, 16, fov_deg=60))
    frame = hw.render(scene, spp=16, max_depth=1)
    rows, columns = np.nonzero(frame.plane("Coverage") == 1)
    assert rows.mean() < 7 and abs(columns.mean() - 15.5) < 0.5
    assert abs(np.ptp(rows) - np.ptp(columns)) <= 1
    taller = replace(scene, camera=replace(scene.camera, height=32))
    assert np.ptp(np.nonzero(hw.render(taller, spp=16).plane("Coverage") == 1)[0]) == np.ptp(rows)
