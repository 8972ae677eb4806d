# ruff: noqa: SIM102
"""The microfacets of metals, glass and coats: GGX's, Beckmann's, and rougher along one tangent, as Warp functions."""

from typing import Any

import warp as wp

from clsim.render.features.features import Features
from clsim.render.surfaces.materials import Bsdf
from clsim.render.surfaces.microfacet import (
    beckmann,
    beckmann_g1,
    evened,
    ggx,
    sample_visible_beckmann,
    sample_visible_normal,
    smith_g1,
)


def make_facets(features: Features) -> tuple[Any, Any, Any]:
    """Return the Warp functions ``draw``, ``seen`` and ``shadowing``, in the frame of the shading normal.

    ``draw(bsdf, wo, u)`` gives a microfacet's normal, and ``seen(bsdf, wo, h)`` its density times wo.z / (wo·h).
    ``shadowing(bsdf, wi)`` is the share of them that the other direction sees as well.
    """

    @wp.func
    def even(b: Bsdf, w: wp.vec3) -> wp.vec3:
        """Return a direction in the frame where roughness is the same along both tangents."""
        if wp.static(features.anisotropic):
            return evened(w, b.stretch)
        return w

    @wp.func
    def even_normal(b: Bsdf, h: wp.vec3) -> wp.vec3:
        if wp.static(features.anisotropic):
            return evened(h, 1.0 / b.stretch)
        return h

    @wp.func
    def draw(b: Bsdf, wo: wp.vec3, u: wp.vec2) -> wp.vec3:
        h = sample_visible_normal(even(b, wo), b.alpha, u)
        if wp.static(features.beckmann):
            if b.beckmann != 0:
                h = sample_visible_beckmann(even(b, wo), b.alpha, u)
        if wp.static(features.anisotropic):
            h = wp.normalize(evened(h, b.stretch))  # type: ignore[assignment]
        return h

    @wp.func
    def shadowing(b: Bsdf, w: wp.vec3) -> float:
        share = smith_g1(even(b, w), b.alpha)
        if wp.static(features.beckmann):
            if b.beckmann != 0:
                share = beckmann_g1(even(b, w), b.alpha)
        return share

    @wp.func
    def seen(b: Bsdf, wo: wp.vec3, h: wp.vec3) -> float:
        density = ggx(even_normal(b, h), b.alpha)
        if wp.static(features.beckmann):
            if b.beckmann != 0:
                density = beckmann(even_normal(b, h), b.alpha)
        return density * shadowing(b, wo)

    return draw, seen, shadowing
