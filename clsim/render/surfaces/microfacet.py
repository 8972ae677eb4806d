# ruff: noqa: UP018
"""Microfacets: the distributions GGX and Beckmann, Smith's shadowing and Fresnel's equations, as Warp functions.

Directions are in the frame of the shading normal, z up; ``wo`` points to where light leaves for (the viewer), ``wi`` to
where it comes from, both away from the surface. Walter et al., Microfacet Models for Refraction, EGSR 2007.
"""

import warp as wp

from clsim.render.sampling.sampling import around

SMOOTH = wp.constant(1.0e-3)
"""A lobe with a smaller α is a perfect mirror (or perfectly smooth glass)."""


@wp.func
def ggx(h: wp.vec3, alpha: float) -> float:
    """Return D(h) of GGX [sr⁻¹] (Walter et al., eq. 33), arranged so that narrow lobes lose no digits."""
    a2 = alpha * alpha
    spread = (h[0] * h[0] + h[1] * h[1]) / a2 + h[2] * h[2]
    return 1.0 / (wp.pi * a2 * spread * spread)


@wp.func
def smith_lambda(w: wp.vec3, alpha: float) -> float:
    """Return Λ(w) of GGX (Heitz, JCGT 3(2), 2014, eq. 72)."""
    tan2 = (w[0] * w[0] + w[1] * w[1]) / wp.max(w[2] * w[2], 1.0e-12)
    return 0.5 * (wp.sqrt(1.0 + alpha * alpha * tan2) - 1.0)


@wp.func
def smith_g1(w: wp.vec3, alpha: float) -> float:
    """Return the share of microfacets that a direction on either side sees."""
    return 1.0 / (1.0 + smith_lambda(w, alpha))


@wp.func
def beckmann(h: wp.vec3, alpha: float) -> float:
    """Return D(h) of Beckmann [sr⁻¹] (Walter et al., eq. 25)."""
    a2 = alpha * alpha
    z2 = wp.max(h[2] * h[2], 1.0e-12)
    return wp.exp(-(h[0] * h[0] + h[1] * h[1]) / (a2 * z2)) / (wp.pi * a2 * z2 * z2)


@wp.func
def beckmann_g1(w: wp.vec3, alpha: float) -> float:
    """Return Beckmann's ``smith_g1`` by the rational fit of Walter et al. (eq. 27), good to .35 %."""
    tan2 = (w[0] * w[0] + w[1] * w[1]) / wp.max(w[2] * w[2], 1.0e-12)
    a2 = 1.0 / wp.max(alpha * alpha * tan2, 1.0e-20)
    share = float(1.0)
    if a2 < 2.56:
        a = wp.sqrt(a2)
        share = (3.535 * a + 2.181 * a2) / (1.0 + 2.276 * a + 2.577 * a2)
    return share


@wp.func
def sample_visible_normal(wo: wp.vec3, alpha: float, u: wp.vec2) -> wp.vec3:
    """Draw a microfacet normal with density D·G1(wo)·max(wo·h, 0) / wo.z (Dupuy and Benyoub, HPG 2023)."""
    stretched = wp.normalize(wp.vec3(alpha * wo[0], alpha * wo[1], wo[2]))
    turned = around(u[0])
    z = (1.0 - u[1]) * (1.0 + stretched[2]) - stretched[2]
    radius = wp.sqrt(wp.max(1.0 - z * z, 0.0))
    h = wp.vec3(radius * turned[0], radius * turned[1], z) + stretched
    return wp.normalize(wp.vec3(alpha * h[0], alpha * h[1], wp.max(h[2], 1.0e-7)))


_FURTHEST = wp.constant(0.999999)
"""The error function of the steepest slope that is drawn from Beckmann's distribution, 3.46 α."""
_NEWTON_STEPS = wp.constant(5)


@wp.func
def _visible_slope(cot: float, u: float) -> float:
    """Draw the slope, of α 1, along a direction whose cotangent is ``cot``, from the visible ones of Beckmann.

    Up to the slope x their share grows as (1 + erf x) / 2 + e^(−x²) / (2 √π cot), which is inverted by Newton's method
    in erf x: there it bends to one side alone (Heitz and d'Eon, Importance Sampling Microfacet-Based BSDFs using the
    Distribution of Visible Normals, EGSR 2014).
    """
    tan = 1.0 / cot
    beyond = tan / (2.0 * wp.sqrt(wp.pi))
    low = float(-_FURTHEST)
    edge = wp.erf(cot)
    high = wp.min(edge, _FURTHEST)
    whole = 0.5 * (1.0 + edge) + beyond * wp.exp(-cot * cot)
    # Straight from above, and bent as a square root from the side.
    b = low + (high - low) * (1.0 - wp.pow(1.0 - u, 1.0 / (1.0 + tan / wp.sqrt(1.0 + tan * tan))))
    x = wp.erfinv(b)
    for _ in range(_NEWTON_STEPS):
        off = 0.5 * (1.0 + b) + beyond * wp.exp(-x * x) - u * whole
        if wp.abs(off) < 1.0e-5 * whole:
            break
        if off > 0.0:
            high = b
        else:
            low = b
        b = b - off / wp.max(0.5 * (1.0 - x * tan), 1.0e-6)
        if b < low or b > high:
            b = 0.5 * (low + high)
        x = wp.erfinv(b)
    return x


