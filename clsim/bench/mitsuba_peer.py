"""Mitsuba 3 (Jakob et al., 2022) on the same world, as a yardstick; an optional package."""

from __future__ import annotations

import ctypes.util
import os
from pathlib import Path
from typing import Any

import numpy as np

from clsim.scene import World


def load_mitsuba() -> Any:
    """Return the module with its LLVM variant set, or None where it, or the LLVM library it needs, is not installed."""
    try:
        import mitsuba
    except ImportError:
        return None
    if "DRJIT_LIBLLVM_PATH" not in os.environ:
        libraries = sorted(Path("/usr/lib").glob("*/libLLVM-*.so"), key=lambda path: float(path.stem.split("-")[-1]))
        found = str(libraries[-1]) if libraries else ctypes.util.find_library("LLVM")
        if found is None:
            return None
        os.environ["DRJIT_LIBLLVM_PATH"] = found
    try:
        mitsuba.set_variant("llvm_ad_rgb")
    except (ImportError, RuntimeError):
        return None
    return mitsuba


def mitsuba_scene(mitsuba: Any, world: World, max_depth: int) -> Any:
    """Return the world's triangles, diffuse materials, area lights and pinhole camera, paths without roulette."""
    camera = world.camera
    pose = camera.motion.pose(0.0) @ np.diag([-1.0, 1.0, -1.0, 1.0])
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": max_depth, "rr_depth": 1000},
        "sensor": {
            "type": "perspective",
            "fov": camera.fov_deg,
            "fov_axis": "x",
            "near_clip": 1e-3,
            "to_world": mitsuba.ScalarTransform4f(pose),
            "film": {"type": "hdrfilm", "width": camera.width, "height": camera.height, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent"},
        },
    }
    for i, instance in enumerate(world.instances):
        mesh = world.meshes[instance.mesh]
        material = world.materials[int(mesh.material_ids[0])]
        matrix = instance.motion.pose(0.0)
        vertices = (mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)
        properties = mitsuba.Properties()
        properties["face_normals"] = True
        diffuse = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(material.color)}}
        bsdf = {"type": "twosided", "bsdf": diffuse} if material.two_sided else diffuse
        properties["bsdf"] = mitsuba.load_dict(bsdf)
        if max(material.emission) > 0:
            radiance = {"type": "rgb", "value": list(material.emission)}
            properties["emitter"] = mitsuba.load_dict({"type": "area", "radiance": radiance})
        shape = mitsuba.Mesh(f"mesh{i}", len(vertices), len(mesh.triangles), props=properties)
        values = mitsuba.traverse(shape)
        values["vertex_positions"] = vertices.ravel()
        values["faces"] = mesh.triangles.ravel().astype(np.uint32)
        values.update()
        scene[f"mesh{i}"] = shape
    return mitsuba.load_dict(scene)
