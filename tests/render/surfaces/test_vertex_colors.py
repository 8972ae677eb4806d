"""Colours of vertices, in pictures and where meshes are joined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.render.accel.placement import place
from clsim.scene import Material
from clsim.scene.meshes.trimesh_scene import load_bare, load_triangles
from tests.render import hand_worlds as hw

CORNERS = ((0.9, 0.1, 0.2), (0.1, 0.8, 0.3), (0.2, 0.3, 1.0), (1.0, 1.0, 0.0))


def colored():
    """A square from −1 to 1 with a colour at each corner."""
    square = hw.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    return replace(square, colors=np.array(CORNERS, np.float32))


def test_still_meshes_are_joined_with_their_colours():
    plain = hw.quad((-1, -1, -1), (2, 0, 0), (0, 2, 0))
    (mesh,) = place(hw.world(plain, colored())).meshes
    np.testing.assert_array_equal(mesh.colors, np.concatenate([np.ones((4, 3)), CORNERS]).astype(np.float32))
    assert place(hw.world(plain)).meshes[0].colors is None


def test_colours_of_a_ply_are_its_vertices(tmp_path):
    """They are sRGB: 188 is half of the light (IEC 61966-2-1)."""
    path = tmp_path / "colours.ply"
    rows = ["0 0 0 255 0 188", "1 0 0 0 255 188", "0 1 0 0 0 188"]
    head = ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {axis}" for axis in "xyz")]
    head += [f"property uchar {name}" for name in ("red", "green", "blue")]
    head += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    path.write_text("\n".join([*head, *rows, "3 0 1 2", ""]))
    world = load_bare(path)
    np.testing.assert_allclose(world.meshes[0].colors, [(1, 0, 0.503), (0, 1, 0.503), (0, 0, 0.503)], atol=2e-3)
    assert world.materials[0].color == (1.0, 1.0, 1.0) and world.warnings == ()
    assert load_triangles(path).colors is None, "another program's materials have their own"


@pytest.mark.slow
@pytest.mark.parametrize("moving", [False, True])
def test_a_picture_shows_the_colours_blended_by_place(moving):
    """Albedo is the material's colour times what linear interpolation gives, triangle by triangle."""
    pose = hw.look_from((0.0, 0.0, 3.0), (0.0, 0.0, 0.0))
    view = hw.camera(pose, width=24, height=24, fov_deg=30.0)
    motions = [hw.IDENTITY]
    if moving:
        from clsim.scene.motion import Keyframes

        motions = [Keyframes((0.0, 1.0), ((0.0, 0.0, 0.0), (1e-6, 0.0, 0.0)), ((0.0, 0.0, 0.0, 1.0),) * 2)]
    material = Material(color=(0.5, 1.0, 0.8))
    world = hw.world(colored(), materials=[material], view=view, motions=motions, environment=(1.0, 1.0, 1.0))
    frame = hw.render(world, spp=64)
    albedo = frame.planes[[frame.names.index(f"Albedo.{c}") for c in "RGB"]]
    half = 3.0 * np.tan(np.radians(15.0))
    x = (2 * (np.arange(24) + 0.5) / 24 - 1) * half
    u, v = (x[None, :] + 1) / 2, (-x[:, None] + 1) / 2
    a, b, c, d = (np.array(corner)[:, None, None] for corner in CORNERS)
    (p, q, r), (s, t, w) = world.meshes[0].triangles
    assert (p, q, r) == (0, 1, 2) and (s, t, w) == (0, 2, 3), "the square is cut from corner 0 to corner 2"
    lower, upper = a + u * (b - a) + v * (c - b), a + v * (d - a) + u * (c - d)
    expected = np.where(u > v, lower, upper) * np.array(material.color)[:, None, None]
    away = np.abs(u - v) > 0.05
    assert np.abs(albedo - expected)[:, away].max() < 0.01
