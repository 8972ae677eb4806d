"""What a coat reflects of lamps, as a cosine lobe whose directions are transformed by a matrix, as Warp functions.

How much of a plain cosine lobe a polygon covers is known in closed form; so it is of a transformed one, when the
polygon's corners are turned back (Heitz, Dupuy, Hill and Neubelt, Real-Time Polygonal-Light Shading with Linearly
Transformed Cosines, SIGGRAPH 2016). The matrices are fitted (`reflection_table.py`).
"""

import warp as wp

from clsim.render.bsdf.principled import COAT_F0, dielectric_f0, under_coat
from clsim.render.features.bsdf_kinds import PLASTIC
from clsim.render.surfaces.materials import Bsdf, Materials
from clsim.render.surfaces.microfacet import SMOOTH, fresnel_dielectric
from clsim.render.surfaces.reflection_table import ENTRIES, MODELS, SIZE

_SIZE, _ENTRIES = wp.constant(SIZE), wp.constant(ENTRIES)
_SEPARABLE, _CORRELATED, _BECKMANN = (
    wp.constant(MODELS.index(name)) for name in ("separable", "correlated", "beckmann")
)
_LEAST_ALPHA = wp.constant(0.02)
"""Narrower lobes are taken for as wide as that: about as far as normals turn, or the eye sees, within a pixel."""
_LEAST_COSINE = wp.constant(1.0e-3)
_LEAST_WEIGHT = wp.constant(0.03)
"""What a corner of a lamp counts at least for its middle, beside 1 in the middle of the lobe."""


@wp.struct
class Lobe:
    """What a coat reflects in one direction.

    Attributes:
        inverse: turns directions of the world, so that the lobe becomes a plain cosine around z.
        density: what the cosine over the fourth power of a turned direction's length is worth, as a density [sr⁻¹].
        white: share of light from all around that is reflected, but for Fresnel's term.
        share: the same with it, by channel.
        mirror: whether it is perfectly smooth: then it shows no light that has no size.
        wo: that direction.
        ior: index of a coat, 0 where its reflectance is Schlick's.
        straight, grazing: reflectances of light from straight above and at a grazing angle, by Schlick, or what all
            reflectances are multiplied by.
    """

    inverse: wp.mat33
    density: float
    white: float
    share: wp.vec3
    mirror: bool
    wo: wp.vec3
    ior: float
    straight: wp.vec3
    grazing: wp.vec3


@wp.func
def _entry(table: wp.array[float], first: int, entry: int, along: float, across: float) -> float:
    """Return an entry between four rows of the table, from the first row on."""
    at = first + entry
    low = wp.lerp(table[at], table[at + _ENTRIES], across)
    below = at + _SIZE * _ENTRIES
    return wp.lerp(low, wp.lerp(table[below], table[below + _ENTRIES], across), along)


@wp.func
def _lobe(
    table: wp.array[float], model: int, alpha: float, spread: float, normal: wp.vec3, wo: wp.vec3
) -> tuple[Lobe, float]:
    """Return the lobe without its colours, and its share of light from all around for Schlick's (1 − cos)⁵."""
    cosine = wp.clamp(wp.dot(normal, wo), _LEAST_COSINE, 1.0)
    last = float(_SIZE - 1)
    along = wp.sqrt(wp.clamp(wp.sqrt(alpha * alpha + spread), _LEAST_ALPHA, 1.0)) * last
    across = wp.sqrt(1.0 - cosine) * last
    i = wp.min(int(along), _SIZE - 2)
    j = wp.min(int(across), _SIZE - 2)
    along = along - float(i)
    across = across - float(j)
    first = ((model * _SIZE + i) * _SIZE + j) * _ENTRIES
    xx = _entry(table, first, 0, along, across)
    xz = _entry(table, first, 1, along, across)
    zx = _entry(table, first, 2, along, across)
    zz = _entry(table, first, 3, along, across)
    x = wo - normal * wp.dot(normal, wo)
    if wp.length_sq(x) < 1.0e-8:
        x = wp.cross(normal, wp.where(wp.abs(normal[0]) < 0.5, wp.vec3(1.0, 0.0, 0.0), wp.vec3(0.0, 1.0, 0.0)))
    x = wp.normalize(x)
    lobe = Lobe()
    lobe.mirror = alpha < SMOOTH
    lobe.inverse = wp.matrix_from_rows(x * xx + normal * xz, wp.cross(normal, x), x * zx + normal * zz)
    lobe.density = wp.abs(xx * zz - xz * zx) / wp.pi
    lobe.wo = wo
    lobe.white = _entry(table, first, 4, along, across)
    return lobe, _entry(table, first, 5, along, across)


