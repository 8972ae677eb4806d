# ruff: noqa: UP018
"""Disney's model as Mitsuba 3's ``principled`` has it, as Warp functions.

Burley, Physically Based Shading at Disney, SIGGRAPH 2012, and Extending the Disney BRDF to a BSDF, SIGGRAPH 2015:
a diffuse base with retro-reflection, sheen, a specular lobe of GGX that is metal, tinted or clear, glass behind it
(Walter et al., EGSR 2007), and a clear coat of GTR1. Seen from inside, only the glass is there.
"""

import warp as wp

from clsim.render.bsdf.parts import Scattered, Scattering
from clsim.render.sampling.sampling import around, cosine_hemisphere, luminance
from clsim.render.surfaces.materials import BASE, REFLECTION, Bsdf, MaterialRow, Materials
from clsim.render.surfaces.microfacet import (
    SMOOTH,
    evened,
    fresnel_dielectric,
    ggx,
    reflected,
    refracted,
    sample_visible_normal,
    schlick,
    smith_g1,
)

_COAT_F0 = wp.constant(0.04)
_COAT_SHARE = wp.constant(0.25)
_COAT_SHADOWING = wp.constant(0.25)
"""The α by which the coat's microfacets hide each other, whatever its gloss."""


@wp.struct
class DisneyLobes:
    """Probabilities with which each lobe is drawn."""

    coat: float
    specular: float
    diffuse: float


@wp.func
def _weight(cosine: float) -> float:
    """Return Schlick's (1 − cos)⁵."""
    m = wp.clamp(1.0 - cosine, 0.0, 1.0)
    m2 = m * m
    return m2 * m2 * m


@wp.func
def _hue(color: wp.vec3) -> wp.vec3:
    """Return a colour at a luminance of 1; white for black."""
    light = luminance(color)
    hue = wp.vec3(1.0, 1.0, 1.0)
    if light > 0.0:
        hue = color / light
    return hue


@wp.func
def _inside(b: Bsdf) -> bool:
    # The loaders keep the index over 1, so that less than 1 is the inside.
    return b.eta < 1.0


@wp.func
def _reflectance(row: MaterialRow, b: Bsdf, cosine: float) -> wp.vec3:
    """Return the specular lobe's Fresnel term: metal, tinted and clear dielectric outside, clear glass inside."""
    clear = fresnel_dielectric(cosine, b.eta)[0]
    color = wp.vec3(clear, clear, clear) * (b.transmission * (1.0 - b.metallic))
    if not _inside(b):
        r = (b.eta - 1.0) / (b.eta + 1.0)
        tinted = schlick(cosine, _hue(b.color) * (r * r)) * row.specular_tint
        plain = clear * (1.0 - row.specular_tint)
        color = (tinted + wp.vec3(plain, plain, plain)) * (1.0 - b.metallic)
        metal = schlick(cosine, b.color) * b.metallic
        if b.part == BASE:
            color = metal
        elif b.part != REFLECTION:
            color += metal
    return color


@wp.func
def _passing(b: Bsdf, cosine: float) -> float:
    """Return about what the glass lets pass, its colour's luminance included."""
    glass = b.transmission * (1.0 - b.metallic) * wp.sqrt(luminance(b.color))
    return glass * (1.0 - fresnel_dielectric(cosine, b.eta)[0])


@wp.func
def _mirrored(row: MaterialRow, b: Bsdf, cosine: float) -> float:
    """Return the probability with which a microfacet reflects rather than refracts."""
    light = luminance(_reflectance(row, b, cosine))
    return light / wp.max(light + _passing(b, cosine), 1.0e-20)


@wp.func
def _lobes(row: MaterialRow, b: Bsdf, wo: wp.vec3) -> DisneyLobes:
    lobes = DisneyLobes()
    lobes.specular = luminance(_reflectance(row, b, wo[2])) + _passing(b, wo[2])
    if not _inside(b):
        lobes.coat = _COAT_SHARE * b.clearcoat * (_COAT_F0 + (1.0 - _COAT_F0) * _weight(wo[2]))
        base = (1.0 - b.transmission) * luminance(b.color) * wp.where(b.part == REFLECTION, 0.0, 1.0)
        sheen = row.sheen * _weight(wo[2]) * wp.where(b.part == BASE, 0.0, 1.0)
        lobes.diffuse = (1.0 - b.metallic) * (base + sheen)
    total = wp.max(lobes.coat + lobes.specular + lobes.diffuse, 1.0e-20)
    lobes.coat = lobes.coat / total
    lobes.specular = lobes.specular / total
    lobes.diffuse = lobes.diffuse / total
    return lobes


