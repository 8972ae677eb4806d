# ruff: noqa: SIM102, UP018
"""Materials that are blends of others, as Warp functions.

A path takes one of them by chance, each as often as its share is, and nothing but that one scatters there; what planes
show is the mean of all. A blend is a chain: each material names one other, which may name a third. Where the other is
what the back shows, its share is all there and nothing in front.
"""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Surface
from clsim.render.features.features import Features
from clsim.render.sampling.sampling import luminance
from clsim.render.surfaces.materials import Materials
from clsim.render.textures.textures import make_textures

_STEPS = wp.constant(3)
"""Steps along a chain; what comes behind is left out."""
FIRST = wp.constant(2.0)
"""The chance that leaves the first of a chain."""
BEHIND = wp.constant(4.0)
"""The share of what the back shows: more than any chance."""


@wp.func
def mixes_textures(materials: Materials, material: int) -> bool:
    """Whether another of a blend has textures."""
    found = bool(False)
    other = int(materials.rows[material].blend_with)
    for _ in range(_STEPS):
        if other >= 0:
            row = materials.rows[other]
            found = found or row.texture >= 0 or row.roughness_texture >= 0 or row.blend_texture >= 0
            other = row.blend_with
    return found


def make_blends(features: Features, resolve: Any, albedos: Any) -> tuple[Any, Any]:
    """Return the Warp functions ``pick`` and ``mean_albedo``.

    ``pick(materials, surface, chance)`` gives the material that a path meets, for a number from 0 to 1;
    ``mean_albedo(materials, surface, cosine)`` the mean of the ``albedos(materials, bsdf, cosine) -> wp.vec4``.
    """
    lookup, *_ = make_textures(features)

    @wp.func
    def share_of_other(materials: Materials, material: int, point: Surface) -> float:
        row = materials.rows[material]
        share = row.blend_share
        if wp.static(features.textures):
            if row.blend_texture >= 0:
                rgba = lookup(materials.textures, row.blend_texture, point.uv)
                share = share * luminance(wp.vec3(rgba[0], rgba[1], rgba[2]))
        if row.blend_behind != 0:
            share = wp.where(point.front, 0.0, BEHIND)
        return wp.where(row.blend_with >= 0, share, 0.0)

    @wp.func
    def pick(materials: Materials, point: Surface, chance: float) -> int:
        material = int(point.material)
        left = float(chance)
        for _ in range(_STEPS):
            share = share_of_other(materials, material, point)
            if left < share:
                material = materials.rows[material].blend_with
                # What is left of the chance is even again.
                if share < BEHIND:
                    left = left / share
            else:
                left = FIRST
        return material

    @wp.func
    def mean_albedo(materials: Materials, point: Surface, cosine: float) -> wp.vec4:
        mean = wp.vec4()
        left = float(1.0)
        each = point
        for k in range(_STEPS + 1):
            share = wp.min(share_of_other(materials, each.material, point), 1.0)
            if k == _STEPS:
                share = 0.0
            if left > 0.0:
                mean += albedos(materials, resolve(materials, each), cosine) * (left * (1.0 - share))
            left = left * share
            if share > 0.0:
                each.material = materials.rows[each.material].blend_with
        return mean

    return pick, mean_albedo
