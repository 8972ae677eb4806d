"""Names, files and bundled scenes."""

import json
import os
from dataclasses import fields, replace

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene import bundled_names, bundled_scenes, describe, load_world
from clsim.scene.load import SUFFIXES
from clsim.scene.motion import Static
from clsim.scene.parts import with_textures_from
from clsim.scene.world import Material, PunctualLight


def poses(world, time_s):
    motions = [world.camera.motion, *(i.motion for i in world.instances), *(x.motion for x in world.sphere_lights)]
    return np.stack([motion.pose(time_s) for motion in motions])


@pytest.mark.parametrize("name", bundled_names())
def test_bundled_scenes_load_and_say_what_they_are(name):
    world = load_world(name)
    assert (world.camera.width, world.camera.height) == (346, 260)
    assert bundled_scenes()[name]
    assert world.name == name
    assert any(any(m.emission) for m in world.materials) or world.sphere_lights or any(world.environment)
    assert json.loads(json.dumps(describe(world)))["resolution"] == [346, 260]


def test_the_scenes_of_the_readme_are_bundled():
    assert {"two-boxes", "moving-light", "cornell", "still"} <= set(bundled_names())


@pytest.mark.parametrize(
    ("name", "moving"),
    [
        ("two-boxes", {"camera"}),
        ("moving-light", {"lights"}),
        ("cornell", {"objects"}),
        ("uniform-wall", {"objects"}),
        ("edge", {"objects"}),
        ("still", set()),
    ],
)
def test_what_moves_in_the_bundled_scenes(name, moving):
    """At 24 frames and 60 fps as well as over the whole scene; told by the poses, and the same by describe."""
    world = load_world(name)
    motions = {
        "camera": [world.camera.motion],
        "objects": [instance.motion for instance in world.instances],
        "lights": [light.motion for light in world.sphere_lights],
    }
    seen = {
        group
        for group, members in motions.items()
        if any(np.abs(m.pose(0.4) - m.pose(0.0)).max() > 0.05 for m in members)
    }
    ever = {
        group
        for group, members in motions.items()
        for m in members
        for t in np.linspace(0, world.duration_s, 9)
        if np.abs(m.pose(t) - m.pose(0.0)).max() > 0
    }
    assert seen == ever == moving
    facts = describe(world)
    told = {"camera": facts["camera_moves"], "objects": facts["moving_objects"], "lights": facts["moving_lights"]}
    shining = {"lights"} if name == "edge" else set()  # its panel is an object that emits
    assert {group for group, value in told.items() if value} == moving | shining


def test_a_resolution_changes_nothing_else():
    plain, small = load_world("cornell"), load_world("cornell", resolution=(64, 48))
    assert (small.camera.width, small.camera.height) == (64, 48)
    assert small.camera.fov_deg == plain.camera.fov_deg
    np.testing.assert_array_equal(poses(small, 0.5), poses(plain, 0.5))


@pytest.mark.parametrize(
    ("light", "glass", "warned"),
    [
        ('[[lights]]\nkind = "point"\nintensity = [1, 1, 1]\nposition = [0, 2, 0]', 'kind = "thin-dielectric"', True),
        ('[[lights]]\nkind = "point"\nintensity = [1, 1, 1]\nposition = [0, 2, 0]', 'kind = "dielectric"', True),
        (
            '[[lights]]\nkind = "point"\nintensity = [1, 1, 1]\nposition = [0, 2, 0]',
            'kind = "principled"\ntransmission = 0.5',
            True,
        ),
        (
            '[[lights]]\nkind = "point"\nintensity = [1, 1, 1]\nposition = [0, 2, 0]',
            'kind = "principled"',
            False,
        ),
        ("[[sphere_lights]]\nradius_m = 0.1\nradiance = [1, 1, 1]\nposition = [0, 2, 0]", 'kind = "dielectric"', False),
    ],
)
def test_lights_that_glass_stops_are_warned_about(tmp_path, light, glass, warned):
    path = tmp_path / "a.toml"
    box = "[[objects]]\nshape = 'box'\nmaterial = 'glass'\n"
    path.write_text(f"[camera]\nposition = [0, 0, 9]\n[materials.glass]\n{glass}\n{box}{light}\n")
    assert ["do not shine through glass" in sentence for sentence in load_world(path).warnings] == [True] * warned


@pytest.mark.parametrize("resolution", [(0, 48), (64, -1), (100_000, 10), (16384, 16384)])
def test_impossible_resolutions_are_refused(resolution):
    with pytest.raises(InputError, match="camera"):
        load_world("still", resolution=resolution)


