"""Mitsuba 3 (Jakob et al., 2022) on the same world, as a yardstick."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene import CheckerTexture, Instance, Material, SphereLight, World

F64 = npt.NDArray[np.float64]


def mitsuba_scene(mitsuba: Any, world: World, max_depth: int) -> Any:
    """Return the world at its start as Mitsuba's scene, with a path integrator without roulette.

    Raises:
        InputError: it has more than meshes of one diffuse material each, plain or checkered, area lights, sphere
            lights, a constant environment and a pinhole camera.
    """
    check_plain(world)
    camera = world.camera
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": max_depth, "rr_depth": 1000},
        "sensor": {
            "type": "perspective",
            "fov": camera.fov_deg,
            "fov_axis": "x",
            "near_clip": 1e-3,
            "to_world": mitsuba.ScalarTransform4f(camera_pose(world, 0.0)),
            "film": {"type": "hdrfilm", "width": camera.width, "height": camera.height, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent"},
        },
    }
    if max(world.environment) > 0:
        scene["sky"] = {"type": "constant", "radiance": _rgb(world.environment)}
    for i, instance in enumerate(world.instances):
        scene[f"mesh{i}"] = _mesh(mitsuba, world, instance, f"mesh{i}")
    for i, light in enumerate(world.sphere_lights):
        emitter = {"type": "area", "radiance": _rgb(light.radiance)}
        to_world = mitsuba.ScalarTransform4f(_sphere_pose(light, 0.0))
        scene[f"light{i}"] = {"type": "sphere", "to_world": to_world, "emitter": emitter}
    return mitsuba.load_dict(scene)


def move_scene(mitsuba: Any, scene: Any, world: World, time_s: float) -> None:
    """Put what moves in a scene of ``mitsuba_scene`` where it is at that time; the camera is the caller's."""
    values = mitsuba.traverse(scene)
    moved = False
    for i, instance in enumerate(world.instances):
        if instance.motion.duration_s > 0:
            values[f"mesh{i}.vertex_positions"] = _vertices(world, instance, time_s).ravel()
            moved = True
    for i, light in enumerate(world.sphere_lights):
        if light.motion.duration_s > 0:
            values[f"light{i}.to_world"] = mitsuba.Transform4f(_sphere_pose(light, time_s))
            moved = True
    if moved:
        values.update()


def camera_pose(world: World, time_s: float) -> F64:
    """Return the camera's pose as Mitsuba has it: looking along +z, with x to the left."""
    return world.camera.motion.pose(time_s) @ np.diag([-1.0, 1.0, -1.0, 1.0])


def check_plain(world: World) -> None:
    """Refuse, by InputError, what would come out otherwise than clsim renders it."""
    materials = [world.materials[i] for mesh in world.meshes for i in np.unique(mesh.material_ids)]
    textures = [world.textures[m.texture] for m in materials if m.texture >= 0]
    lacking = {
        "materials other than diffuse ones": any(m.kind != "diffuse" for m in materials),
        "cut-out materials": any(m.alpha_mode != "opaque" for m in materials),
        "textures other than checkers of colour": any(not isinstance(t, CheckerTexture) for t in textures)
        or any(max(m.emission_texture, m.normal_texture) >= 0 for m in materials),
        "meshes of several materials": any(len(np.unique(mesh.material_ids)) > 1 for mesh in world.meshes),
        "meshes that deform": any(mesh.deformation is not None for mesh in world.meshes),
        "lights without size": bool(world.punctual_lights),
        "an environment map": world.environment_map is not None,
    }
    for what, is_there in lacking.items():
        if is_there:
            raise InputError(
                f"{world.name}: {what} cannot be handed to Mitsuba, expected a Mitsuba file or plain things"
            )


def _mesh(mitsuba: Any, world: World, instance: Instance, name: str) -> Any:
    mesh = world.meshes[instance.mesh]
    material = world.materials[int(mesh.material_ids[0])]
    properties = mitsuba.Properties()
    properties["face_normals"] = mesh.normals is None
    diffuse = {"type": "diffuse", "reflectance": _reflectance(mitsuba, world, material)}
    bsdf = {"type": "twosided", "bsdf": diffuse} if material.back == "same" else diffuse
    properties["bsdf"] = mitsuba.load_dict(bsdf)
    if max(material.emission) > 0:
        properties["emitter"] = mitsuba.load_dict({"type": "area", "radiance": _rgb(material.emission)})
    shape = mitsuba.Mesh(
        name,
        len(mesh.vertices),
        len(mesh.triangles),
        props=properties,
        has_vertex_normals=mesh.normals is not None,
        has_vertex_texcoords=mesh.uvs is not None,
    )
    values = mitsuba.traverse(shape)
    values["vertex_positions"] = _vertices(world, instance, 0.0).ravel()
    values["faces"] = mesh.triangles.ravel().astype(np.uint32)
    if mesh.normals is not None:
        turned = mesh.normals @ np.linalg.inv(instance.motion.pose(0.0)[:3, :3])
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        values["vertex_normals"] = turned.astype(np.float32).ravel()
    if mesh.uvs is not None:
        values["vertex_texcoords"] = mesh.uvs.ravel()
    values.update()
    return shape


def _vertices(world: World, instance: Instance, time_s: float) -> npt.NDArray[np.float32]:
    matrix = instance.motion.pose(time_s)
    moved: npt.NDArray[np.float32] = (world.meshes[instance.mesh].vertices @ matrix[:3, :3].T + matrix[:3, 3]).astype(
        np.float32
    )
    return moved


def _reflectance(mitsuba: Any, world: World, material: Material) -> dict[str, Any]:
    if material.texture < 0:
        return _rgb(material.color)
    checker = world.textures[material.texture]
    assert isinstance(checker, CheckerTexture)  # checked before
    colours = [tuple(np.multiply(each, material.color).tolist()) for each in (checker.color_a, checker.color_b)]
    # Mitsuba's has two squares per unit of u and v.
    to_uv = mitsuba.ScalarTransform4f().scale([checker.scale / 2, checker.scale / 2, 1.0])
    return {"type": "checkerboard", "color0": _rgb(colours[0]), "color1": _rgb(colours[1]), "to_uv": to_uv}


def _sphere_pose(light: SphereLight, time_s: float) -> F64:
    """Return the pose of a unit sphere; the light's own turning does not show."""
    pose = np.diag([light.radius_m, light.radius_m, light.radius_m, 1.0])
    pose[:3, 3] = light.motion.pose(time_s)[:3, 3]
    return pose


def _rgb(value: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": list(value)}
