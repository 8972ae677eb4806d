# ruff: noqa: SIM102
"""Coats: how much light the base of a material sends out, how much what lies over it reflects, as Warp functions.

Light of both is cached separately, divided by an albedo of its own: what a dark base sends out is little beside a
reflection. Coats are those of plastic, and what Disney's and glTF's materials reflect over their base.
"""

from typing import Any

import warp as wp

from clsim.render.bsdf.disney import base_disney, reflection_disney
from clsim.render.bsdf.plastic import base_albedo, passing_out
from clsim.render.bsdf.principled import passing_principled
from clsim.render.features.bsdf_kinds import DISNEY, PLASTIC, PRINCIPLED
from clsim.render.features.features import Features
from clsim.render.surfaces.materials import BASE, REFLECTION, Bsdf, Materials


@wp.func
def is_coated(b: Bsdf) -> bool:
    """Whether a material reflects over a base; glass reflects and lets pass."""
    opaque = b.kind == PLASTIC or ((b.kind == PRINCIPLED or b.kind == DISNEY) and b.transmission == 0.0)
    return opaque and not b.dark


@wp.func
def base_color(b: Bsdf, albedo: wp.vec3) -> wp.vec3:
    """Return the albedo of a base for light from all sides; that of the whole where the coat does not change it."""
    color = albedo
    if b.kind == PLASTIC and not b.dark:
        color = base_albedo(b)
    return color


@wp.func
def one_part(whole: Bsdf, in_coat: bool, passing: float) -> Bsdf:
    """Return what reflects of a material alone, or its base alone, of which ``passing`` is the first of its shares.

    What has no coat is all base.
    """
    part = whole
    if not is_coated(whole):
        part.dark = whole.dark or in_coat
    elif whole.kind == DISNEY:
        part.part = wp.where(in_coat, REFLECTION, BASE)
    elif in_coat:
        part.color = wp.vec3()
        part.specular = whole.specular * (1.0 - whole.metallic)  # type: ignore[assignment]
        part.metallic = 0.0
    else:
        part.specular = wp.vec3()
        if whole.kind == PRINCIPLED:
            part.color = whole.color * passing  # type: ignore[assignment]
    if not in_coat:
        part.clearcoat = wp.where(is_coated(whole), 0.0, whole.clearcoat)
    return part


def make_coats(features: Features, albedo_of: Any) -> tuple[Any, Any]:
    """Return the Warp functions ``shares(materials, bsdf, cosine) -> wp.vec2`` and ``albedos(…) -> wp.vec4``.

    The first of ``shares`` is that of light from a white base that leaves at that angle, the second about what share of
    light from all sides the coat reflects there; 1 and 0 where there is no coat, or it is not cached separately.
    ``albedos`` are that of the base, and last that of the coat.
    """
    kinds = features.kinds

    @wp.func
    def shares(materials: Materials, b: Bsdf, cosine: float) -> wp.vec2:
        found = wp.vec2(1.0, 0.0)
        if wp.static(features.coats):
            if is_coated(b):
                if wp.static("plastic" in kinds):
                    if b.kind == PLASTIC:
                        found[0] = passing_out(materials.transmittance, b, cosine)
                if wp.static("principled" in kinds):
                    if b.kind == PRINCIPLED:
                        found[0] = passing_principled(b, cosine)
                found[1] = 1.0 - found[0]
                if wp.static("disney" in kinds):
                    if b.kind == DISNEY:
                        found = wp.vec2(base_disney(b, cosine), reflection_disney(materials, b, cosine))
        return found

    @wp.func
    def albedos(materials: Materials, b: Bsdf, cosine: float) -> wp.vec4:
        both = shares(materials, b, cosine)
        color = albedo_of(b)
        if wp.static(features.coats):
            color = base_color(b, color)
        color = color * both[0]
        return wp.vec4(color[0], color[1], color[2], both[1])

    return shares, albedos
