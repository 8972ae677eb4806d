# Warp: a variable that changes must be born by a call, and wp.static drops a branch only where it stands alone.
# ruff: noqa: SIM102
"""How surfaces scatter light: materials and their Warp functions.

A scattering model gives three functions: ``scatter`` draws a direction, ``scatter_value`` is f·cos θ for a given one,
``scatter_pdf`` its density per steradian.
"""

from typing import Any

import warp as wp

from clsim.render.features import Features
from clsim.render.geometry import Surface
from clsim.render.sampling import cosine_hemisphere


@wp.struct
class Materials:
    """All materials and checker textures, one entry each."""

    color: wp.array(dtype=wp.vec3)
    emission: wp.array(dtype=wp.vec3)
    two_sided: wp.array(dtype=int)
    texture: wp.array(dtype=int)
    checker_a: wp.array(dtype=wp.vec3)
    checker_b: wp.array(dtype=wp.vec3)
    checker_scale: wp.array(dtype=float)


@wp.func
def checker(materials: Materials, texture: int, uv: wp.vec2) -> wp.vec3:
    """Return the colour of a checkerboard; the square at the origin of uv has the first colour."""
    scale = materials.checker_scale[texture]
    square = int(wp.floor(uv[0] * scale)) + int(wp.floor(uv[1] * scale))
    return wp.where((square & 1) == 0, materials.checker_a[texture], materials.checker_b[texture])


def make_materials(features: Features) -> tuple[Any, Any]:
    """Return the Warp functions ``reflectance(materials, surface)`` and ``emitted(materials, surface)``."""

    @wp.func
    def reflectance(materials: Materials, point: Surface) -> wp.vec3:
        color = materials.color[point.material]
        if wp.static(features.textures):
            texture = materials.texture[point.material]
            if texture >= 0:
                color = wp.cw_mul(color, checker(materials, texture, point.uv))
        if wp.static(features.one_sided):
            if not point.front and materials.two_sided[point.material] == 0:
                color = wp.vec3()
        return color

    @wp.func
    def emitted(materials: Materials, point: Surface) -> wp.vec3:
        radiance = materials.emission[point.material]
        if wp.static(features.one_sided):
            if not point.front and materials.two_sided[point.material] == 0:
                radiance = wp.vec3()
        return radiance

    return reflectance, emitted


@wp.func
def scatter(normal: wp.vec3, u: wp.vec2) -> wp.vec3:
    """Draw a direction of the diffuse model."""
    return cosine_hemisphere(normal, u)


@wp.func
def scatter_pdf(normal: wp.vec3, direction: wp.vec3) -> float:
    """Return the density of ``scatter`` [sr⁻¹]."""
    return wp.max(wp.dot(normal, direction), 0.0) / wp.pi


@wp.func
def scatter_value(color: wp.vec3, normal: wp.vec3, direction: wp.vec3) -> wp.vec3:
    """Return f·cos θ of the diffuse model [sr⁻¹]."""
    return color * (wp.max(wp.dot(normal, direction), 0.0) / wp.pi)
