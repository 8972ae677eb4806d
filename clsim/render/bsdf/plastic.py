# ruff: noqa: UP018
"""Plastic: a dielectric coat over a diffuse base, as Mitsuba's plastic and roughplastic, as Warp functions."""

from typing import Any

import warp as wp

from clsim.render.bsdf.facets import make_facets
from clsim.render.bsdf.parts import Outgoing, Scattered, Scattering
from clsim.render.features.features import Features
from clsim.render.sampling.sampling import cosine_hemisphere, luminance
from clsim.render.surfaces.materials import Bsdf, Materials
from clsim.render.surfaces.microfacet import SMOOTH, fresnel_dielectric, reflected
from clsim.render.surfaces.plastic_tables import TABLE_SIZE

_LAST = wp.constant(TABLE_SIZE - 1)


@wp.func
def _passing(transmittance: wp.array[float], b: Bsdf, cosine: float) -> float:
    """Return the share of light that the coat lets through from one direction."""
    share = float(0.0)
    if b.alpha < SMOOTH:
        share = 1.0 - fresnel_dielectric(cosine, b.eta)[0]
    else:
        x = wp.clamp(cosine, 0.0, 1.0) * float(_LAST)
        i = wp.min(int(x), _LAST - 1)
        first = b.table + i
        share = wp.lerp(transmittance[first], transmittance[first + 1], x - float(i))
        if b.table_share > 0.0:
            rougher = wp.lerp(transmittance[first + TABLE_SIZE], transmittance[first + TABLE_SIZE + 1], x - float(i))
            share = wp.lerp(share, rougher, b.table_share)
    return share


@wp.func
def _coat_probability(b: Bsdf, passing: float) -> float:
    coat = (1.0 - passing) * luminance(b.specular)
    return coat / wp.max(coat + passing * luminance(b.color), 1.0e-20)


@wp.func
def base_albedo(b: Bsdf) -> wp.vec3:
    """Return the share of white light passing the coat that the base sends back to it, and that then passes it again.

    It is that of the mean over directions.
    """
    inner = wp.vec3(1.0, 1.0, 1.0) - wp.where(b.nonlinear != 0, b.color, wp.vec3(1.0, 1.0, 1.0)) * b.inner
    return wp.cw_div(b.color, inner) * (1.0 - b.inner)


@wp.func
def passing_in(materials: Materials, material: int, cosine: float) -> float:
    """Return how much more light from a direction passes the coat of a plastic than passes of light from all sides.

    Of the base's albedo, which is that for light from all sides, it makes that for light from there.
    """
    row = materials.rows[material]
    b = Bsdf()
    b.alpha = row.alpha
    b.eta = row.ior
    b.table = row.table
    return _passing(materials.transmittance, b, cosine) / (row.ior * row.ior * (1.0 - row.inner))


@wp.func
def passing_out(transmittance: wp.array[float], b: Bsdf, cosine: float) -> float:
    """Return the share of light from the base that passes the coat in a direction."""
    return _passing(transmittance, b, cosine)


def make_plastic(features: Features) -> tuple[Any, Any, Any]:
    """Return the Warp functions ``leaving_plastic``, ``plastic_value`` and ``plastic_sample``."""
    draw, seen, shadowing = make_facets(features)

    @wp.func
    def leaving_plastic(transmittance: wp.array[float], b: Bsdf, out: Outgoing) -> Outgoing:
        """Return the way with what plastic needs of it."""
        found = out
        found.passing = _passing(transmittance, b, out.wo[2])
        found.coat = _coat_probability(b, found.passing)
        inner = wp.vec3(1.0, 1.0, 1.0) - wp.where(b.nonlinear != 0, b.color, wp.vec3(1.0, 1.0, 1.0)) * b.inner
        found.below = wp.cw_div(b.color, inner)
        return found

    @wp.func
    def plastic_value(transmittance: wp.array[float], b: Bsdf, out: Outgoing, wi: wp.vec3) -> Scattering:
        """Return f·cos θ and density of plastic, without the coat where that is a mirror."""
        result = Scattering()
        if wi[2] > 0.0:
            lambert = wi[2] / wp.pi
            scale = out.passing * _passing(transmittance, b, wi[2]) * lambert / (b.eta * b.eta)
            result.value = out.below * scale
            result.pdf = (1.0 - out.coat) * lambert
            if b.alpha >= SMOOTH:
                h = wp.normalize(out.wo + wi)
                density = seen(b, out.wo, h) / (4.0 * out.wo[2])
                reflectance = fresnel_dielectric(wp.dot(out.wo, h), b.eta)[0]
                result.value += b.specular * (density * shadowing(b, wi) * reflectance)
                result.pdf += out.coat * density
        return result

    @wp.func
    def plastic_sample(transmittance: wp.array[float], b: Bsdf, out: Outgoing, choice: float, u: wp.vec2) -> Scattered:
        """Draw the coat or the base, by the light that they return."""
        s = Scattered()
        s.eta2 = 1.0
        if choice < out.coat and b.alpha < SMOOTH:
            s.direction = wp.vec3(-out.wo[0], -out.wo[1], out.wo[2])
            s.weight = b.specular * (fresnel_dielectric(out.wo[2], b.eta)[0] / out.coat)
            s.delta = True
        else:
            if choice < out.coat:
                s.direction = reflected(out.wo, draw(b, out.wo, u))
            else:
                s.direction = cosine_hemisphere(wp.vec3(0.0, 0.0, 1.0), u)
            both = plastic_value(transmittance, b, out, s.direction)
            s.pdf = both.pdf
            if both.pdf > 0.0:
                s.weight = both.value / both.pdf
        return s

    return leaving_plastic, plastic_value, plastic_sample
