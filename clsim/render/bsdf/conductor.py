"""Metals: microfacets with Fresnel's equations or Schlick's approximation, as Warp functions."""

from typing import Any

import warp as wp

from clsim.render.bsdf.facets import make_facets
from clsim.render.bsdf.parts import Scattered, Scattering
from clsim.render.features.features import Features
from clsim.render.surfaces.materials import Bsdf
from clsim.render.surfaces.microfacet import SMOOTH, fresnel_conductor, reflected, schlick


@wp.func
def conductor_fresnel(b: Bsdf, cos_i: float) -> wp.vec3:
    """Return the reflectance of a metal under one angle."""
    reflectance = schlick(cos_i, b.color)
    if b.complex_index != 0:
        reflectance = fresnel_conductor(cos_i, b.metal_eta, b.metal_k)
    return wp.cw_mul(reflectance, b.specular)  # type: ignore[return-value]


def make_conductor(features: Features) -> tuple[Any, Any]:
    """Return the Warp functions ``conductor_value(bsdf, wo, wi)`` and ``conductor_sample(bsdf, wo, u)``."""
    draw, seen, shadowing = make_facets(features)

    @wp.func
    def conductor_value(b: Bsdf, wo: wp.vec3, wi: wp.vec3) -> Scattering:
        """Return f·cos θ and density of a rough metal; the two shadowings are taken as independent, as Mitsuba does."""
        result = Scattering()
        if wi[2] > 0.0 and b.alpha >= SMOOTH:
            h = wp.normalize(wo + wi)
            result.pdf = seen(b, wo, h) / (4.0 * wo[2])
            result.value = conductor_fresnel(b, wp.dot(wo, h)) * (result.pdf * shadowing(b, wi))
        return result

    @wp.func
    def conductor_sample(b: Bsdf, wo: wp.vec3, u: wp.vec2) -> Scattered:
        """Draw a direction in which a metal reflects."""
        s = Scattered()
        s.eta2 = 1.0
        if b.alpha < SMOOTH:
            s.direction = wp.vec3(-wo[0], -wo[1], wo[2])
            s.weight = conductor_fresnel(b, wo[2])
            s.delta = True
        else:
            h = draw(b, wo, u)
            s.direction = reflected(wo, h)
            if s.direction[2] > 0.0:
                s.pdf = seen(b, wo, h) / (4.0 * wo[2])
                s.weight = conductor_fresnel(b, wp.dot(wo, h)) * shadowing(b, s.direction)
        return s

    return conductor_value, conductor_sample