@wp.func
def sample_visible_beckmann(wo: wp.vec3, alpha: float, u: wp.vec2) -> wp.vec3:
    """Draw a microfacet normal as ``sample_visible_normal`` does, of Beckmann's distribution."""
    w = wp.normalize(wp.vec3(alpha * wo[0], alpha * wo[1], wo[2]))
    sin = wp.sqrt(w[0] * w[0] + w[1] * w[1])
    along = wp.vec2(1.0, 0.0)
    if sin > 1.0e-6:
        along = wp.vec2(w[0] / sin, w[1] / sin)
    x = _visible_slope(wp.max(w[2], 1.0e-4) / wp.max(sin, 1.0e-6), u[0])
    y = wp.erfinv(wp.clamp(2.0 * u[1] - 1.0, -_FURTHEST, _FURTHEST))
    slope_x = along[0] * x - along[1] * y
    slope_y = along[1] * x + along[0] * y
    return wp.normalize(wp.vec3(-alpha * slope_x, -alpha * slope_y, 1.0))


@wp.func
def evened(w: wp.vec3, factor: float) -> wp.vec3:
    """Return a direction's image, no unit vector, in the frame where roughness is the same along both tangents.

    With α·factor along x and α/factor along y, Λ and drawn normals are the isotropic ones of directions times
    ``factor``, the distribution is that of normals over it (Heitz, JCGT 3(2), 2014, section 5.3).
    """
    return wp.vec3(w[0] * factor, w[1] / factor, w[2])


@wp.func
def reflected(wo: wp.vec3, h: wp.vec3) -> wp.vec3:
    """Return the mirror direction."""
    return wp.normalize(h * (2.0 * wp.dot(wo, h)) - wo)


@wp.func
def refracted(wo: wp.vec3, h: wp.vec3, cos_t: float, eta: float) -> wp.vec3:
    """Return the refracted direction; ``cos_t`` from ``fresnel_dielectric``."""
    return wp.normalize(h * (wp.dot(wo, h) / eta - cos_t) - wo / eta)


@wp.func
def fresnel_dielectric(cos_i: float, eta: float) -> wp.vec2:
    """Return the unpolarised reflectance and the cosine behind; ``eta`` is the index behind over that in front."""
    c = wp.min(cos_i, 1.0)
    sin2_t = (1.0 - c * c) / (eta * eta)
    result = wp.vec2(1.0, 0.0)
    if sin2_t < 1.0:
        cos_t = wp.sqrt(1.0 - sin2_t)
        across = (c - eta * cos_t) / (c + eta * cos_t)
        along = (eta * c - cos_t) / (eta * c + cos_t)
        result = wp.vec2(0.5 * (across * across + along * along), cos_t)
    return result


@wp.func
def _fresnel_metal(cos_i: float, eta: float, k: float) -> float:
    c2 = wp.min(cos_i * cos_i, 1.0)
    s2 = 1.0 - c2
    t0 = eta * eta - k * k - s2
    t1 = wp.sqrt(t0 * t0 + 4.0 * eta * eta * k * k)
    a = wp.sqrt(wp.max(0.5 * (t1 + t0), 0.0))
    across = (t1 + c2 - 2.0 * a * cos_i) / (t1 + c2 + 2.0 * a * cos_i)
    along = (c2 * t1 + s2 * s2 - 2.0 * a * cos_i * s2) / wp.max(c2 * t1 + s2 * s2 + 2.0 * a * cos_i * s2, 1.0e-30)
    return 0.5 * across * (1.0 + along)


@wp.func
def fresnel_conductor(cos_i: float, eta: wp.vec3, k: wp.vec3) -> wp.vec3:
    """Return the unpolarised reflectance of a metal of complex index eta + i·k (Born and Wolf, section 14.2)."""
    return wp.vec3(
        _fresnel_metal(cos_i, eta[0], k[0]), _fresnel_metal(cos_i, eta[1], k[1]), _fresnel_metal(cos_i, eta[2], k[2])
    )


@wp.func
def schlick(cos_i: float, f0: wp.vec3) -> wp.vec3:
    """Return Schlick's approximation of Fresnel reflectance (Computer Graphics Forum 13(3), 1994)."""
    m = wp.clamp(1.0 - cos_i, 0.0, 1.0)
    m2 = m * m
    return f0 + (wp.vec3(1.0, 1.0, 1.0) - f0) * (m2 * m2 * m)
