# ruff: noqa: UP018
"""Glass: smooth and rough interfaces that reflect and refract, and thin panes, as Warp functions.

Walter et al., Microfacet Models for Refraction, EGSR 2007. A material's color multiplies what passes, its specular
color what is reflected.
"""

from typing import Any

import warp as wp

from clsim.render.bsdf.facets import make_facets
from clsim.render.bsdf.parts import Scattered, Scattering
from clsim.render.features.features import Features
from clsim.render.surfaces.materials import Bsdf
from clsim.render.surfaces.microfacet import SMOOTH, fresnel_dielectric, reflected, refracted


def make_dielectric(features: Features) -> tuple[Any, Any]:
    """Return the Warp functions ``dielectric_value(bsdf, wo, wi)`` and ``dielectric_sample(bsdf, wo, choice, u)``."""
    draw, seen, shadowing = make_facets(features)

    @wp.func
    def dielectric_value(b: Bsdf, wo: wp.vec3, wi: wp.vec3) -> Scattering:
        """Return f·cos θ and density of rough glass (Walter et al., eq. 20 and 21), for radiance."""
        result = Scattering()
        if b.alpha >= SMOOTH and wi[2] != 0.0:
            if wi[2] > 0.0:
                h = wp.normalize(wo + wi)
                reflectance = fresnel_dielectric(wp.dot(wo, h), b.eta)[0]
                visible = seen(b, wo, h) / wo[2]
                result.pdf = 0.25 * visible * reflectance
                result.value = b.specular * (result.pdf * shadowing(b, wi))
            else:
                h = wo + wi * b.eta
                length = wp.length(h)
                # Without a difference of indices there is no microfacet between the two directions.
                if length > 1.0e-6:
                    h = h * (wp.sign(h[2]) / length)
                    out_h = wp.dot(wo, h)
                    in_h = wp.dot(wi, h)
                    if out_h > 0.0 and in_h < 0.0:
                        passing = 1.0 - fresnel_dielectric(out_h, b.eta)[0]
                        denominator = out_h + b.eta * in_h
                        visible = seen(b, wo, h) * out_h / wo[2]
                        density = visible * passing * (-in_h) / (denominator * denominator)
                        result.pdf = density * b.eta * b.eta
                        result.value = b.color * (density * shadowing(b, wi))
        return result

    @wp.func
    def dielectric_sample(b: Bsdf, wo: wp.vec3, choice: float, u: wp.vec2) -> Scattered:
        """Draw reflection or refraction, by Fresnel's reflectance of the microfacet drawn before."""
        s = Scattered()
        s.eta2 = 1.0
        h = wp.vec3(0.0, 0.0, 1.0)
        rough = b.alpha >= SMOOTH
        if rough:
            h = draw(b, wo, u)
        out_h = wp.dot(wo, h)
        f = fresnel_dielectric(out_h, b.eta)
        s.delta = not rough
        left = float(1.0)
        if choice < f[0]:
            s.direction = reflected(wo, h)
            if s.direction[2] > 0.0:
                if rough:
                    left = shadowing(b, s.direction)
                    s.pdf = 0.25 * seen(b, wo, h) / wo[2] * f[0]
                s.weight = b.specular * left
        else:
            s.direction = refracted(wo, h, f[1], b.eta)
            if s.direction[2] < 0.0:
                s.eta2 = b.eta * b.eta
                if rough:
                    left = shadowing(b, s.direction)
                    in_h = wp.dot(s.direction, h)
                    denominator = out_h + b.eta * in_h
                    visible = seen(b, wo, h) * out_h / wo[2]
                    # Where the indices are nearly equal, all light goes straight on and the density has no bound.
                    s.pdf = visible * (1.0 - f[0]) * (-in_h) * s.eta2 / wp.max(denominator * denominator, 1.0e-20)
                s.weight = b.color * (left / s.eta2)
        return s

    return dielectric_value, dielectric_sample


@wp.func
def thin_sample(b: Bsdf, wo: wp.vec3, choice: float) -> Scattered:
    """Draw reflection by a pane or the way straight through, reflections between its faces summed up."""
    s = Scattered()
    s.eta2 = 1.0
    s.delta = True
    once = fresnel_dielectric(wo[2], b.eta)[0]
    # R + T²R + T²R³ + … with T = 1 − R
    if choice < 2.0 * once / (1.0 + once):
        s.direction = wp.vec3(-wo[0], -wo[1], wo[2])
        s.weight = b.specular
    else:
        s.direction = -wo
        s.weight = b.color
    return s
