"""The footprint of a bundle of rays on a texture, as a Warp function."""

import warp as wp

from clsim.render.accel.geometry import Surface
from clsim.render.textures.texture_data import Footprint

_MOST_GRAZING = wp.constant(0.02)
"""Cosine beyond which a patch on a surface becomes no longer."""


@wp.func
def _in_uv(along: wp.vec3, point: Surface) -> wp.vec3:
    """Return by how much u and v change along a vector in the plane of the triangle; 0 where uv have no area."""
    uu = wp.dot(point.tangent, point.tangent)
    uv = wp.dot(point.tangent, point.bitangent)
    vv = wp.dot(point.bitangent, point.bitangent)
    determinant = uu * vv - uv * uv
    change = wp.vec3()
    if determinant > 1.0e-6 * uu * vv:
        u = wp.dot(along, point.tangent)
        v = wp.dot(along, point.bitangent)
        change = wp.vec3((u * vv - v * uv) / determinant, (v * uu - u * uv) / determinant, 0.0)
    return change


@wp.func
def patch_round(point: Surface, direction: wp.vec3, width_m: float) -> Footprint:
    """Return what a bundle of rays, a square of that width across, shows round the point that its middle meets.

    It is taken for parallel rays (Igehy, Tracing Ray Differentials, SIGGRAPH 1999, eq. 10).
    """
    upward = wp.where(wp.abs(direction[2]) < 0.9, wp.vec3(0.0, 0.0, 1.0), wp.vec3(1.0, 0.0, 0.0))
    aside = wp.normalize(wp.cross(direction, upward))
    down = wp.cross(direction, aside)
    facing = wp.min(wp.dot(direction, point.normal), -_MOST_GRAZING)
    across = _in_uv((aside - direction * (wp.dot(aside, point.normal) / facing)) * width_m, point)
    along = _in_uv((down - direction * (wp.dot(down, point.normal) / facing)) * width_m, point)
    patch = Footprint()
    patch.top_left = wp.vec3(point.uv[0], point.uv[1], 1.0) - 0.5 * (across + along)
    patch.top_right = patch.top_left + across
    patch.bottom_left = patch.top_left + along
    patch.bottom_right = patch.top_right + along
    return patch
