"""Metals: GGX microfacets with Fresnel's equations or Schlick's approximation, as Warp functions."""

import warp as wp

from clsim.render.bsdf_parts import Scattered, Scattering
from clsim.render.materials import Bsdf
from clsim.render.microfacet import (
    SMOOTH,
    fresnel_conductor,
    ggx,
    reflected,
    sample_visible_normal,
    schlick,
    smith_g1,
)


@wp.func
def conductor_fresnel(b: Bsdf, cos_i: float) -> wp.vec3:
    """Return the reflectance of a metal under one angle."""
    reflectance = schlick(cos_i, b.color)
    if b.complex_index != 0:
        reflectance = fresnel_conductor(cos_i, b.metal_eta, b.metal_k)
    return wp.cw_mul(reflectance, b.specular)


@wp.func
def conductor_value(b: Bsdf, wo: wp.vec3, wi: wp.vec3) -> Scattering:
    """Return f·cos θ and density of a rough metal; the two shadowings are taken as independent, as Mitsuba does."""
    result = Scattering()
    if wi[2] > 0.0 and b.alpha >= SMOOTH:
        h = wp.normalize(wo + wi)
        result.pdf = ggx(h, b.alpha) * smith_g1(wo, b.alpha) / (4.0 * wo[2])
        result.value = conductor_fresnel(b, wp.dot(wo, h)) * (result.pdf * smith_g1(wi, b.alpha))
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
        h = sample_visible_normal(wo, b.alpha, u)
        s.direction = reflected(wo, h)
        if s.direction[2] > 0.0:
            s.pdf = ggx(h, b.alpha) * smith_g1(wo, b.alpha) / (4.0 * wo[2])
            s.weight = conductor_fresnel(b, wp.dot(wo, h)) * smith_g1(s.direction, b.alpha)
    return s