@wp.func
def _base(row: MaterialRow, b: Bsdf, wo: wp.vec3, wi: wp.vec3, h: wp.vec3) -> wp.vec3:
    """Return f·cos θ of the diffuse base, its retro-reflection, flatness and sheen."""
    out = _weight(wo[2])
    in_ = _weight(wi[2])
    half_way = wp.dot(wi, h)
    retro = 2.0 * wp.sqrt(wp.max(b.alpha, SMOOTH)) * half_way * half_way
    round_ = (1.0 - 0.5 * out) * (1.0 - 0.5 * in_) + retro * (out + in_ + out * in_ * (retro - 1.0))
    beneath = (1.0 + (0.5 * retro - 1.0) * out) * (1.0 + (0.5 * retro - 1.0) * in_)
    flat = 1.25 * (beneath * (1.0 / (wo[2] + wi[2]) - 0.5) + 0.5)
    base = b.color * ((1.0 - b.transmission) * wp.lerp(round_, flat, row.flatness) / wp.pi)
    cloth = wp.lerp(wp.vec3(1.0, 1.0, 1.0), _hue(b.color), row.sheen_tint) * (row.sheen * _weight(half_way))
    sent = base + cloth
    if b.part == BASE:
        sent = base
    elif b.part == REFLECTION:
        sent = cloth
    return sent * ((1.0 - b.metallic) * wi[2])


@wp.func
def base_disney(b: Bsdf, cosine: float) -> float:
    """Return the share of white light from all around that a white base sends in a direction; metal counts as base.

    It is the integral of `_base` without flatness: that of 2 c (1 − c)⁵ cᵏ is 1/21, 1/84, 1/252 for k = 0, 1, 2.
    """
    c = wp.clamp(cosine, 0.0, 1.0)
    out = _weight(c)
    rough = wp.sqrt(wp.max(b.alpha, SMOOTH))
    once = rough * (1.0 / 21.0 + c / 84.0)
    twice = rough * rough * (1.0 / 21.0 + c / 42.0 + c * c / 252.0 + 0.5 * (1.0 - c * c) * (1.0 / 21.0 - 1.0 / 252.0))
    round_ = (1.0 - 0.5 * out) * (41.0 / 42.0) + rough * out * (1.0 + 2.0 / 3.0 * c) + once + out * (twice - once)
    return wp.lerp(round_, 1.0, b.metallic)


@wp.func
def reflection_disney(materials: Materials, b: Bsdf, cosine: float) -> float:
    """Return about the share of white light from all around that the rest sends in a direction, of glass nothing.

    How it changes with the angle is what counts, as cells remember light from other angles. Sheen is .088 (1 − cos)²
    within .01; facets are Fresnel's term at a steeper angle, by how rough they are, within two fifths.
    """
    row = materials.rows[b.row]
    c = wp.clamp(cosine, 0.0, 1.0)
    steeper = c + 0.6 * wp.sqrt(b.alpha) * (1.0 - 0.3 * b.alpha) * (1.0 - c)
    clear = fresnel_dielectric(steeper, b.eta)[0] + 0.088 * row.sheen * (1.0 - c) * (1.0 - c)
    coat = _COAT_SHARE * b.clearcoat * (_COAT_F0 + (1.0 - _COAT_F0) * _weight(c))
    return clear * (1.0 - b.metallic) + coat


@wp.func
def _coat_alpha2(b: Bsdf) -> float:
    """Return α² of the coat, within what GTR1 can be."""
    alpha = wp.clamp(b.clearcoat_alpha, SMOOTH, 0.99)
    return alpha * alpha


@wp.func
def _gtr1(h: wp.vec3, a2: float) -> float:
    """Return D(h) of GTR1 (Burley 2012, appendix B), the sine taken as it is so that narrow lobes lose no digits."""
    spread = h[0] * h[0] + h[1] * h[1] + a2 * h[2] * h[2]
    return (a2 - 1.0) / (wp.pi * wp.log(a2) * spread)


