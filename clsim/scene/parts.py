"""What a file holds that may be a scene or part of one."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from clsim.scene.world import TEXTURES, Camera, Instance, Material, Mesh, PunctualLight, SphereLight, Texture


@dataclass(frozen=True)
class Parts:
    """Lists as those of a ``World``; indices of meshes, materials and textures count from the file's own first.

    Attributes:
        duration_s: length of the file's animation [s], 0 where it has none.
        warnings: what the file asks for and clsim lacks, one sentence each.
        notes: what was decided where the file leaves a choice, one sentence each.
    """

    meshes: list[Mesh]
    materials: list[Material]
    textures: list[Texture]
    instances: list[Instance]
    lights: list[PunctualLight] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    duration_s: float = 0.0
    warnings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    spheres: list[SphereLight] = field(default_factory=list)


def with_textures_from(material: Material, first: int) -> Material:
    """Return a material whose textures stand in a longer list, ``first`` places on."""
    if not first:
        return material
    places: dict[str, Any] = {name: getattr(material, name) for name in TEXTURES}
    return replace(material, **{name: index + first for name, index in places.items() if index >= 0})