def test_an_unknown_name_lists_the_bundled_ones_and_guesses():
    with pytest.raises(InputError, match="did you mean two-boxes") as caught:
        load_world("two-boxs")
    assert all(name in str(caught.value) for name in bundled_names())


@pytest.mark.parametrize("name", ["", "none.toml", "none.glb", "scene.blend", "/", "a\nb"])
def test_what_is_no_scene_is_refused(name):
    with pytest.raises(InputError):
        load_world(name)


def test_a_mesh_that_stands_twice_counts_twice_but_is_stored_once():
    world = load_world("cornell")
    facts = describe(replace(world, instances=world.instances * 2))
    assert facts["triangles"] == 2 * facts["mesh_triangles"] == 2 * describe(world)["triangles"]


def test_describe_counts_textures_of_lamps_and_of_what_blends():
    world = replace(load_world("cornell"), textures=load_world("two-boxes").textures * 2)
    assert describe(world)["textures"] == 0 and not describe(world)["needs"]["textures"]
    spot = PunctualLight("spot", (1.0, 1.0, 1.0), Static(np.eye(4)), picture=2)
    lit = describe(replace(world, punctual_lights=(spot,)))
    assert lit["textures"] == 1 and lit["needs"]["textures"]
    materials, n = list(world.materials), len(world.materials)
    used = int(world.meshes[world.instances[0].mesh].material_ids[0])
    materials[used] = replace(materials[used], texture=0, blend_with=n)
    blended = (*materials, Material(texture=1, blend_with=n + 1), Material(normal_texture=3))
    assert describe(replace(world, materials=blended, punctual_lights=(spot,)))["textures"] == 4


def test_describe_counts_the_cornell_box():
    facts = describe(load_world("cornell"))
    assert facts["triangles"] == 6 * 2 + 2 * 12  # five walls and a lamp of two triangles, two blocks of twelve
    assert facts["area_light_triangles"] == 2
    assert facts["materials"] == 4
    needs = {key for key, value in facts["needs"].items() if value}
    assert needs == {"area_lights", "moving_objects"}


def test_textures_of_every_use_follow_their_material_into_a_longer_list():
    uses = [each.name for each in fields(Material) if each.name.endswith("texture")]
    material = Material(**{use: k for k, use in enumerate(uses)})
    moved = with_textures_from(material, 7)
    assert [getattr(moved, use) for use in uses] == list(range(7, 7 + len(uses)))
    assert with_textures_from(Material(), 7) == Material()


def test_glass_that_nothing_is_made_of_warns_of_nothing(tmp_path):
    path = tmp_path / "a.toml"
    light = '[[lights]]\nkind = "point"\nintensity = [1, 1, 1]\nposition = [0, 2, 0]\n'
    glass = '[materials.glass]\nkind = "dielectric"\n[[objects]]\nshape = "box"\n'
    path.write_text(f"[camera]\nposition = [0, 0, 9]\n{glass}{light}")
    assert not load_world(path).warnings


@pytest.mark.parametrize(
    ("light", "lit"),
    [
        ("", False),
        ("[environment]\nradiance = [0, 0, 0]", False),
        ("[environment]\nradiance = [0, 0, 0.1]", True),
        ("[materials.lamp]\nemission = [1, 1, 1]", False),  # nothing is made of it
        ("[materials.lamp]\nemission = [1, 1, 1]\n[[objects]]\nshape = 'box'\nmaterial = 'lamp'", True),
        ("[[lights]]\nkind = 'point'\nintensity = [1, 1, 1]\nposition = [0, 2, 0]", True),
        ("[[lights]]\nkind = 'point'\nintensity = [0, 0, 0]\nposition = [0, 2, 0]", False),
        ("[[sphere_lights]]\nradius_m = 0.1\nradiance = [1, 1, 1]\nposition = [0, 2, 0]", True),
    ],
)
def test_a_scene_without_any_light_is_warned_about(tmp_path, light, lit):
    path = tmp_path / "a.toml"
    path.write_text(f"[camera]\nposition = [0, 0, 9]\n[[objects]]\nshape = 'box'\n{light}\n")
    warnings = load_world(path, strict=True).warnings  # that is nothing that clsim lacks
    assert ["the scene has no light, so only noise fires" in sentence for sentence in warnings] == [True] * (not lit)


@pytest.mark.parametrize("name", bundled_names())
def test_bundled_scenes_have_light(name):
    assert not load_world(name).warnings


@pytest.mark.parametrize("ending", SUFFIXES)
def test_a_pipe_is_not_waited_for(tmp_path, ending):
    path = tmp_path / f"scene{ending}"
    os.mkfifo(path)
    with pytest.raises(InputError, match="is no ordinary file, expected a scene"):
        load_world(path)
