"""The world as the renderer takes it: plain numpy arrays, resolved from whatever file described it.

Right-handed, +y up, metres, seconds; colours are linear Rec. 709; radiance in W·sr⁻¹·m⁻².
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from clsim.scene.motion import Motion, Static

Vec3 = tuple[float, float, float]
F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Mesh:
    """Triangles in object space.

    Attributes:
        vertices: float32 ``[n, 3]`` [m].
        triangles: int32 ``[m, 3]``, counter-clockwise seen from the front.
        normals: float32 ``[n, 3]`` unit shading normals, or None for flat shading.
        uvs: float32 ``[n, 2]``, u right and v up, or None.
        material_ids: int32 ``[m]``, one per triangle, into ``World.materials``.
    """

    vertices: F32
    triangles: I32
    material_ids: I32
    normals: F32 | None = None
    uvs: F32 | None = None


@dataclass(frozen=True)
class Instance:
    """A mesh placed in the world; several instances may share one mesh."""

    mesh: int
    motion: Motion
    name: str = ""


@dataclass(frozen=True)
class CheckerTexture:
    """Two colours in squares; ``scale`` squares per unit of u and v."""

    color_a: Vec3
    color_b: Vec3
    scale: float = 1.0


@dataclass(frozen=True)
class Material:
    """A surface.

    Attributes:
        kind: the scattering model.
        color: diffuse reflectance (multiplied by the texture where there is one).
        texture: index into ``World.textures``, or -1.
        emission: radiance that the surface emits; a triangle that emits is an area light.
        two_sided: whether the back scatters and emits as the front does.
    """

    kind: Literal["diffuse"] = "diffuse"
    color: Vec3 = (0.5, 0.5, 0.5)
    texture: int = -1
    emission: Vec3 = (0.0, 0.0, 0.0)
    two_sided: bool = True


@dataclass(frozen=True)
class SphereLight:
    """An analytic spherical emitter; its pose's translation is its centre."""

    radius_m: float
    radiance: Vec3
    motion: Motion


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; ``fov_deg`` is horizontal, pixels are square."""

    width: int
    height: int
    fov_deg: float
    motion: Motion
    shutter_s: float = 0.0


@dataclass(frozen=True)
class Sensor:
    """What the pixel sees: L = ln max(scale·Y, floor), Y the luminance; thresholds in natural-log units."""

    threshold_on: float = 0.2
    threshold_off: float = 0.2
    scale: float = 1.0
    floor: float = 1e-4


@dataclass(frozen=True)
class World:
    """Everything the renderer needs.

    Attributes:
        environment: radiance of the constant environment; all 0 is no environment.
        duration_s: length of the motion; 1 s where nothing moves.
        warnings: what the file asked for and clsim lacks, one sentence each.
    """

    name: str
    camera: Camera
    meshes: tuple[Mesh, ...] = ()
    instances: tuple[Instance, ...] = ()
    materials: tuple[Material, ...] = ()
    textures: tuple[CheckerTexture, ...] = ()
    sphere_lights: tuple[SphereLight, ...] = ()
    environment: Vec3 = (0.0, 0.0, 0.0)
    sensor: Sensor = field(default_factory=Sensor)
    fps: float = 120.0
    duration_s: float = 1.0
    warnings: tuple[str, ...] = ()


IDENTITY = Static(np.eye(4))
