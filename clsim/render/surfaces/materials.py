# ruff: noqa: SIM102, UP018
"""Materials: what they are at a point of a surface, textures included, as Warp functions."""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Surface
from clsim.render.features.bsdf_kinds import (
    CONDUCTOR,
    DIELECTRIC,
    DISNEY,
    NUMBERS,
    PLASTIC,
    PRINCIPLED,
    THIN_DIELECTRIC,
)
from clsim.render.features.features import Features
from clsim.render.surfaces.microfacet import SMOOTH
from clsim.render.surfaces.plastic_tables import STACK_SIZE, TABLE_SIZE
from clsim.render.textures.texture_data import Footprint, Spot, Textures
from clsim.render.textures.textures import at_spot, make_textures, straightened

_LAST_TABLE = wp.constant(STACK_SIZE - 1)
OPAQUE = wp.constant(0)
MASK = wp.constant(1)
BLEND = wp.constant(2)
_MATT = wp.constant(0.5)
"""A metal with a larger α reflects much the same whichever way it is seen, and glass shows much the same behind it."""
BASE = wp.constant(1)
REFLECTION = wp.constant(2)


@wp.struct
class MaterialRow:
    """A ``clsim.scene.Material`` in numbers.

    ``dark_back`` says that the back scatters nothing, ``culled`` that the camera does not see it; ``complex_index``
    that ``eta`` and ``k`` hold; ``table`` is plastic's first entry in ``Materials.transmittance`` and ``inner`` its
    mean reflectance from inside; where its roughness is textured, there is a stack of tables, and then their ``inner``.
    """

    kind: int
    color: wp.vec3
    emission: wp.vec3
    specular: wp.vec3
    eta: wp.vec3
    k: wp.vec3
    complex_index: int
    alpha: float
    ior: float
    metallic: float
    transmission: float
    clearcoat: float
    clearcoat_alpha: float
    specular_tint: float
    sheen: float
    sheen_tint: float
    flatness: float
    stretch: float
    beckmann: int
    absorption: wp.vec3
    nonlinear: int
    table: int
    inner: float
    emits_behind: int
    dark_back: int
    culled: int
    alpha_mode: int
    alpha_cutoff: float
    opacity: float
    normal_scale: float
    bump_scale: float
    blend_with: int
    blend_share: float
    blend_texture: int
    blend_behind: int
    bump_texture: int
    texture: int
    emission_texture: int
    roughness_texture: int
    normal_texture: int
    opacity_texture: int


@wp.struct
class Materials:
    """All materials and textures; ``transmittance`` holds the tables of rough plastics (``plastic_tables``).

    ``reflections`` is the table of what coats reflect of lamps (``reflection_table``), where there are any.
    """

    rows: wp.array[MaterialRow]
    textures: Textures
    transmittance: wp.array[float]
    reflections: wp.array[float]


@wp.struct
class Bsdf:
    """How light scatters at one point: a material with its textures looked up.

    ``eta`` is the index across the surface over that of the ray's side; ``mirror`` says that every lobe is perfectly
    smooth, ``glossy`` that it is a metal or glass that is nearly so, ``frosted`` that it is such glass, ``dark`` that
    nothing is scattered at all; ``table_share`` is the weight of the table after plastic's. ``row`` is the material's
    number, for what one model alone reads; ``tangent`` the way of u, 0 where there is none; ``part`` is 0, or which
    part of Disney's model scatters alone, ``BASE`` or ``REFLECTION``.
    """

    kind: int
    row: int
    part: int
    tangent: wp.vec3
    stretch: float
    beckmann: int
    color: wp.vec3
    specular: wp.vec3
    metal_eta: wp.vec3
    metal_k: wp.vec3
    complex_index: int
    alpha: float
    eta: float
    metallic: float
    transmission: float
    clearcoat: float
    clearcoat_alpha: float
    nonlinear: int
    table: int
    table_share: float
    inner: float
    mirror: bool
    glossy: bool
    frosted: bool
    dark: bool


@wp.func
def has_details(materials: Materials, material: int, averaged: bool) -> bool:
    """Whether a surface has textures whose means over pixels are not known; ``averaged``: that of its colour is."""
    row = materials.rows[material]
    others = row.emission_texture >= 0 or row.roughness_texture >= 0 or row.blend_texture >= 0
    return others or (row.texture >= 0 and not averaged)


