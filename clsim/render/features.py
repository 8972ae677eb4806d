"""What a scene has: kernels are built for exactly that and nothing more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from clsim.scene import CheckerTexture, Material, Mesh, World

Strategy = Literal["mis", "light", "scatter"]


@dataclass(frozen=True)
class Features:
    """The switches of the kernel factory; a part whose switch is off is not compiled in.

    Attributes:
        two_level: something moves, so rays pass through a tree over instances; else one mesh holds everything.
        smooth_normals: some mesh has shading normals.
        textures: some used material has a texture.
        one_sided: some used material's back is black.
        triangle_lights: some triangle emits.
        sphere_lights: the number of sphere lights is not zero.
        punctual_lights: the number of point, spot and directional lights is not zero.
        environment: the environment emits.
        environment_map: the environment is an image, with the constant environment added to it.
        motion_blur: the exposure lasts, and something moves.
        projection: the camera's.
        distortion: the camera's lens distorts.
        aperture: the camera's lens has a size.
        variances: the planes of variances are wanted.
        strategy: how light is found: "mis" both ways, "light" by sampling lights alone, "scatter" by scattering alone.
            The last two are for checking the first.
    """

    two_level: bool
    smooth_normals: bool
    textures: bool
    one_sided: bool
    triangle_lights: bool
    sphere_lights: bool
    punctual_lights: bool
    environment: bool
    environment_map: bool
    motion_blur: bool
    projection: Literal["perspective", "fisheye"]
    distortion: bool
    aperture: bool
    variances: bool
    strategy: Strategy

    def describe(self) -> dict[str, list[str]]:
        """Return what is compiled in, under "built in", and what is not, under "left out"."""
        rows = (
            (self.two_level, "moving objects (two-level tree)"),
            (self.smooth_normals, "smooth shading normals"),
            (self.textures, "textures"),
            (self.one_sided, "one-sided materials"),
            (self.triangle_lights, "triangle area lights"),
            (self.sphere_lights, "sphere lights"),
            (self.punctual_lights, "point, spot and directional lights"),
            (self.environment and not self.environment_map, "constant environment"),
            (self.environment_map, "environment map"),
            (self.motion_blur, "motion blur"),
            (self.projection == "fisheye", "fisheye projection"),
            (self.distortion, "lens distortion"),
            (self.aperture, "depth of field (thin lens)"),
            (self.variances, "variance planes"),
        )
        return {
            "built in": [text for present, text in rows if present],
            "left out": [text for present, text in rows if not present],
        }


def _used_meshes(world: World) -> list[Mesh]:
    return [world.meshes[index] for index in sorted({instance.mesh for instance in world.instances})]


def _used_materials(world: World) -> list[Material]:
    meshes = _used_meshes(world)
    used = {int(i) for mesh in meshes for i in np.unique(mesh.material_ids)}
    return [world.materials[i] for i in sorted(used)]


def checker_of(world: World, material: Material) -> int:
    """Return the index of the material's texture if it is a checkerboard, else -1."""
    is_checker = material.texture >= 0 and isinstance(world.textures[material.texture], CheckerTexture)
    return material.texture if is_checker else -1


def unsupported(world: World) -> tuple[str, ...]:
    """Return what the world asks for and the tracer does not do, one sentence each."""
    meshes, materials = _used_meshes(world), _used_materials(world)
    rows = (
        (any(m.kind != "diffuse" for m in materials), "materials other than diffuse are rendered as diffuse"),
        (
            any(m.texture >= 0 and checker_of(world, m) < 0 for m in materials),
            "image textures are rendered as their material's constant color",
        ),
        (any(m.emission_texture >= 0 for m in materials), "textures of emission are left out"),
        (any(m.normal_texture >= 0 for m in materials), "normal maps are left out"),
        (any(m.alpha_mode != "opaque" for m in materials), "cut-out and translucent materials are rendered as opaque"),
        (any(mesh.deformation is not None for mesh in meshes), "deforming meshes keep their rest shape"),
    )
    return tuple(text for lacks, text in rows if lacks)


def moves(world: World) -> bool:
    """Whether the camera, an object or a light moves rigidly."""
    movers = (world.camera, *world.instances, *world.sphere_lights, *world.punctual_lights)
    return any(mover.motion.duration_s > 0 for mover in movers)


def features_of(world: World, variances: bool, strategy: Strategy) -> Features:
    """Return the features that the world needs."""
    meshes, materials = _used_meshes(world), _used_materials(world)
    return Features(
        two_level=any(instance.motion.duration_s > 0 for instance in world.instances),
        smooth_normals=any(mesh.normals is not None for mesh in meshes),
        textures=any(checker_of(world, material) >= 0 for material in materials),
        one_sided=any(not material.two_sided for material in materials),
        triangle_lights=any(max(material.emission) > 0 for material in materials),
        sphere_lights=bool(world.sphere_lights),
        punctual_lights=bool(world.punctual_lights),
        environment=max(world.environment) > 0 or world.environment_map is not None,
        environment_map=world.environment_map is not None,
        motion_blur=world.camera.shutter_s > 0 and moves(world),
        projection=world.camera.lens.model,
        distortion=any(world.camera.lens.distortion),
        aperture=world.camera.lens.aperture_radius_m > 0,
        variances=variances,
        strategy=strategy,
    )
