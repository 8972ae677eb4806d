"""Properties of a world's lights that select how direct light is found."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.render.motion.deform import deforms
from clsim.scene import Motion, PunctualLight, SphereLight, World

FEW_LAMPS = 8
"""Lamps, each triangle by itself, whose light is still added up for each point that a pixel shows: of twelve, rooms
with soft shadows take up to twice as long as with light of lamps in the cache."""
_ALIKE = 4
"""Lamps at most of which power tells well enough how much each may send, though they move."""
_FAR_M = 1.0e5
"""Stands for the distance of what shines in parallel."""
_SHARP_DEG = 1.0
"""How wide the edge of a spot's cone is at least where its light is asked for once a pixel."""


def still_lamps(world: World) -> bool:
    """Whether no triangle that emits moves or deforms, or has a texture that matters to its light."""
    return not _lamps_are_textured(world) and not _triangles_that_emit_move(world)


def _lamps_are_textured(world: World) -> bool:
    return any(
        max(material.emission) > 0 and (material.emission_texture >= 0 or material.alpha_mode != "opaque")
        for material in world.materials
    )


def few_lamps(world: World) -> bool:
    """Whether there are some lamps but not many, whose light hardly changes within a pixel but for shadows."""
    plain = not _lamps_are_textured(world) and not _lamps_show_pictures(world)
    return plain and 0 < _lamps(world) <= FEW_LAMPS


def _lamps_show_pictures(world: World) -> bool:
    """Whether a light without size has a picture, or a frame or a cone where its light ends at once."""
    return any(light.picture >= 0 or light.falloff == "frame" or _is_sharp(light) for light in world.punctual_lights)


def _is_sharp(light: PunctualLight) -> bool:
    return light.kind == "spot" and light.outer_deg - light.inner_deg < _SHARP_DEG


def _lamps(world: World) -> int:
    """Return how many triangles emit, and how many other lights there are but the environment."""
    emits = np.array([max(material.emission) > 0 for material in world.materials], bool)
    triangles = (np.count_nonzero(emits[world.meshes[i.mesh].material_ids]) for i in world.instances if len(emits))
    return sum(map(int, triangles)) + len(world.sphere_lights) + len(world.punctual_lights)


def _triangles_that_emit_move(world: World) -> bool:
    moving = {i.mesh for i in world.instances if i.motion.duration_s > 0 or deforms(world.meshes[i.mesh])}
    return any(_emits(world, mesh) for mesh in moving)


def _emits(world: World, mesh: int) -> bool:
    return any(max(world.materials[k].emission) > 0 for k in np.unique(world.meshes[mesh].material_ids))


def lamp_motions(world: World) -> tuple[list[Motion], bool]:
    """Return the motions of all that moves and shines, and whether any of it deforms."""
    small: tuple[SphereLight | PunctualLight, ...] = (*world.sphere_lights, *world.punctual_lights)
    shining = [instance for instance in world.instances if _emits(world, instance.mesh)]
    motions = [each.motion for each in (*small, *shining) if each.motion.duration_s > 0]
    return motions, any(deforms(world.meshes[instance.mesh]) for instance in shining)


def lamps_move(world: World) -> bool:
    """Whether something moves, or deforms, that shines."""
    motions, deform = lamp_motions(world)
    return bool(motions) or deform


def tree_follows(world: World) -> bool:
    """Whether the light tree holds lights that move too: where they are so many that power is a poor guide."""
    return _lamps(world) > _ALIKE


def in_light_tree(light: SphereLight | PunctualLight, follows: bool) -> bool:
    """Whether a light has a place that a tree may know; ``follows`` says that those which move are held too."""
    directional = isinstance(light, PunctualLight) and light.kind == "directional"
    return (follows or light.motion.duration_s == 0) and not directional


def several_lights_of_a_tree(world: World) -> bool:
    """Whether there are several lights that a tree would hold; the two triangles of a panel are one light."""
    follows = tree_follows(world)
    lamps = np.array([max(material.emission) > 0 for material in world.materials], bool)
    triangles = 0
    for instance in world.instances:
        mesh = world.meshes[instance.mesh]
        if len(lamps) and (follows or instance.motion.duration_s == 0) and not deforms(mesh):
            triangles += int(np.count_nonzero(lamps[mesh.material_ids]))
    small: tuple[SphereLight | PunctualLight, ...] = (*world.sphere_lights, *world.punctual_lights)
    others = sum(in_light_tree(light, follows) for light in small)
    return triangles > 2 or (triangles > 0) + others > 1


class LampBoxes:
    """Boxes around the few lamps whose direct light is analytic."""

    def __init__(self, world: World) -> None:
        """Find them; many lamps are none of these."""
        self._small: tuple[SphereLight | PunctualLight, ...] = ()
        self._shining: list[tuple[Motion, npt.NDArray[np.float64]]] = []
        if few_lamps(world):
            self._small = (*world.sphere_lights, *world.punctual_lights)
            emits = np.array([max(material.emission) > 0 for material in world.materials], bool)
            for instance in world.instances:
                mesh = world.meshes[instance.mesh]
                corners = mesh.triangles[emits[mesh.material_ids]] if len(emits) else mesh.triangles[:0]
                self._shining += [(instance.motion, mesh.vertices[three].astype(np.float64)) for three in corners]

    def at(
        self, time_s: float, origin_m: npt.NDArray[np.float64]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
        """Return corners ``[n, 3]`` of the boxes at a time, from the origin, and which of them are far away.

        Of these, whose light comes in parallel, they tell how far away they are from any place, and in which direction.
        """
        lower, upper, is_far = [], [], []
        for light in self._small:
            pose = light.motion.pose(time_s)
            is_far.append(isinstance(light, PunctualLight) and light.kind == "directional")
            place = pose[:3, 2] * _FAR_M if is_far[-1] else pose[:3, 3] - origin_m
            radius_m = light.radius_m if isinstance(light, SphereLight) else 0.0
            lower.append(place - radius_m)
            upper.append(place + radius_m)
        for motion, corners in self._shining:
            pose = motion.pose(time_s)
            placed = corners @ pose[:3, :3].T + pose[:3, 3] - origin_m
            lower.append(placed.min(axis=0))
            upper.append(placed.max(axis=0))
            is_far.append(False)
        return np.reshape(lower, (-1, 3)), np.reshape(upper, (-1, 3)), np.array(is_far, np.bool_)
