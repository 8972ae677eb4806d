"""Textures of MuJoCo's models: cubes around boxes and others, planes without end, pictures on boxes."""

import numpy as np
import PIL.Image
import pytest

from clsim.scene import load_world

SIDES = {
    "right": (0, 1, (250, 0, 0)), "left": (0, -1, (0, 250, 0)), "up": (1, 1, (0, 0, 250)),
    "down": (1, -1, (250, 250, 0)), "front": (2, 1, (0, 250, 250)), "back": (2, -1, (250, 0, 250)),
}  # fmt: skip
"""Files of a cube: axis and side of it in MuJoCo's world, and the colour of its picture here."""


def load(tmp_path, texture, material, geom):
    path = tmp_path / "model.xml"
    path.write_text(f"""<mujoco><asset>{texture}<material name="m" texture="t" {material}/></asset>
      <worldbody><geom {geom} material="m"/></worldbody></mujoco>""")
    world = load_world(path)
    (mesh,) = world.meshes
    return world, mesh, world.materials[int(mesh.material_ids[0])]


def colour(texture, uv):
    """Return the colour of a texture at a place, whose v points up."""
    u, v = np.array(texture.uv_matrix) @ (*uv, 1.0)
    height, width = texture.pixels.shape[:2]
    return tuple(texture.pixels[int((1 - v) % 1 * height), int(u % 1 * width), :3].tolist())


def sides(mesh):
    """Yield the corners of each side of a box."""
    for k in range(6):
        yield slice(4 * k, 4 * k + 4)


def test_each_side_of_a_box_has_its_picture_of_a_cube(tmp_path):
    files = ""
    for name, (_, _, rgb) in SIDES.items():
        PIL.Image.fromarray(np.full((8, 8, 3), rgb, np.uint8)).save(tmp_path / f"{name}.png")
        files += f'file{name}="{name}.png" '
    texture = f'<texture name="t" type="cube" {files}/>'
    world, mesh, material = load(tmp_path, texture, 'texrepeat="3 3" texuniform="true"', 'type="box" size=".1 .2 .4"')
    found = {}
    for side in sides(mesh):
        middle, uv = mesh.vertices[side].mean(axis=0), mesh.uvs[side].mean(axis=0)
        axis = int(np.argmax(np.ptp(mesh.vertices[side], axis=0) == 0))
        picture = world.textures[material.texture]
        shown = {colour(picture, corner * 0.999 + uv * 0.001) for corner in mesh.uvs[side]}
        assert shown == {colour(picture, uv)}, "a side has one picture alone"
        found[axis, int(np.sign(middle[axis]))] = shown.pop()
    assert found == {(axis, sign): rgb for axis, sign, rgb in SIDES.values()}
    assert world.warnings == ()


def test_one_picture_may_be_that_of_all_sides(tmp_path):
    pixels = np.zeros((8, 8, 3), np.uint8)
    pixels[:, 4:] = 250
    PIL.Image.fromarray(pixels).save(tmp_path / "a.png")
    world, mesh, material = load(
        tmp_path, '<texture name="t" type="cube" file="a.png"/>', "", 'type="box" size=".1 .2 .4"'
    )
    for side in sides(mesh):
        u, v = mesh.uvs[side].T
        assert np.allclose(sorted(u), (0, 0, 1, 1)) and np.allclose(sorted(v), (1 / 16, 1 / 16, 15 / 16, 15 / 16))
    assert world.textures[material.texture].pixels.shape[:2] in ((8, 8), (48, 8))


@pytest.mark.parametrize("geom", ['type="sphere" size=".2"', 'type="plane" size="1 1 .1"'])
def test_elsewhere_a_cube_s_mean_stands_in(tmp_path, geom):
    texture = '<texture name="t" type="cube" builtin="flat" rgb1="1 1 1" rgb2="1 1 1" width="8" height="8"/>'
    world, _, material = load(tmp_path, texture, 'rgba=".5 1 1 1"', geom)
    assert material.texture == -1 and material.color == pytest.approx((0.2140, 1, 1), abs=1e-3)
    assert any("their mean colour stands in" in warning for warning in world.warnings)


CHECKER = '<texture name="t" type="2d" builtin="checker" width="32" height="32"/>'


def test_a_plane_without_end_repeats_every_two_metres(tmp_path):
    world, _, material = load(tmp_path, CHECKER, 'texrepeat="2 4"', 'type="plane" size="0 0 .1"')
    matrix = np.array(world.textures[material.texture].uv_matrix)
    assert matrix[:, :2].tolist() == [[1.0, 0.0], [0.0, 2.0]]


def test_a_picture_on_a_box_covers_each_side_once(tmp_path):
    world, mesh, material = load(tmp_path, CHECKER, "", 'type="box" size=".1 .2 .4"')
    matrix = np.array(world.textures[material.texture].uv_matrix)
    for side in sides(mesh):
        found = np.column_stack([mesh.uvs[side], np.ones(4)]) @ matrix.T
        assert sorted(map(tuple, found.tolist())) == [(0, 0), (0, 1), (1, 0), (1, 1)]


@pytest.mark.parametrize("geom", ['type="plane" size="1 1 .1"', 'size=".3"'])
def test_what_glows_has_the_colours_of_its_picture(tmp_path, geom):
    """MuJoCo multiplies all light of a surface by its texture, also what it emits."""
    path = tmp_path / "robot.xml"
    path.write_text(f"""<mujoco><asset><texture name="t" type="2d" builtin="flat" rgb1="1 0 0" width="8" height="8"/>
        <material name="m" texture="t" rgba="1 1 1 1" emission=".5"/></asset>
        <worldbody><geom {geom} material="m"/></worldbody></mujoco>""")
    world = load_world(path)
    (mesh,) = world.meshes
    found = world.materials[mesh.material_ids[0]]
    shown = np.ones(3)
    if found.emission_texture >= 0:
        shown = world.textures[found.emission_texture].pixels[0, 0, :3] / 255
    np.testing.assert_allclose(found.emission * shown, (0.5, 0, 0), atol=1e-3)
    assert found.emission_texture == found.texture
