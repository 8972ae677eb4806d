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
