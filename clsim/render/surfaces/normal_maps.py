# ruff: noqa: SIM102
"""Normal maps and bump maps, as Warp functions."""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Surface
from clsim.render.features.features import Features
from clsim.render.sampling.sampling import luminance
from clsim.render.surfaces.materials import Materials
from clsim.render.textures.textures import make_textures

_LOWEST = wp.constant(0.01)
"""Sine of the least height over the surface to which a mirror direction is lifted."""


@wp.func
def lifted(n: wp.vec3, surface_normal: wp.vec3, wo: wp.vec3) -> wp.vec3:
    """Return the normal turned as little towards the surface's own as keeps the mirror direction of wo above it.

    After Keller et al., The Iray Light Transport Simulation and Rendering System, 2017, appendix A.3.
    """
    seen = n
    facing = wp.dot(n, wo)
    if facing < _LOWEST:
        seen = wp.normalize(n + wo * (_LOWEST - facing))
    mirror = seen * (2.0 * wp.dot(seen, wo)) - wo
    least = wp.min(_LOWEST, wp.dot(surface_normal, wo))
    height = wp.dot(surface_normal, mirror)
    if height < least:
        seen = wp.normalize(wo + wp.normalize(mirror + surface_normal * (least - height)))
    return seen


def make_normal_maps(features: Features) -> Any:
    """Return the Warp function ``mapped_normal(materials, surface, wo)`` for a surface that faces the viewer."""
    lookup, *_ = make_textures(features)

    @wp.func
    def height(materials: Materials, texture: int, uv: wp.vec2) -> float:
        rgba = lookup(materials.textures, texture, uv)
        return luminance(wp.vec3(rgba[0], rgba[1], rgba[2]))

    @wp.func
    def bumpy(materials: Materials, point: Surface, wo: wp.vec3) -> wp.vec3:
        """Heights raise the surface, which shades as if it went along there (Blinn, SIGGRAPH 1978)."""
        row = materials.rows[point.material]
        texture = materials.textures.rows[row.bump_texture]
        normal = point.shading_normal
        front = wp.where(point.front, normal, -normal)
        if wp.length(point.tangent) > 1.0e-12 and wp.length(point.bitangent) > 1.0e-12:
            across = float(wp.max(texture.width, 1))
            down = float(wp.max(texture.height, 1))
            m = texture.uv_matrix
            # Half a texel, in the coordinates of the mesh.
            du = wp.vec2(0.5 / wp.max(wp.max(wp.abs(m[0, 0]) * across, wp.abs(m[1, 0]) * down), 1.0e-6), 0.0)
            dv = wp.vec2(0.0, 0.5 / wp.max(wp.max(wp.abs(m[0, 1]) * across, wp.abs(m[1, 1]) * down), 1.0e-6))
            uv = point.uv
            at = row.bump_texture
            rise_u = (height(materials, at, uv + du) - height(materials, at, uv - du)) / (2.0 * du[0])
            rise_v = (height(materials, at, uv + dv) - height(materials, at, uv - dv)) / (2.0 * dv[1])
            along_u = point.tangent + front * (row.bump_scale * rise_u - wp.dot(front, point.tangent))
            along_v = point.bitangent + front * (row.bump_scale * rise_v - wp.dot(front, point.bitangent))
            bent = wp.normalize(wp.cross(along_u, along_v))
            if wp.dot(bent, front) < 0.0:
                bent = -bent
            normal = lifted(wp.where(point.front, bent, -bent), point.normal, wo)
        return normal

    @wp.func
    def mapped_normal(materials: Materials, point: Surface, wo: wp.vec3) -> wp.vec3:
        """The map is in the frame of uv, green to +v; seen from behind, bumps are dents."""
        row = materials.rows[point.material]
        normal = point.shading_normal
        if wp.static(features.bump_maps):
            if row.bump_texture >= 0:
                normal = bumpy(materials, point, wo)
        if row.normal_texture >= 0:
            front = wp.where(point.front, normal, -normal)
            tangent = point.tangent - front * wp.dot(front, point.tangent)
            length = wp.length(tangent)
            if length > 1.0e-12:
                tangent = tangent / length
                bitangent = wp.cross(front, tangent)
                if wp.dot(bitangent, point.bitangent) < 0.0:
                    bitangent = -bitangent
                rgba = lookup(materials.textures, row.normal_texture, point.uv)
                x = (2.0 * rgba[0] - 1.0) * row.normal_scale
                y = (2.0 * rgba[1] - 1.0) * row.normal_scale
                z = 2.0 * rgba[2] - 1.0
                bent = tangent * x + bitangent * y + front * z
                if wp.dot(bent, bent) > 1.0e-12:
                    bent = wp.normalize(bent)
                    normal = lifted(wp.where(point.front, bent, -bent), point.normal, wo)
        return normal

    return mapped_normal
