"""What shading reads of a triangle, side by side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.render import SceneData
from clsim.render.accel.placement import place
from clsim.scene import CheckerTexture, Material, Static
from clsim.scene.motion import compose, euler_quaternion, rotation_matrix
from tests.render import hand_worlds as hw


def test_a_row_has_what_the_corners_of_its_triangle_have() -> None:
    ball, quad = hw.ball(1.0, rings=5, smooth=True), hw.quad((-2, -1, 2), (4, 0, 0), (0, 0, -4), material=1)
    ball = replace(ball, uvs=np.random.default_rng(0).random((len(ball.vertices), 2)).astype(np.float32))
    world = replace(
        hw.world(ball, quad, materials=(hw.GREY, Material(texture=0))), textures=(CheckerTexture((1, 1, 1), (0, 0, 0)),)
    )
    geometry = SceneData(world).scene.geometry
    rows, mesh = geometry.shading_rows.numpy(), place(world).meshes[0]
    assert rows.itemsize == 64, "a line of the cache"
    assert len(rows) == len(ball.triangles) + len(quad.triangles)
    for k in range(3):
        np.testing.assert_array_equal(rows[f"normal{k}"], mesh.normals[mesh.triangles[:, k]])
        np.testing.assert_array_equal(rows[f"uv{k}"], mesh.uvs[mesh.triangles[:, k]])
    np.testing.assert_array_equal(rows["material"], mesh.material_ids)
    assert np.ptp(rows["normal1"], axis=0).min() > 1.5 and set(rows["material"]) == {0, 1}


@pytest.mark.parametrize(
    "scale", [(1.0, 1.0, 1.0), (2.0, 1.0, 0.25), (0.5, -1.0, 3.0)], ids=["as it is", "long", "mirrored"]
)
def test_smooth_normals_of_what_is_placed_with_a_scale_are_those_of_the_ellipsoid(scale):
    """Across an ellipsoid is no longer away from its middle; normals must not be stretched as places are."""
    turned = rotation_matrix(euler_quaternion((20.0, 40.0, 60.0)))
    pose = compose((1.0, 2.0, 3.0), turned @ np.diag(scale))
    (mesh, *_) = place(hw.world(hw.ball(1.0, smooth=True), motions=[Static(pose)])).meshes
    unit = hw.ball(1.0).vertices.astype(float)
    expected = (unit / scale) @ turned.T
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.normals, expected, atol=1e-6)


@pytest.mark.parametrize(("x_m", "moved_m"), [(0.0, 0.0), (7.0, 0.0), (9.0, 9.0), (5000.0, 5000.0)])
def test_what_is_far_off_has_its_middle_at_the_devices_origin(x_m: float, moved_m: float) -> None:
    """Farther than four times its size, which is two metres here, however flat it is."""
    sheet = hw.quad((-1, -1, -1), (2, 0, 0), (0, 2, 0))
    placed = place(hw.world(sheet, motions=[Static(hw.translation(x_m, 0.0, 1.0))]))
    np.testing.assert_allclose(placed.origin_m, (moved_m, 0.0, 0.0), atol=1e-9)
    # Where it is in the world stays as it was.
    corners = placed.meshes[0].vertices + placed.instances[0].motion.pose(0.0)[:3, 3]
    np.testing.assert_allclose(corners.mean(axis=0), (x_m, 0.0, 0.0), atol=1e-6 * (1 + x_m))
