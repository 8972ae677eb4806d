"""glTF 2.0's metallic-roughness material with clearcoat and thin-walled transmission, as Warp functions.

Khronos, glTF 2.0, appendix B, KHR_materials_clearcoat and KHR_materials_transmission, with one change: what enters a
dielectric layer is weighted by 1 − F(min(n·wo, n·wi)) instead of 1 − F(wo·h), with which a white surface would return
up to twice the light that falls on it at grazing angles. The result is reciprocal and gains nothing.
"""

import warp as wp

from clsim.render.bsdf.parts import Scattered, Scattering
from clsim.render.sampling.sampling import cosine_hemisphere, luminance
from clsim.render.surfaces.materials import Bsdf
from clsim.render.surfaces.microfacet import SMOOTH, ggx, reflected, sample_visible_normal, schlick, smith_lambda

_ONE = wp.constant(wp.vec3(1.0, 1.0, 1.0))
COAT_F0 = wp.constant(0.04)


@wp.struct
class Lobes:
    """Probabilities with which each lobe is drawn; base and coat are specular."""

    coat: float
    base: float
    through: float
    diffuse: float


@wp.func
def dielectric_f0(b: Bsdf) -> wp.vec3:
    """Return what a dielectric reflects straight back."""
    r = (b.eta - 1.0) / (b.eta + 1.0)
    f0 = b.specular * (r * r)
    return wp.vec3(wp.min(f0[0], 1.0), wp.min(f0[1], 1.0), wp.min(f0[2], 1.0))


@wp.func
def _fresnel_dielectric(b: Bsdf, cosine: float) -> wp.vec3:
    """KHR_materials_specular: a factor of 0 takes the reflection at grazing angles, too."""
    grazing = wp.min(wp.max(b.specular[0], wp.max(b.specular[1], b.specular[2])), 1.0)
    f0 = dielectric_f0(b)
    m = wp.clamp(1.0 - cosine, 0.0, 1.0)
    m2 = m * m
    return f0 + (wp.vec3(grazing, grazing, grazing) - f0) * (m2 * m2 * m)


@wp.func
def _fresnel_base(b: Bsdf, cosine: float) -> wp.vec3:
    return _fresnel_dielectric(b, cosine) * (1.0 - b.metallic) + schlick(cosine, b.color) * b.metallic


@wp.func
def under_coat(b: Bsdf, cosine: float) -> float:
    """Return the share of light that a clear coat lets pass in a direction."""
    m = wp.clamp(1.0 - cosine, 0.0, 1.0)
    m2 = m * m
    return 1.0 - b.clearcoat * (COAT_F0 + (1.0 - COAT_F0) * m2 * m2 * m)


@wp.func
def passing_principled(b: Bsdf, cosine: float) -> float:
    """Return the share of light from the base that leaves in a direction: neither reflection nor clearcoat keeps it.

    It is the mean over the directions that the light comes from, of Schlick's reflectance at the flatter of both.
    """
    c = wp.clamp(cosine, 0.0, 1.0)
    m = 1.0 - c
    m5 = m * m * m * m * m
    flat = 1.0 / 21.0 - m5 * m / 3.0 + 2.0 * m5 * m * m / 7.0 + (1.0 - c * c) * m5
    f0 = dielectric_f0(b)
    normal = (f0[0] + f0[1] + f0[2]) / 3.0
    grazing = wp.min(wp.max(b.specular[0], wp.max(b.specular[1], b.specular[2])), 1.0)
    under = under_coat(b, c)
    return (1.0 - (normal + (grazing - normal) * flat) * (1.0 - b.metallic)) * under * under


@wp.func
def passing_principled_from(b: Bsdf, out: float, into: float) -> float:
    """Return how much more light passes to the base, and back in a direction, than of light from all around.

    ``out`` and ``into`` are the cosines of both ways. Times `passing_principled` it is the share of light from there.
    """
    f = _fresnel_dielectric(b, wp.min(out, into))
    share = (1.0 - (f[0] + f[1] + f[2]) / 3.0 * (1.0 - b.metallic)) * under_coat(b, out) * under_coat(b, into)
    return share / wp.max(passing_principled(b, out), 1.0e-6)


@wp.func
def _lobes(b: Bsdf, wo: wp.vec3) -> Lobes:
    lobes = Lobes()
    under = under_coat(b, wo[2])
    lobes.coat = 1.0 - under
    lobes.base = under * luminance(_fresnel_base(b, wo[2]))
    entering = under * (1.0 - b.metallic) * luminance(wp.cw_mul(b.color, _ONE - _fresnel_dielectric(b, wo[2])))
    lobes.through = entering * b.transmission
    lobes.diffuse = entering * (1.0 - b.transmission)
    total = wp.max(lobes.coat + lobes.base + lobes.through + lobes.diffuse, 1.0e-20)
    lobes.coat = lobes.coat / total
    lobes.base = lobes.base / total
    lobes.through = lobes.through / total
    lobes.diffuse = lobes.diffuse / total
    return lobes


