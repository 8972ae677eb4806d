"""What a bundle of rays shows of a texture, against rays that meet the same plane."""

from __future__ import annotations

import numpy as np
import warp as wp

from clsim.render.accel.geometry import Surface
from clsim.render.textures.ray_footprint import patch_round
from clsim.render.textures.texture_data import Footprint


@wp.kernel(enable_backward=False)
def patches(
    uvs: wp.array(dtype=wp.vec2),
    normals: wp.array(dtype=wp.vec3),
    tangents: wp.array2d(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    width_m: float,
    out_patches: wp.array(dtype=Footprint),
):
    """Write the patch round each point."""
    i = wp.tid()
    point = Surface()
    point.uv = uvs[i]
    point.normal = normals[i]
    point.tangent = tangents[0, i]
    point.bitangent = tangents[1, i]
    out_patches[i] = patch_round(point, directions[i], width_m)


def test_the_patch_is_where_parallel_rays_meet_the_plane():
    """Whatever the plane's slope and its uv, skewed ones too."""
    random = np.random.default_rng(0)
    count, width_m = 200, 0.01
    directions = random.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    tangents = random.normal(size=(2, count, 3))
    normals = np.cross(*tangents)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals *= -np.sign((normals * directions).sum(axis=1))[:, None]
    uvs = random.uniform(size=(count, 2))
    found = wp.zeros(count, dtype=Footprint, device="cpu")
    given = [wp.array(np.float32(uvs), dtype=wp.vec2, device="cpu")]
    given += [wp.array(np.float32(each), dtype=wp.vec3, device="cpu") for each in (normals, tangents, directions)]
    wp.launch(patches, dim=count, inputs=[*given, width_m], outputs=[found], device="cpu")
    corners = found.numpy()
    steep = -(normals * directions).sum(axis=1) > 0.1
    assert steep.sum() > 150
    for i in np.flatnonzero(steep):
        four = np.array([corners[name][i] for name in ("top_left", "top_right", "bottom_right", "bottom_left")])
        assert (four[:, 2] == 1).all()
        np.testing.assert_allclose(four[:, :2].mean(axis=0), uvs[i], atol=1e-5)
        # From uv to space, and along the rays on to a plane across them: a square.
        places = (four[:, :2] - uvs[i]) @ tangents[:, i]
        across = places - np.outer(places @ directions[i], directions[i])
        sides = np.roll(across, -1, axis=0) - across
        np.testing.assert_allclose(np.linalg.norm(sides, axis=1), width_m, rtol=2e-3)
        np.testing.assert_allclose(sides[0] @ sides[1], 0, atol=2e-3 * width_m**2)
