# ruff: noqa: SIM102
"""The BSDF: one pair of Warp functions for all scattering models that a scene has.

Each model is a file ``bsdf_*``: ``value`` gives f·cos θ and the density of its own sampling for two directions,
``sample`` draws a direction. Here directions are those of the world.
"""

from typing import Any

import warp as wp

from clsim.render.bsdf.conductor import conductor_fresnel, make_conductor
from clsim.render.bsdf.dielectric import make_dielectric, thin_sample
from clsim.render.bsdf.diffuse import diffuse_sample, diffuse_value
from clsim.render.bsdf.disney import disney_sample, disney_value
from clsim.render.bsdf.parts import Outgoing, Scattered, Scattering
from clsim.render.bsdf.plastic import make_plastic
from clsim.render.bsdf.principled import principled_sample, principled_value
from clsim.render.features.bsdf_kinds import (
    CONDUCTOR,
    DIELECTRIC,
    DIFFUSE,
    DISNEY,
    PLASTIC,
    PRINCIPLED,
    THIN_DIELECTRIC,
)
from clsim.render.features.features import Features
from clsim.render.sampling.sampling import tangent_frame
from clsim.render.surfaces.materials import Bsdf, Materials


def make_bsdf(features: Features) -> tuple[Any, Any, Any, Any]:
    """Return the Warp functions ``outgoing``, ``value``, ``sample`` and ``albedo``.

    ``outgoing(materials, bsdf, normal, wo)`` is what the next two need of the way to where a point is seen from:
    ``value(materials, bsdf, normal, out, wi)`` and ``sample(materials, bsdf, normal, out, choice, u)``. Directions are
    of unit length and lead away from the surface, ``wo`` on the side of the shading normal.
    """
    kinds = features.kinds
    glossy = kinds != ("diffuse",)
    conductor_value, conductor_sample = make_conductor(features)
    dielectric_value, dielectric_sample = make_dielectric(features)
    leaving_plastic, plastic_value, plastic_sample = make_plastic(features)

    @wp.func
    def frame_of(b: Bsdf, normal: wp.vec3) -> wp.mat33:
        """Return a rotation to the world whose third axis is the normal, the first along u where that matters."""
        frame = tangent_frame(normal)
        if wp.static(features.anisotropic):
            along = b.tangent - normal * wp.dot(normal, b.tangent)
            if wp.length(along) > 1.0e-12:
                first = wp.normalize(along)
                frame = wp.matrix_from_cols(first, wp.cross(normal, first), normal)
        return frame

    @wp.func
    def outgoing(materials: Materials, b: Bsdf, normal: wp.vec3, wo: wp.vec3) -> Outgoing:
        out = Outgoing()
        if wp.static(glossy):
            if b.kind != DIFFUSE:
                out.frame = frame_of(b, normal)
                out.wo = wp.transpose(out.frame) * wo
                if wp.static("plastic" in kinds):
                    if b.kind == PLASTIC:
                        out = leaving_plastic(materials.transmittance, b, out)
        return out

    @wp.func
    def value(materials: Materials, b: Bsdf, normal: wp.vec3, out: Outgoing, wi: wp.vec3) -> Scattering:
        result = Scattering()
        if wp.static("diffuse" in kinds):
            if b.kind == DIFFUSE:
                result = diffuse_value(b, normal, wi)
        if wp.static(glossy):
            if b.kind != DIFFUSE and not b.mirror:
                wo = out.wo
                in_local = wp.transpose(out.frame) * wi
                if wp.static("conductor" in kinds):
                    if b.kind == CONDUCTOR:
                        result = conductor_value(b, wo, in_local)
                if wp.static("dielectric" in kinds):
                    if b.kind == DIELECTRIC:
                        result = dielectric_value(b, wo, in_local)
                if wp.static("plastic" in kinds):
                    if b.kind == PLASTIC:
                        result = plastic_value(materials.transmittance, b, out, in_local)
                if wp.static("principled" in kinds):
                    if b.kind == PRINCIPLED:
                        result = principled_value(b, wo, in_local)
                if wp.static("disney" in kinds):
                    if b.kind == DISNEY:
                        result = disney_value(materials, b, wo, in_local)
        return result

    @wp.func
    def sample(materials: Materials, b: Bsdf, normal: wp.vec3, out: Outgoing, choice: float, u: wp.vec2) -> Scattered:
        s = Scattered()
        if wp.static("diffuse" in kinds):
            if b.kind == DIFFUSE:
                s = diffuse_sample(b, normal, u)
        if wp.static(glossy):
            if b.kind != DIFFUSE:
                wo = out.wo
                if wp.static("conductor" in kinds):
                    if b.kind == CONDUCTOR:
                        s = conductor_sample(b, wo, u)
                if wp.static("dielectric" in kinds):
                    if b.kind == DIELECTRIC:
                        s = dielectric_sample(b, wo, choice, u)
                if wp.static("thin-dielectric" in kinds):
                    if b.kind == THIN_DIELECTRIC:
                        s = thin_sample(b, wo, choice)
                if wp.static("plastic" in kinds):
                    if b.kind == PLASTIC:
                        s = plastic_sample(materials.transmittance, b, out, choice, u)
                if wp.static("principled" in kinds):
                    if b.kind == PRINCIPLED:
                        s = principled_sample(b, wo, choice, u)
                if wp.static("disney" in kinds):
                    if b.kind == DISNEY:
                        s = disney_sample(materials, b, wo, choice, u)
                s.direction = wp.normalize(out.frame * s.direction)
        return s

    @wp.func
    def albedo(b: Bsdf) -> wp.vec3:
        """The colour that denoisers expect: diffuse reflectance or base colour, F0 of metals, white for glass."""
        color = b.color
        if wp.static("conductor" in kinds):
            if b.kind == CONDUCTOR:
                color = conductor_fresnel(b, 1.0)
        if wp.static("dielectric" in kinds or "thin-dielectric" in kinds):
            if b.kind == DIELECTRIC or b.kind == THIN_DIELECTRIC:
                color = wp.vec3(1.0, 1.0, 1.0)
        if wp.static(features.dark_backs):
            if b.dark:
                color = wp.vec3()
        return color

    return outgoing, value, sample, albedo
