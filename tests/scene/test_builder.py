"""Worlds put together in Python."""

import numpy as np
import pytest
import trimesh
from PIL import Image

import clsim
from clsim.errors import InputError
from clsim.scene import Camera, ImageTexture, Material, PunctualLight, Static
from clsim.scene.driven import placed
from clsim.scene.motion import Orbit, compose
from clsim.scene.shapes import box

CAMERA = Camera(32, 24, 50.0, Static(compose((0.0, 0.4, 3.0), np.eye(3))))


def builder() -> clsim.WorldBuilder:
    return clsim.WorldBuilder(CAMERA, "lab")


def test_meshes_of_trimesh_bring_their_surfaces() -> None:
    made = builder()
    red = trimesh.creation.box((1.0, 2.0, 3.0))
    red.visual = trimesh.visual.ColorVisuals(red, face_colors=np.tile([188, 0, 0, 255], (12, 1)))
    made.add("red", red, compose((1.0, 0.0, 0.0), np.eye(3)))
    picture = Image.fromarray(np.full((2, 3, 3), (10, 20, 30), np.uint8))
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False)
    sheet.visual = trimesh.visual.TextureVisuals(
        [[0, 0], [1, 0], [0, 1]],
        trimesh.visual.material.PBRMaterial(
            baseColorTexture=picture, metallicFactor=0.25, roughnessFactor=0.5, emissiveFactor=[0.0, 1.0, 0.0]
        ),
    )
    made.add("sheet", sheet)
    simple = sheet.copy()
    simple.visual = trimesh.visual.TextureVisuals([[0, 0]] * 3, trimesh.visual.material.SimpleMaterial(image=picture))
    made.add("simple", simple)
    made.add("repainted", sheet, material=Material(color=(0.1, 0.2, 0.3)))
    world = made.world(environment=(1.0, 1.0, 1.0))
    first, second, third, fourth = (world.materials[int(mesh.material_ids[0])] for mesh in world.meshes)
    assert first.color == pytest.approx((0.503, 0.0, 0.0), abs=1e-3), "colours of faces are sRGB"
    assert (second.kind, second.metallic, second.alpha, second.emission) == ("principled", 0.25, 0.25, (0.0, 1.0, 0.0))
    assert fourth.color == (0.1, 0.2, 0.3) and fourth.texture == -1
    for material in (second, third):
        texture = world.textures[material.texture]
        assert isinstance(texture, ImageTexture) and texture.pixels[1, 2].tolist() == [10, 20, 30, 255]
    assert world.meshes[1].uvs is not None and world.meshes[1].uvs[2].tolist() == [0.0, 1.0]
    assert world.instances[0].motion.pose(0.0)[0, 3] == 1.0
    assert np.ptp(world.meshes[0].vertices, axis=0).tolist() == [1.0, 2.0, 3.0]


def test_parts_of_a_scene_move_together() -> None:
    parts = trimesh.Scene()
    ball = trimesh.creation.icosphere(subdivisions=1)
    parts.add_geometry(ball, geom_name="ball", node_name="left", transform=compose((-1.0, 0.0, 0.0), np.eye(3)))
    parts.add_geometry(
        ball, geom_name="ball", node_name="flat", transform=compose((1.0, 0, 0), np.diag([1.0, 0.5, 1.0]))
    )
    made = builder()
    made.add("pair", parts, Orbit((0.0, 0.0, 0.0), 2.0, 1.0))
    world = made.world(environment=(1.0, 1.0, 1.0))
    assert tuple(placed(world)) == ("camera", "pair", "pair/left", "pair/flat")
    assert world.duration_s == 1.0
    assert [instance.motion.pose(0.0)[:3, 3].tolist() for instance in world.instances] == [[-1, 0, 2], [1, 0, 2]]
    assert np.ptp(world.meshes[world.instances[1].mesh].vertices[:, 1]) == pytest.approx(1.0, abs=0.1)


def test_what_cannot_be_added_is_told() -> None:
    made = builder()
    made.add("cube", box((1.0, 1.0, 1.0)))
    for name in ("cube", "camera", "", "a/b"):
        with pytest.raises(InputError, match="must be a name of its own"):
            made.add(name, box((1.0, 1.0, 1.0)))
    with pytest.raises(InputError, match="thing: expected a Mesh, or a mesh or scene of trimesh, got dict"):
        made.add("thing", {})
    with pytest.raises(InputError, match="`pose` must be a 4×4 matrix"):
        made.add("thing2", box((1.0, 1.0, 1.0)), "here")
    made.add_light("sun", PunctualLight("directional", (-1.0, 0.0, 0.0), Static(np.eye(4))))
    with pytest.raises(InputError, match="lab: directional light 0: intensity is"):
        made.world()


def test_a_material_is_that_of_all_parts_of_a_scene() -> None:
    parts = trimesh.Scene({"a": trimesh.creation.box(), "b": trimesh.creation.icosphere()})
    made = builder()
    made.add("both", parts, material=Material(color=(0.1, 0.2, 0.3)))
    world = made.world(environment=(1.0, 1.0, 1.0))
    assert [world.materials[world.meshes[each.mesh].material_ids[0]].color for each in world.instances] == [
        (0.1, 0.2, 0.3)
    ] * 2
