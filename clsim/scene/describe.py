"""A world in figures, for people and programs."""

from __future__ import annotations

from typing import Any

import numpy as np

from clsim.scene.world import World


def describe(world: World) -> dict[str, Any]:
    """Return counts, motion and what the scene asks of a renderer, as plain JSON values.

    ``needs`` names the renderer's optional abilities, each True where the scene uses it.
    """
    camera = world.camera
    emissive = {k for k, material in enumerate(world.materials) if any(material.emission)}
    # Triangles are counted as often as they stand in the world, which is what a ray may meet.
    triangles = [len(world.meshes[instance.mesh].triangles) for instance in world.instances]
    area_lights = [
        int(np.isin(world.meshes[instance.mesh].material_ids, list(emissive)).sum()) for instance in world.instances
    ]
    moving = [instance for instance in world.instances if instance.motion.duration_s > 0]
    used = {int(k) for instance in world.instances for k in np.unique(world.meshes[instance.mesh].material_ids)}
    return {
        "name": world.name,
        "resolution": [camera.width, camera.height],
        "fov_deg": camera.fov_deg,
        "shutter_s": camera.shutter_s,
        "fps": world.fps,
        "duration_s": world.duration_s,
        "camera_moves": camera.motion.duration_s > 0,
        "objects": len(world.instances),
        "moving_objects": len(moving),
        "meshes": len(world.meshes),
        "triangles": sum(triangles),
        "materials": len(used),
        "textures": len({world.materials[k].texture for k in used} - {-1}),
        "area_light_triangles": sum(area_lights),
        "sphere_lights": len(world.sphere_lights),
        "moving_lights": sum(light.motion.duration_s > 0 for light in world.sphere_lights)
        + sum(count > 0 and i.motion.duration_s > 0 for i, count in zip(world.instances, area_lights, strict=True)),
        "environment": list(world.environment),
        "thresholds": {"on": world.sensor.threshold_on, "off": world.sensor.threshold_off},
        "needs": {
            "textures": any(world.materials[k].texture >= 0 for k in used),
            "moving_objects": bool(moving),
            "smooth_normals": any(world.meshes[i.mesh].normals is not None for i in world.instances),
            "area_lights": any(area_lights),
            "sphere_lights": bool(world.sphere_lights),
            "environment": any(world.environment),
            "motion_blur": camera.shutter_s > 0,
        },
        "warnings": list(world.warnings),
    }
