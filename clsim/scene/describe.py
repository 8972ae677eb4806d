"""A world in figures, for people and programs."""

from __future__ import annotations

from typing import Any

import numpy as np

from clsim.scene.world import TEXTURES, Camera, World


def _view(camera: Camera) -> dict[str, Any]:
    lens = camera.lens
    if lens.model == "orthographic":
        return {"lens": lens.model, "view_width_m": lens.view_width_m}
    return {"lens": lens.model, "fov_deg": camera.fov_deg}


def describe(world: World) -> dict[str, Any]:
    """Return counts, motion and what the scene asks of a renderer, as plain JSON values.

    ``mesh_triangles`` counts triangles as they are stored, ``triangles`` as they stand in the world.
    ``needs`` names the renderer's optional abilities, each True where the scene uses it.
    """
    camera = world.camera
    emissive = {k for k, material in enumerate(world.materials) if any(material.emission)}
    # Triangles are counted as often as they stand in the world, which is what a ray may meet.
    triangles = [len(world.meshes[instance.mesh].triangles) for instance in world.instances]
    area_lights = [
        int(np.isin(world.meshes[instance.mesh].material_ids, list(emissive)).sum()) for instance in world.instances
    ]
    deforming = {k for k, mesh in enumerate(world.meshes) if mesh.deformation and mesh.deformation.duration_s > 0}
    moving = [i for i in world.instances if i.motion.duration_s > 0 or i.mesh in deforming]
    used = {int(k) for instance in world.instances for k in np.unique(world.meshes[instance.mesh].material_ids)}
    while others := {world.materials[k].blend_with for k in used} - used - {-1}:
        used |= others
    textures = {getattr(world.materials[k], key) for k in used for key in TEXTURES}
    textures |= {light.picture for light in world.punctual_lights}
    textures -= {-1}
    return {
        "name": world.name,
        "resolution": [camera.width, camera.height],
        **_view(camera),
        "shutter_s": camera.shutter_s,
        "fps": world.fps,
        "duration_s": world.duration_s,
        "camera_moves": camera.motion.duration_s > 0,
        "objects": len(world.instances),
        "moving_objects": len(moving),
        "deforming_objects": sum(instance.mesh in deforming for instance in world.instances),
        "meshes": len(world.meshes),
        "mesh_triangles": sum(len(mesh.triangles) for mesh in world.meshes),
        "triangles": sum(triangles),
        "materials": len(used),
        "material_kinds": sorted({world.materials[k].kind for k in used}),
        "textures": len(textures),
        "area_light_triangles": sum(area_lights),
        "sphere_lights": len(world.sphere_lights),
        "punctual_lights": len(world.punctual_lights),
        "moving_lights": sum(light.motion.duration_s > 0 for light in world.sphere_lights)
        + sum(light.motion.duration_s > 0 for light in world.punctual_lights)
        + sum(count > 0 and i.motion.duration_s > 0 for i, count in zip(world.instances, area_lights, strict=True)),
        "changing_lights": sorted({name for name, _ in [*world.modulations(), *world.films()]}),
        "environment": list(world.environment),
        "thresholds": {"on": world.sensor.threshold_on, "off": world.sensor.threshold_off},
        "spectral": world.sensor.spectral,
        "needs": {
            "textures": bool(textures),
            "transparency": any(world.materials[k].alpha_mode != "opaque" for k in used),
            "moving_objects": bool(moving),
            "smooth_normals": any(world.meshes[i.mesh].normals is not None for i in world.instances),
            "area_lights": any(area_lights),
            "sphere_lights": bool(world.sphere_lights),
            "punctual_lights": bool(world.punctual_lights),
            "environment": any(world.environment),
            "environment_map": world.environment_map is not None,
            "deformation": bool(deforming),
            "motion_blur": camera.shutter_s > 0,
        },
        "warnings": list(world.warnings),
        "notes": list(world.notes),
    }