@wp.func
def disney_value(materials: Materials, b: Bsdf, wo: wp.vec3, wi: wp.vec3) -> Scattering:
    """Return f·cos θ and density; no lobe is a mirror."""
    row = materials.rows[b.row]
    alpha = wp.max(b.alpha, SMOOTH)
    result = Scattering()
    h = wo + wi * wp.where(wi[2] > 0.0, 1.0, b.eta)
    length = wp.length(h)
    if wi[2] != 0.0 and length > 1.0e-6:
        h = h * (wp.where(h[2] < 0.0, -1.0, 1.0) / length)
        lobes = _lobes(row, b, wo)
        out_h = wp.dot(wo, h)
        in_h = wp.dot(wi, h)
        seen = ggx(evened(h, 1.0 / row.stretch), alpha) * smith_g1(evened(wo, row.stretch), alpha) / wo[2]
        both = seen * smith_g1(evened(wi, row.stretch), alpha)
        if wi[2] > 0.0:
            result.value = _reflectance(row, b, out_h) * (0.25 * both)
            result.pdf = lobes.specular * _mirrored(row, b, out_h) * 0.25 * seen
            if not _inside(b):
                result.value += _base(row, b, wo, wi, h)
                result.pdf += lobes.diffuse * wi[2] / wp.pi
                if b.clearcoat > 0.0:
                    d = _gtr1(h, _coat_alpha2(b))
                    shadowing = smith_g1(wo, _COAT_SHADOWING) * smith_g1(wi, _COAT_SHADOWING)
                    fresnel = _COAT_F0 + (1.0 - _COAT_F0) * _weight(out_h)
                    share = _COAT_SHARE * b.clearcoat * fresnel * d * shadowing * wi[2]
                    result.value += wp.vec3(share, share, share)
                    result.pdf += lobes.coat * d * h[2] / (4.0 * out_h)
        elif out_h > 0.0 and in_h < 0.0:
            denominator = out_h + b.eta * in_h
            turned = out_h * (-in_h) / wp.max(denominator * denominator, 1.0e-20)
            passing = b.transmission * (1.0 - b.metallic) * (1.0 - fresnel_dielectric(out_h, b.eta)[0])
            root = wp.vec3(wp.sqrt(b.color[0]), wp.sqrt(b.color[1]), wp.sqrt(b.color[2]))
            result.value = root * (passing * both * turned)
            result.pdf = lobes.specular * (1.0 - _mirrored(row, b, out_h)) * seen * turned * b.eta * b.eta
    return result


@wp.func
def disney_sample(materials: Materials, b: Bsdf, wo: wp.vec3, choice: float, u: wp.vec2) -> Scattered:
    """Draw a lobe by about the light that it returns, and a direction of that lobe."""
    row = materials.rows[b.row]
    s = Scattered()
    s.eta2 = 1.0
    lobes = _lobes(row, b, wo)
    through = bool(False)
    if choice < lobes.diffuse:
        s.direction = cosine_hemisphere(wp.vec3(0.0, 0.0, 1.0), u)
    elif choice < lobes.diffuse + lobes.coat:
        a2 = _coat_alpha2(b)
        z2 = wp.clamp((1.0 - wp.pow(a2, 1.0 - u[1])) / (1.0 - a2), 0.0, 1.0)
        radius = wp.sqrt(1.0 - z2)
        turned = around(u[0])
        s.direction = reflected(wo, wp.vec3(radius * turned[0], radius * turned[1], wp.sqrt(z2)))
    else:
        drawn = sample_visible_normal(evened(wo, row.stretch), wp.max(b.alpha, SMOOTH), u)
        h = wp.normalize(evened(drawn, row.stretch))
        left = (choice - lobes.diffuse - lobes.coat) / wp.max(lobes.specular, 1.0e-20)
        if left < _mirrored(row, b, wp.dot(wo, h)):
            s.direction = reflected(wo, h)
        else:
            through = True
            f = fresnel_dielectric(wp.dot(wo, h), b.eta)
            if f[1] > 0.0:
                s.direction = refracted(wo, h, f[1], b.eta)
                s.eta2 = b.eta * b.eta
    # Light that a rough lobe would send to the wrong side is lost.
    if (s.direction[2] > 0.0 and not through) or (s.direction[2] < 0.0 and through):
        found = disney_value(materials, b, wo, s.direction)
        s.pdf = found.pdf
        if found.pdf > 0.0:
            s.weight = found.value / found.pdf
    return s
