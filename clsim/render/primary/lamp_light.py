# ruff: noqa: SIM102, UP018, RUF046
"""Analytic direct light of lamps on the surfaces of a pixel, multiplied by its traced visibility, as Warp functions.

What a few lamps would send to a diffuse surface if nothing stood between is known in closed form: Lambert's formula for
polygons (1760), for spheres the one of Snyder (Area Light Sources for Real-Time Graphics, 1996). Only which share of it
arrives is found by rays: Σ V·f / Σ f over places on the lamps, where V is whether the way is free and f what comes from
there (Heitz, Hill, McGuire, Combining Analytic Direct Illumination and Stochastic Shadows, I3D 2018). Primary rays
end with one such way each. Where all that a pixel sees of a surface is lit, or all is dark, the share is exact.

Paths that begin there leave that light out.
"""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Geometry, make_sphere_at
from clsim.render.bsdf.plastic import passing_in
from clsim.render.camera.film import Sample
from clsim.render.emitters.lights import Lights, sphere_cone
from clsim.render.emitters.punctual import make_punctual
from clsim.render.features.features import Features
from clsim.render.primary.seen_surfaces import SeenSurface
from clsim.render.sampling.sampling import angle_of

_SMALL = wp.constant(1.0e-4)
"""Solid angle [sr] below which a triangle is a point: what the formula adds up would cancel in float32."""
_SAME_SHARE = wp.constant(0.01)


@wp.func
def same_share(lit_a: float, all_a: float, lit_b: float, all_b: float) -> bool:
    """Whether ``lit`` is the same share of ``all`` twice; so it is where either is 0, for then nothing was asked."""
    return wp.abs(lit_a * all_b - lit_b * all_a) <= _SAME_SHARE * all_a * all_b


@wp.func
def same_light(a: Sample, b: Sample) -> bool:
    """Whether the same share of the lamps' light reached what two rays saw, as far as both tell."""
    return same_share(a.lamp_lit, a.lamp_all, b.lamp_lit, b.lamp_all)


@wp.func
def sphere_irradiance(cosine: float, sin2: float) -> float:
    """Return the irradiance, for radiance 1, from a sphere that may lie partly behind the surface.

    ``cosine`` is that of the angle between normal and centre, ``sin2`` the squared sine of the half angle of the cone.
    """
    found = wp.pi * sin2 * wp.max(cosine, 0.0)
    if cosine * cosine < sin2:
        sine = wp.sqrt(wp.max(1.0 - cosine * cosine, 1.0e-12))
        x = wp.sqrt(1.0 / sin2 - 1.0)
        y = wp.clamp(-x * cosine / sine, -1.0, 1.0)
        above = sine * wp.sqrt(1.0 - y * y)
        found = (cosine * wp.acos(y) - x * above) * sin2 + wp.atan2(above, x)
    return wp.max(found, 0.0)


@wp.func
def _edge(a: wp.vec3, b: wp.vec3, normal: wp.vec3) -> float:
    """Return what an edge of a polygon adds to twice its irradiance, for radiance 1."""
    across = wp.cross(a, b)
    sine = wp.length(across)
    found = float(0.0)
    if sine > 0.0:
        found = angle_of(sine, wp.dot(a, b)) * wp.dot(across, normal) / sine
    return found


@wp.func
def triangle_irradiance(a: wp.vec3, b: wp.vec3, c: wp.vec3, normal: wp.vec3) -> float:
    """Return the irradiance, for radiance 1, from a triangle whose corners are seen from the lit point.

    What lies behind the surface is cut off.
    """
    # Each edge from p to q is cut where it passes through the surface's plane; between these cuts runs another edge.
    total = float(0.0)
    out = wp.vec3()
    back = wp.vec3()
    cuts = int(0)
    p = wp.vec3(c[0], c[1], c[2])
    q = wp.vec3(a[0], a[1], a[2])
    for i in range(3):
        high = wp.dot(p, normal)
        low = wp.dot(q, normal)
        if high > 0.0 and low > 0.0:
            total += _edge(p, q, normal)
        elif (high > 0.0) != (low > 0.0):
            cut = p + (q - p) * (high / (high - low))
            if high > 0.0:
                total += _edge(p, cut, normal)
                out = cut
            else:
                total += _edge(cut, q, normal)
                back = cut
            cuts = cuts + 1
        p = q
        q = wp.where(i == 0, b, c)
    if cuts == 2:
        total += _edge(out, back, normal)
    return 0.5 * wp.abs(total)