@wp.func
def _microfacets(wo: wp.vec3, wi: wp.vec3, alpha: float) -> wp.vec3:
    """Return D·G / (4 wo.z), the density of visible normals as directions, and wo·h; heights correlate in G."""
    h = wp.normalize(wo + wi)
    d = ggx(h, alpha) / (4.0 * wo[2])
    out = smith_lambda(wo, alpha)
    return wp.vec3(d / (1.0 + out + smith_lambda(wi, alpha)), d / (1.0 + out), wp.dot(wo, h))


@wp.func
def principled_value(b: Bsdf, wo: wp.vec3, wi: wp.vec3) -> Scattering:
    """Return f·cos θ and density, without the lobes that are mirrors."""
    result = Scattering()
    cosine = wp.abs(wi[2])
    if cosine > 0.0:
        lobes = _lobes(b, wo)
        mirrored = wp.vec3(wi[0], wi[1], cosine)
        under = under_coat(b, wo[2]) * under_coat(b, cosine)
        entering = wp.cw_mul(b.color, _ONE - _fresnel_dielectric(b, wp.min(wo[2], cosine))) * (
            (1.0 - b.metallic) * under
        )
        base = wp.vec3()
        if b.alpha >= SMOOTH:
            base = _microfacets(wo, mirrored, b.alpha)
        if wi[2] < 0.0:
            result.value = entering * (b.transmission * base[0])
            result.pdf = lobes.through * base[1]
        else:
            lambert = cosine / wp.pi
            result.value = entering * ((1.0 - b.transmission) * lambert) + _fresnel_base(b, base[2]) * (under * base[0])
            result.pdf = lobes.diffuse * lambert + lobes.base * base[1]
            if b.clearcoat > 0.0 and b.clearcoat_alpha >= SMOOTH:
                coat = _microfacets(wo, wi, b.clearcoat_alpha)
                share = (1.0 - under_coat(b, coat[2])) * coat[0]
                result.value += wp.vec3(share, share, share)
                result.pdf += lobes.coat * coat[1]
    return result


@wp.func
def principled_sample(b: Bsdf, wo: wp.vec3, choice: float, u: wp.vec2) -> Scattered:
    """Draw a lobe by the light that it returns, and a direction of that lobe."""
    s = Scattered()
    s.eta2 = 1.0
    lobes = _lobes(b, wo)
    mirrored = wp.vec3(-wo[0], -wo[1], wo[2])
    under = under_coat(b, wo[2]) * under_coat(b, wo[2])
    if choice < lobes.coat:
        if b.clearcoat_alpha < SMOOTH:
            s.direction = mirrored
            s.delta = True
            s.weight = _ONE * ((1.0 - under_coat(b, wo[2])) / lobes.coat)
        else:
            s.direction = reflected(wo, sample_visible_normal(wo, b.clearcoat_alpha, u))
    elif choice < lobes.coat + lobes.base:
        if b.alpha < SMOOTH:
            s.direction = mirrored
            s.delta = True
            s.weight = _fresnel_base(b, wo[2]) * (under / lobes.base)
        else:
            s.direction = reflected(wo, sample_visible_normal(wo, b.alpha, u))
    elif choice < lobes.coat + lobes.base + lobes.through:
        if b.alpha < SMOOTH:
            s.direction = -wo
            s.delta = True
            entering = wp.cw_mul(b.color, _ONE - _fresnel_dielectric(b, wo[2]))
            s.weight = entering * ((1.0 - b.metallic) * under * b.transmission / lobes.through)
        else:
            r = reflected(wo, sample_visible_normal(wo, b.alpha, u))
            s.direction = wp.vec3(r[0], r[1], -r[2])
            if r[2] <= 0.0:
                s.direction = wp.vec3()
    else:
        s.direction = cosine_hemisphere(wp.vec3(0.0, 0.0, 1.0), u)
    if not s.delta:
        # Light that a rough reflection would send into the surface is lost.
        inward = choice < lobes.coat + lobes.base and s.direction[2] <= 0.0
        if not inward:
            both = principled_value(b, wo, s.direction)
            s.pdf = both.pdf
            if both.pdf > 0.0:
                s.weight = both.value / both.pdf
    return s
