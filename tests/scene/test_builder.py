"""Worlds put together in Python."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

import clsim
from clsim.errors import InputError
from clsim.scene import Camera, ImageTexture, Material, Mesh, PunctualLight, SphereLight, Static
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
    bare = sheet.copy()
    bare.visual = trimesh.visual.TextureVisuals([[0, 0]] * 3, trimesh.visual.material.PBRMaterial())
    made.add("bare", bare)
    world = made.world(environment=(1.0, 1.0, 1.0))
    first, second, third, fourth, fifth = (world.materials[int(mesh.material_ids[0])] for mesh in world.meshes)
    assert first.color == pytest.approx((0.503, 0.0, 0.0), abs=1e-3), "colours of faces are sRGB"
    assert (second.kind, second.metallic, second.alpha, second.emission) == ("principled", 0.25, 0.25, (0.0, 1.0, 0.0))
    assert fourth.color == (0.1, 0.2, 0.3) and fourth.texture == -1
    assert (fifth.color, fifth.metallic, fifth.alpha) == ((1.0, 1.0, 1.0), 1.0, 1.0), "glTF's own defaults"
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
    made.add("pair", parts, Orbit((0.0, 0.0, 0.0), 2.0, 1.5))
    world = made.world(environment=(1.0, 1.0, 1.0))
    assert tuple(placed(world)) == ("camera", "pair", "pair/left", "pair/flat")
    assert world.duration_s == 1.5
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


def test_who_changes_his_arrays_later_changes_no_world() -> None:
    """Many fill the same memory for one mesh after the other."""
    vertices, triangles = np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32)
    pixels, pose = np.full((2, 2, 4), 200, np.uint8), np.eye(4)
    made = clsim.WorldBuilder(Camera(32, 24, 50.0, Static(pose)))
    made.add_texture(ImageTexture(pixels))
    made.add("a", Mesh(vertices, triangles, np.zeros(1, np.int32)), Static(pose))
    made.add_parts("b", {"c": (Mesh(vertices, triangles, np.zeros(1, np.int32)), pose, Material())})
    made.add_light("lamp", SphereLight(0.1, (1.0, 1.0, 1.0), Static(pose)))
    for array in (vertices, triangles, pixels, pose):
        array[:] = 0
    world = made.world()
    assert all((mesh.vertices == np.eye(3)).all() and mesh.triangles.tolist() == [[0, 1, 2]] for mesh in world.meshes)
    assert all((motion.pose(0.0) == np.eye(4)).all() for motion in world.motions())
    assert world.textures[0].pixels.min() == 200  # type: ignore[union-attr]


def test_numbers_of_numpy_and_lists_are_as_good() -> None:
    """Lists of numbers for arrays, and 64 bits for 32."""
    made = clsim.WorldBuilder(Camera(np.int64(32), np.int32(24), np.float32(50), Static(np.eye(4).tolist())))  # type: ignore[arg-type]
    lists: Any = (np.eye(3).tolist(), [[0, 1, 2]], [0])
    made.add("a", Mesh(*lists), material=Material(color=np.ones(3), alpha=np.float64(0.5)))  # type: ignore[arg-type]
    world = made.world(environment=[1, 1, 1], fps=np.int64(60))  # type: ignore[arg-type]
    assert (type(world.camera.width), world.camera.fov_deg, world.fps) == (int, 50.0, 60.0)
    assert world.materials[0].color == (1.0, 1.0, 1.0) and world.environment == (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"camera": {"fov_deg": "wide"}}, "camera: `fov_deg` must be a finite number, got 'wide'"),
        ({"camera": {"motion": np.eye(4)}}, r"camera: `motion` must be a motion such as Static\(matrix\), got ndarray"),
        ({"camera": {"width": 32.0}}, "camera: `width` must be a whole number, got 32.0"),
        ({"material": {"color": 0.5}}, "a: `color` must be a list of 3 finite numbers, got 0.5"),
        ({"material": {"texture": 5}}, "world: material 0: texture is 5, expected -1 or one of the 0 textures"),
        (
            {"mesh": {"colors": np.full((3, 3), 255, np.uint8)}},
            "a: `colors` are up to 255, expected numbers from 0 to 1",
        ),
        ({"mesh": {"triangles": np.eye(3)}}, "a: `triangles` must be an array of whole numbers"),
        ({"mesh": {"vertices": [[0], [1, 2]]}}, "a: `vertices` must be an array of numbers"),
        ({"world": {"environment": 0.2}}, "`environment` must be a list of 3 finite numbers, got 0.2"),
        ({"world": {"sensor": 5}}, "sensor: expected Sensor, got int"),
        ({"world": {"fps": "30"}}, "`fps` must be a finite number, got '30'"),
        ({"world": {"duration_s": 0}}, "world: duration_s is 0.0, expected a positive number"),
    ],
    ids=str,
)
def test_values_of_the_wrong_kind_are_told_with_their_name(wrong: dict[str, dict[str, Any]], sentence: str) -> None:
    triangle = {"vertices": np.eye(3), "triangles": np.array([[0, 1, 2]]), "material_ids": np.zeros(1, np.int32)}
    with pytest.raises(InputError, match=rf"\A{sentence}\Z"):
        made = clsim.WorldBuilder(replace(CAMERA, **wrong.get("camera", {})))
        made.add("a", Mesh(**triangle | wrong.get("mesh", {})), material=Material(**wrong.get("material", {})))
        made.world(**wrong.get("world", {}))


def test_a_name_is_free_again_after_what_could_not_be_added() -> None:
    made = builder()
    with pytest.raises(InputError, match="a: expected a Mesh, or a mesh or scene of trimesh, got list"):
        made.add("a", [])
    made.add("a", box((1.0, 1.0, 1.0)))
    with pytest.raises(InputError, match="'a' must be a name of its own"):
        made.add("a", box((1.0, 1.0, 1.0)))