def make_materials(features: Features) -> tuple[Any, ...]:
    """Return the Warp functions ``resolve``, ``emitted`` and ``opacity`` of (materials, surface), and more.

    ``foresee(materials, surface)`` reads no texture, but tells where that of the colour is read, and has these texels
    on their way from memory; ``texture_seen(materials, surface, spot)`` reads them. ``lit_sides`` tells from how many
    sides, 0 to 2, light may be scattered there. ``textured(materials, material)`` tells whether a texture changes its
    albedo and nothing else does. ``coloured(materials, surface, texture)`` is ``resolve`` with that texture's colour:
    that which ``texture_seen`` gives, ``texture_at(materials, surface)`` or, over a part of the picture,
    ``mean_texture(materials, surface, footprint, places)``.
    """
    lookup, mean, foresee_texture = make_textures(features)
    only = NUMBERS[features.kinds[0]] if len(features.kinds) == 1 else -1
    glossy = features.kinds != ("diffuse",)

    @wp.func
    def coloured(materials: Materials, point: Surface, texture: wp.vec3) -> Bsdf:
        row = materials.rows[point.material]
        b = Bsdf()
        b.kind = row.kind
        if wp.static(only >= 0):
            b.kind = wp.static(only)
        b.color = row.color
        b.mirror = False
        b.glossy = False
        b.frosted = False
        b.dark = False
        if wp.static(features.textures):
            if row.texture >= 0:
                b.color = wp.cw_mul(b.color, texture)
        if wp.static(features.vertex_colors):
            b.color = wp.cw_mul(b.color, point.tint)
        if wp.static(features.dark_backs):
            b.dark = not point.front and row.dark_back != 0
        if wp.static(glossy):
            b.specular = row.specular
            b.metal_eta = row.eta
            b.metal_k = row.k
            b.complex_index = row.complex_index
            b.alpha = row.alpha
            # Only the inside of glass is reached from the other side; coats and panes look the same from both.
            b.eta = wp.where(point.front or b.kind != DIELECTRIC, row.ior, 1.0 / row.ior)
            if wp.static("disney" in features.kinds):
                b.row = point.material
                if b.kind == DISNEY and row.transmission > 0.0 and not point.front:
                    b.eta = 1.0 / row.ior
            if wp.static(features.anisotropic):
                b.stretch = row.stretch
                b.tangent = point.tangent
            if wp.static(features.beckmann):
                b.beckmann = row.beckmann
            b.metallic = row.metallic
            b.transmission = row.transmission
            b.clearcoat = row.clearcoat
            b.clearcoat_alpha = row.clearcoat_alpha
            b.nonlinear = row.nonlinear
            b.table = row.table
            b.inner = row.inner
            if wp.static(features.roughness_textures):
                if row.roughness_texture >= 0:
                    rgba = lookup(materials.textures, row.roughness_texture, point.uv)
                    b.alpha = b.alpha * rgba[1] * rgba[1]
                    b.metallic = b.metallic * rgba[2]
                    if wp.static("plastic" in features.kinds):
                        if b.kind == PLASTIC:
                            step = rgba[1] * float(_LAST_TABLE)
                            below = wp.min(int(step), _LAST_TABLE - 1)
                            b.table = row.table + below * TABLE_SIZE
                            b.table_share = step - float(below)
                            inner = row.table + STACK_SIZE * TABLE_SIZE + below
                            b.inner = wp.lerp(
                                materials.transmittance[inner], materials.transmittance[inner + 1], b.table_share
                            )
            smooth = b.alpha < SMOOTH
            b.mirror = (smooth and (b.kind == CONDUCTOR or b.kind == DIELECTRIC)) or b.kind == THIN_DIELECTRIC
            if wp.static("principled" in features.kinds):
                if b.kind == PRINCIPLED:
                    bare = b.clearcoat <= 0.0 or b.clearcoat_alpha < SMOOTH
                    b.mirror = smooth and bare and (b.metallic >= 1.0 or b.transmission >= 1.0)
            if wp.static(features.follow_gloss):
                layered = b.kind == PRINCIPLED or b.kind == DISNEY
                metal = b.kind == CONDUCTOR or (layered and b.metallic >= 0.5)
                glass = b.kind == DIELECTRIC or (layered and b.transmission >= 0.5)
                even = row.normal_texture < 0 and row.bump_texture < 0
                b.glossy = (metal or glass) and even and not b.mirror and b.alpha < _MATT
                b.frosted = glass and b.glossy and not metal
        return b

    @wp.func
    def foresee(materials: Materials, point: Surface) -> Spot:
        spot = Spot()
        spot.decoding = -1
        if wp.static(features.textures):
            texture = materials.rows[point.material].texture
            if texture >= 0:
                spot = foresee_texture(materials.textures, texture, point.uv)
        return spot

    @wp.func
    def texture_seen(materials: Materials, point: Surface, spot: Spot) -> wp.vec3:
        value = wp.vec3()
        if wp.static(features.textures):
            if spot.decoding >= 0:
                rgba = at_spot(materials.textures, spot)
                value = wp.vec3(rgba[0], rgba[1], rgba[2])
            if wp.static(features.checkers):
                texture = materials.rows[point.material].texture
                if spot.decoding < 0 and texture >= 0:
                    rgba = lookup(materials.textures, texture, point.uv)
                    value = wp.vec3(rgba[0], rgba[1], rgba[2])
        return value

    @wp.func
    def lit_sides(materials: Materials, point: Surface) -> int:
        row = materials.rows[point.material]
        sides = 1
        if wp.static(features.transmission):
            if row.kind == DIELECTRIC or row.transmission > 0.0:
                sides = 2
        if wp.static(features.mirrors):
            smooth = row.alpha < SMOOTH and row.roughness_texture < 0
            if row.kind == THIN_DIELECTRIC or (smooth and (row.kind == CONDUCTOR or row.kind == DIELECTRIC)):
                sides = 0
        if wp.static(features.dark_backs):
            if not point.front and row.dark_back != 0:
                sides = 0
        return sides

    @wp.func
    def emitted(materials: Materials, point: Surface) -> wp.vec3:
        row = materials.rows[point.material]
        radiance = row.emission
        if wp.static(features.emission_textures):
            if row.emission_texture >= 0:
                rgba = lookup(materials.textures, row.emission_texture, point.uv)
                radiance = wp.cw_mul(radiance, wp.vec3(rgba[0], rgba[1], rgba[2]))
        if wp.static(features.one_sided_lamps):
            if not point.front and row.emits_behind == 0:
                radiance = wp.vec3()
        return radiance

    @wp.func
    def opacity(materials: Materials, point: Surface) -> float:
        row = materials.rows[point.material]
        share = 1.0
        if row.alpha_mode != OPAQUE:
            share = row.opacity
            if wp.static(features.textures):
                if row.opacity_texture >= 0:
                    share = share * lookup(materials.textures, row.opacity_texture, point.uv)[3]
            if row.alpha_mode == MASK:
                share = wp.where(share < row.alpha_cutoff, 0.0, 1.0)
        return share

    @wp.func
    def textured(materials: Materials, material: int) -> bool:
        found = bool(False)
        if wp.static(features.textures and not features.vertex_colors):
            row = materials.rows[material]
            found = row.texture >= 0 and row.roughness_texture < 0 and row.emission_texture < 0
            if wp.static(features.blends):
                found = found and row.blend_with < 0
            if wp.static(features.alpha):
                # What is cut out has a colour too, and nobody sees it.
                found = found and (row.alpha_mode == OPAQUE or row.opacity_texture < 0)
        return found

    @wp.func
    def texture_at(materials: Materials, point: Surface) -> wp.vec3:
        value = wp.vec3()
        if wp.static(features.textures):
            texture = materials.rows[point.material].texture
            if texture >= 0:
                rgba = lookup(materials.textures, texture, point.uv)
                value = wp.vec3(rgba[0], rgba[1], rgba[2])
        return value

    @wp.func
    def mean_texture(materials: Materials, point: Surface, footprint: Footprint, places: int) -> wp.vec3:
        value = wp.vec3()
        if wp.static(features.textures):
            row = materials.rows[point.material]
            bend = wp.vec3()
            if wp.static("plastic" in features.kinds):
                if row.nonlinear != 0:
                    bend = row.color * row.inner
            rgba = mean(materials.textures, row.texture, footprint, places, bend)
            value = straightened(wp.vec3(rgba[0], rgba[1], rgba[2]), bend)
        return value

    @wp.func
    def resolve(materials: Materials, point: Surface) -> Bsdf:
        return coloured(materials, point, texture_at(materials, point))

    return resolve, emitted, opacity, foresee, texture_seen, lit_sides, textured, coloured, texture_at, mean_texture