@wp.func
def coat_lobe(materials: Materials, material: int, normal: wp.vec3, wo: wp.vec3, spread: float) -> Lobe:
    """Return what the coat of a plastic, or of a dielectric of glTF, reflects in the direction ``wo``.

    ``spread`` is added to α²: normals that turn within a pixel are seen as a rougher surface.
    """
    row = materials.rows[material]
    cosine = wp.clamp(wp.dot(normal, wo), 0.0, 1.0)
    model = wp.where(row.kind == PLASTIC, _SEPARABLE, _CORRELATED)
    if row.beckmann != 0:
        model = int(_BECKMANN)
    lobe, grazing = _lobe(materials.reflections, model, row.alpha, spread, normal, wo)
    if row.kind == PLASTIC:
        lobe.ior = row.ior
        lobe.straight = row.specular
        r = (row.ior - 1.0) / (row.ior + 1.0)
        # Schlick's formula, made exact in the direction in which light leaves.
        m = 1.0 - cosine
        schlick = r * r + (1.0 - r * r) * m * m * m * m * m
        exact = fresnel_dielectric(cosine, row.ior)[0] / wp.max(schlick, 1.0e-6)
        lobe.share = row.specular * (exact * (r * r * (lobe.white - grazing) + grazing))
    else:
        b = Bsdf()
        b.eta = row.ior
        b.specular = row.specular
        b.clearcoat = row.clearcoat
        under = under_coat(b, cosine) * under_coat(b, cosine)
        most = wp.min(wp.max(row.specular[0], wp.max(row.specular[1], row.specular[2])), 1.0)
        lobe.straight = dielectric_f0(b) * under
        lobe.grazing = wp.vec3(most, most, most) * under
        lobe.share = lobe.straight * (lobe.white - grazing) + lobe.grazing * grazing
    return lobe


@wp.func
def clear_coat_lobe(materials: Materials, material: int, normal: wp.vec3, wo: wp.vec3, spread: float) -> Lobe:
    """Return what the clear coat over a dielectric of glTF reflects in the direction ``wo``."""
    row = materials.rows[material]
    lobe, grazing = _lobe(materials.reflections, _CORRELATED, row.clearcoat_alpha, spread, normal, wo)
    lobe.grazing = wp.vec3(row.clearcoat, row.clearcoat, row.clearcoat)
    lobe.straight = lobe.grazing * COAT_F0
    lobe.share = lobe.straight * (lobe.white - grazing) + lobe.grazing * grazing
    return lobe


@wp.func
def _density(lobe: Lobe, direction: wp.vec3) -> float:
    """Return the lobe's density [sr⁻¹] in a direction of unit length."""
    turned = lobe.inverse * direction
    squared = wp.dot(turned, turned)
    return lobe.density * wp.max(turned[2], 0.0) / wp.max(squared * squared, 1.0e-30)


@wp.func
def _share_towards(lobe: Lobe, direction: wp.vec3) -> wp.vec3:
    """Return the lobe's ``share``, with Fresnel's term of light from one direction."""
    facing = wp.clamp(wp.dot(lobe.wo, wp.normalize(lobe.wo + direction)), 0.0, 1.0)
    share = lobe.straight
    if lobe.ior > 0.0:
        share = share * fresnel_dielectric(facing, lobe.ior)[0]
    else:
        m = 1.0 - facing
        share = share + (lobe.grazing - share) * (m * m * m * m * m)
    return share * lobe.white


@wp.func
def reflected_from(lobe: Lobe, direction: wp.vec3) -> wp.vec3:
    """Return what is reflected of an irradiance of 1 across a direction of unit length."""
    return _share_towards(lobe, direction) * _density(lobe, direction)


@wp.func
def counted(turned: wp.vec3) -> wp.vec3:
    """Return a turned direction, not below the horizon, as long as the cosine that it counts with."""
    unit = wp.normalize(turned)
    unit[2] = wp.max(unit[2], 0.0)
    return unit * (unit[2] * wp.sqrt(unit[2]) + _LEAST_WEIGHT)


@wp.func
def reflected_by_coats(
    materials: Materials, material: int, normal: wp.vec3, wo: wp.vec3, direction: wp.vec3
) -> wp.vec3:
    """Return what a material's coats reflect of an irradiance of 1 across a direction of unit length."""
    found = reflected_from(coat_lobe(materials, material, normal, wo, 0.0), direction)
    if materials.rows[material].clearcoat > 0.0:
        found += reflected_from(clear_coat_lobe(materials, material, normal, wo, 0.0), direction)
    return found


@wp.func
def reflected_of(lobe: Lobe, covered: float, turned: wp.vec3) -> wp.vec3:
    """Return what is reflected of a radiance of 1 that covers a share of the lobe.

    Fresnel's term is that of the middle of what is covered, and the lobe's mean if all is. ``turned`` is that middle in
    the lobe's frame: the sum of the corners, each ``counted``.
    """
    mixed = wp.clamp(covered, 0.0, 1.0)
    middle = wp.normalize(wp.inverse(lobe.inverse) * turned)
    return (_share_towards(lobe, middle) * (1.0 - mixed) + lobe.share * mixed) * covered
