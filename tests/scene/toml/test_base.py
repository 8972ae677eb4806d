"""A TOML that adds to the scene of another program."""

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene import load_world

ROOM = """<scene version="3.0.0">
  <sensor type="perspective"><float name="fov" value="50"/>
    <transform name="to_world"><lookat origin="0, 1, 4" target="0, 1, 0" up="0, 1, 0"/></transform></sensor>
  <shape type="cube"><bsdf type="diffuse"><rgb name="reflectance" value="0.2, 0.3, 0.4"/></bsdf></shape>
  <emitter type="constant"><rgb name="radiance" value="1, 2, 3"/></emitter>
</scene>
"""
CRATE = """[materials.crate]
color = [0.5, 0.4, 0.2]
[[objects]]
name = "crate"
shape = "box"
material = "crate"
keyframes = [{ time_s = 0.0, position = [0.0, 0.0, 2.0] }, { time_s = 3.0, position = [3.0, 0.0, 2.0] }]
[[objects]]
shape = "sphere"
radius_m = 0.2
[[sphere_lights]]
radius_m = 0.1
radiance = [5.0, 5.0, 5.0]
"""


def load(tmp_path, text, room=ROOM):
    (tmp_path / "room.xml").write_text(room)
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return load_world(path)


def colors(world, instance):
    mesh = world.meshes[world.instances[instance].mesh]
    return {world.materials[k].color for k in np.unique(mesh.material_ids)}


def test_things_and_lamps_are_added_to_what_the_room_has(tmp_path):
    world = load(tmp_path, 'base = "room.xml"\n' + CRATE)
    assert [colors(world, k) for k in range(3)] == [{(0.2, 0.3, 0.4)}, {(0.5, 0.4, 0.2)}, {(0.5, 0.5, 0.5)}]
    assert world.environment == (1.0, 2.0, 3.0)
    assert [light.radius_m for light in world.sphere_lights] == [0.1]
    assert world.name == "scene"
    assert world.duration_s == 3.0


def test_its_camera_moves_as_it_does_in_the_room_alone(tmp_path):
    world = load(tmp_path, 'base = "room.xml"\n' + CRATE)
    alone = load_world(tmp_path / "room.xml")
    for time_s in (0.0, 0.3):
        np.testing.assert_array_equal(world.camera.motion.pose(time_s), alone.camera.motion.pose(time_s))
    assert not np.array_equal(world.camera.motion.pose(0.0), world.camera.motion.pose(0.3))


def test_a_camera_and_an_environment_of_its_own_take_the_place_of_the_rooms(tmp_path):
    own = "[camera]\nposition = [0.0, 0.5, 2.0]\n[environment]\nradiance = [0.1, 0.1, 0.1]\n"
    world = load(tmp_path, 'base = "room.xml"\n' + own)
    assert world.environment == (0.1, 0.1, 0.1)
    np.testing.assert_array_equal(world.camera.motion.pose(0.7)[:3, 3], (0.0, 0.5, 2.0))
    assert world.notes == ()


def test_what_the_room_asks_for_and_lacks_is_told(tmp_path):
    room = ROOM.replace("</scene>", '<shape type="hair"/></scene>')
    assert any("hair" in sentence for sentence in load(tmp_path, 'base = "room.xml"\n', room).warnings)


@pytest.mark.parametrize(
    ("base", "parts"),
    [
        ("rome.xml", ["scene.toml: base: the file 'rome.xml' is missing"]),
        ("scene.toml", ["scene.toml: base: scene.toml: expected a file of another program", ".glb"]),
    ],
)
def test_a_base_that_cannot_be_used_is_named(tmp_path, base, parts):
    with pytest.raises(InputError) as caught:
        load(tmp_path, f'base = "{base}"\n')
    assert all(part in str(caught.value) for part in parts)
    assert "\n" not in str(caught.value)