def make_lamp_light(features: Features, on_lamp: Any, shining: Any) -> Any:
    """Return the Warp function ``light_surfaces(lights, geometry, materials, surfaces, number, time)``.

    It adds to the ``emission`` of each surface of a pixel the direct light that it reflects.
    ``on_lamp`` is of `make_lights`, which takes the same ``shining``.
    """
    sphere_at = make_sphere_at(features)
    towards_punctual = make_punctual(features)

    @wp.func
    def through_coat(materials: Any, coated_by: int, towards: wp.vec3, normal: wp.vec3) -> float:
        share = float(1.0)
        if wp.static(features.coats):
            if coated_by > 0:
                share = passing_in(materials, coated_by - 1, wp.max(wp.dot(wp.normalize(towards), normal), 0.0))
        return share

    @wp.func
    def from_triangle(
        lights: Lights,
        geometry: Geometry,
        materials: Any,
        light: int,
        position: wp.vec3,
        normal: wp.vec3,
        coated_by: int,
        time: float,
    ) -> wp.vec3:
        lamp = on_lamp(lights, geometry, light, wp.vec3(1.0, 0.0, 0.0), time)
        a = lamp.position - position
        b = on_lamp(lights, geometry, light, wp.vec3(0.0, 1.0, 0.0), time).position - position
        c = on_lamp(lights, geometry, light, wp.vec3(0.0, 0.0, 1.0), time).position - position
        away = (a + b + c) / 3.0
        distance2 = wp.max(wp.dot(away, away), 1.0e-30)
        facing = wp.dot(lamp.normal, away)
        if facing > 0.0:
            lamp.front = False
        solid = lamp.area * wp.abs(facing) / (distance2 * wp.sqrt(distance2))
        if solid < _SMALL:
            form = solid * wp.max(wp.dot(away, normal), 0.0) / wp.sqrt(distance2)
        else:
            form = triangle_irradiance(a, b, c, normal)
        return shining(materials, lamp) * (form * through_coat(materials, coated_by, away, normal))

    @wp.func
    def from_sphere(
        lights: Lights,
        geometry: Geometry,
        materials: Any,
        index: int,
        position: wp.vec3,
        normal: wp.vec3,
        coated_by: int,
        time: float,
    ) -> wp.vec3:
        sphere = sphere_at(geometry, index, time)
        found = wp.vec3()
        if sphere_cone(sphere, position) > 0.0:
            away = wp.vec3(sphere[0], sphere[1], sphere[2]) - position
            distance = wp.length(away)
            sine = sphere[3] / distance
            cosine = wp.dot(away, normal) / distance
            form = sphere_irradiance(cosine, sine * sine) * through_coat(materials, coated_by, away, normal)
            found = lights.sphere_radiance[index] * form
        return found

    @wp.func
    def lamp_light(
        lights: Lights,
        geometry: Geometry,
        materials: Any,
        position: wp.vec3,
        normal: wp.vec3,
        coated_by: int,
        time: float,
    ) -> wp.vec3:
        """Return the irradiance over π that all lamps send to a point if nothing stands between.

        Where it is ``coated_by`` the material of that number from 1, light that the coat lets pass counts; as much as
        it does from the lamp's middle.
        """
        total = wp.vec3()
        for light in range(lights.first_environment):
            # One that is never drawn is left to scattering.
            if lights.probability[light] > 0.0:
                if wp.static(features.triangle_lights):
                    if light < lights.first_sphere:
                        total += from_triangle(lights, geometry, materials, light, position, normal, coated_by, time)
                if wp.static(features.sphere_lights):
                    if light >= lights.first_sphere and light < lights.first_punctual:
                        sphere = light - lights.first_sphere
                        total += from_sphere(lights, geometry, materials, sphere, position, normal, coated_by, time)
                if wp.static(features.punctual_lights):
                    if light >= lights.first_punctual:
                        found = towards_punctual(
                            lights.punctual, materials.textures, light - lights.first_punctual, position, time
                        )
                        form = wp.max(wp.dot(found.direction, normal), 0.0)
                        form = form * through_coat(materials, coated_by, found.direction, normal)
                        total += found.irradiance * form
        return total / wp.pi

    @wp.func
    def light_surfaces(
        lights: Lights,
        geometry: Geometry,
        materials: Any,
        surfaces: wp.array[SeenSurface],
        number: int,
        time: float,
    ) -> None:
        share = float(0.0)
        for k in range(number):
            first = surfaces[k].first
            if first.lamp:
                lit = surfaces[k].lamp_lit
                most = surfaces[k].lamp_all
                if most <= 0.0:
                    lit = first.lamp_lit
                    most = first.lamp_all
                if most <= 0.0:
                    # No shadow ray started here: the visibility is that of the surface before.
                    lit = share
                    most = 1.0
                share = lit / most
                if lit > 0.0:
                    normal = wp.normalize(surfaces[k].normal)
                    light = lamp_light(lights, geometry, materials, surfaces[k].position, normal, first.coated_by, time)
                    surfaces[k].from_lamps = wp.cw_mul(surfaces[k].albedo, light) * (lit / most)
                    surfaces[k].emission += surfaces[k].from_lamps

    return light_surfaces
