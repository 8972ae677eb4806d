# ruff: noqa: SIM102, UP018, RUF046
"""Analytic direct light of lamps on the surfaces of a pixel, multiplied by its traced visibility, as Warp functions.

What a few lamps would send to a diffuse surface if nothing stood between is known in closed form: Lambert's formula for
polygons (1760), for spheres the one of Snyder (Area Light Sources for Real-Time Graphics, 1996). Only which share of it
arrives is found by rays: Σ V·f / Σ f over places on the lamps, where V is whether the way is free and f what comes from
there (Heitz, Hill, McGuire, Combining Analytic Direct Illumination and Stochastic Shadows, I3D 2018). Primary rays
end with one such way each. Where all that a pixel sees of a surface is lit, or all is dark, the share is exact.

Paths that begin there leave that light out.
"""

import math
from typing import Any

import warp as wp

from clsim.render.accel.geometry import Geometry, make_sphere_at
from clsim.render.bsdf.plastic import passing_in
from clsim.render.bsdf.principled import passing_principled_from
from clsim.render.bsdf.reflections import (
    Lobe,
    clear_coat_lobe,
    coat_lobe,
    counted,
    reflected_from,
    reflected_of,
)
from clsim.render.camera.film import Sample
from clsim.render.emitters.lights import Lights, sphere_cone
from clsim.render.emitters.punctual import make_punctual
from clsim.render.features.bsdf_kinds import PLASTIC
from clsim.render.features.features import Features
from clsim.render.primary.seen_surfaces import SeenSurface
from clsim.render.sampling.sampling import angle_of, around, tangent_frame
from clsim.render.surfaces.materials import Bsdf

_SMALL = wp.constant(1.0e-4)
"""Solid angle [sr] below which a triangle is a point: what the formula adds up would cancel in float32."""
_SAME_SHARE = wp.constant(0.01)
_AS_WIDE = wp.constant(math.sqrt(math.pi / (4.0 * math.sin(math.pi / 4.0))))
"""Radius of an octagon that is as large as a circle of radius 1."""
_EIGHTH = wp.constant(math.sqrt(0.5))
_WITHIN = wp.constant(1.0 / 3.0)
"""By how much normals that turn within a pixel make α² larger, over 1 − the square of the length of their mean.

That length is of the four corners' normals, which lie three times as far apart as those of all places do.
"""


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


@wp.func
def mean_cosine(cosine: float, solid: float) -> float:
    """Return the mean cosine under which light of a lamp arrives, each part weighed by what it sends.

    ``cosine`` is that of the lamp's middle; parts of it lie as far above and below as its solid angle says, and those
    behind the surface send nothing.
    """
    # About as wide as a disk is on the whole.
    width = 0.7 * wp.sqrt(solid / wp.pi)
    high = wp.clamp(cosine + width, 1.0e-4, 1.0)
    low = wp.clamp(cosine - width, 0.0, high)
    return (high * high + high * low + low * low) / (1.5 * (high + low))


@wp.struct
class LitPlace:
    """A place that lamps light: its normal, the number from 1 of a material whose coat it has, 0 for none.

    ``coat`` is what this reflects to where the place is seen from, ``clear`` what a clear coat over it does.
    """

    position: wp.vec3
    normal: wp.vec3
    coated_by: int
    coat: Lobe
    clear: Lobe


@wp.struct
class Lit:
    """Light of lamps at a point, if nothing stood between: the irradiance of its base, and what its coat reflects."""

    base: wp.vec3
    coat: wp.vec3


@wp.func
def reflected_of_triangle(lobe: Lobe, a: wp.vec3, b: wp.vec3, c: wp.vec3, solid: float) -> wp.vec3:
    """Return what a coat reflects of a triangle of radiance 1, whose solid angle is about ``solid``."""
    found = wp.vec3()
    if solid < _SMALL:
        found = reflected_from(lobe, wp.normalize(a + b + c)) * solid
    else:
        p = lobe.inverse * a
        q = lobe.inverse * b
        r = lobe.inverse * c
        inside = triangle_irradiance(p, q, r, wp.vec3(0.0, 0.0, 1.0)) / wp.pi
        found = reflected_of(lobe, inside, counted(p) + counted(q) + counted(r))
    return found


@wp.func
def reflected_of_sphere(lobe: Lobe, towards: wp.vec3, sin2: float) -> wp.vec3:
    """Return what a coat reflects of a sphere of radiance 1, seen in that direction in a cone of that squared sine.

    It is taken for a polygon of eight corners and of the same solid angle.
    """
    found = wp.vec3()
    if wp.pi * sin2 < _SMALL:
        found = reflected_from(lobe, towards) * (wp.pi * sin2)
    else:
        frame = tangent_frame(towards)
        radius = _AS_WIDE * wp.sqrt(sin2 / wp.max(1.0 - sin2, 1.0e-4))
        x = wp.vec3(frame[0, 0], frame[1, 0], frame[2, 0]) * radius
        y = wp.vec3(frame[0, 1], frame[1, 1], frame[2, 1]) * radius
        first = lobe.inverse * (towards + x)
        last = lobe.inverse * (towards + (x + y) * _EIGHTH)
        middle = counted(first) + counted(last)
        inside = float(0.0)
        # As a variable, so that the loop is compiled once.
        corners = int(8)
        for k in range(2, corners):
            turn = around(float(k) / 8.0)
            corner = lobe.inverse * (towards + x * turn[0] + y * turn[1])
            inside += triangle_irradiance(first, last, corner, wp.vec3(0.0, 0.0, 1.0))
            middle += counted(corner)
            last = corner
        found = reflected_of(lobe, inside / wp.pi, middle)
    return found


def make_lamp_light(features: Features, on_lamp: Any, shining: Any) -> Any:
    """Return the Warp function ``light_surfaces(lights, geometry, materials, surfaces, number, time)``.

    It adds to the ``emission`` of each surface of a pixel the direct light that it reflects.
    ``on_lamp`` is of `make_lights`, which takes the same ``shining``.
    """
    sphere_at = make_sphere_at(features)
    towards_punctual = make_punctual(features)

    @wp.func
    def through_coat(materials: Any, at: LitPlace, cosine: float) -> float:
        """Return how much more light from a direction reaches the base than of light from all around."""
        share = float(1.0)
        if wp.static(features.coats):
            if at.coated_by > 0:
                row = materials.rows[at.coated_by - 1]
                into = wp.clamp(cosine, 0.0, 1.0)
                if row.kind == PLASTIC:
                    share = passing_in(materials, at.coated_by - 1, into)
                else:
                    b = Bsdf()
                    b.eta = row.ior
                    b.specular = row.specular
                    b.clearcoat = row.clearcoat
                    share = passing_principled_from(b, wp.clamp(wp.dot(at.normal, at.coat.wo), 0.0, 1.0), into)
        return share

    @wp.func
    def from_triangle(lights: Lights, geometry: Geometry, materials: Any, light: int, at: LitPlace, time: float) -> Lit:
        lamp = on_lamp(lights, geometry, light, wp.vec3(1.0, 0.0, 0.0), time)
        a = lamp.position - at.position
        b = on_lamp(lights, geometry, light, wp.vec3(0.0, 1.0, 0.0), time).position - at.position
        c = on_lamp(lights, geometry, light, wp.vec3(0.0, 0.0, 1.0), time).position - at.position
        away = (a + b + c) / 3.0
        distance2 = wp.max(wp.dot(away, away), 1.0e-30)
        facing = wp.dot(lamp.normal, away)
        if facing > 0.0:
            lamp.front = False
        solid = lamp.area * wp.abs(facing) / (distance2 * wp.sqrt(distance2))
        if solid < _SMALL:
            form = solid * wp.max(wp.dot(away, at.normal), 0.0) / wp.sqrt(distance2)
        else:
            form = triangle_irradiance(a, b, c, at.normal)
        radiance = shining(materials, lamp)
        lit = Lit()
        cosine = mean_cosine(wp.dot(away, at.normal) / wp.sqrt(distance2), solid)
        lit.base = radiance * (form * through_coat(materials, at, cosine))
        if wp.static(features.coats):
            if at.coated_by > 0:
                share = reflected_of_triangle(at.coat, a, b, c, solid)
                if at.clear.density > 0.0:
                    share += reflected_of_triangle(at.clear, a, b, c, solid)
                lit.coat = wp.cw_mul(radiance, share)
        return lit

    @wp.func
    def from_sphere(lights: Lights, geometry: Geometry, materials: Any, index: int, at: LitPlace, time: float) -> Lit:
        sphere = sphere_at(geometry, index, time)
        lit = Lit()
        if sphere_cone(sphere, at.position) > 0.0:
            away = wp.vec3(sphere[0], sphere[1], sphere[2]) - at.position
            distance = wp.length(away)
            sine = sphere[3] / distance
            cosine = wp.dot(away, at.normal) / distance
            form = sphere_irradiance(cosine, sine * sine)
            form = form * through_coat(materials, at, mean_cosine(cosine, wp.pi * sine * sine))
            lit.base = lights.sphere_radiance[index] * form
            if wp.static(features.coats):
                if at.coated_by > 0:
                    share = reflected_of_sphere(at.coat, away / distance, sine * sine)
                    if at.clear.density > 0.0:
                        share += reflected_of_sphere(at.clear, away / distance, sine * sine)
                    lit.coat = wp.cw_mul(lights.sphere_radiance[index], share)
        return lit

    @wp.func
    def from_punctual(lights: Lights, materials: Any, index: int, at: LitPlace, time: float) -> Lit:
        found = towards_punctual(lights.punctual, materials.textures, index, at.position, time)
        form = wp.max(wp.dot(found.direction, at.normal), 0.0)
        form = form * through_coat(materials, at, form)
        lit = Lit()
        lit.base = found.irradiance * form
        if wp.static(features.coats):
            if at.coated_by > 0:
                if not at.coat.mirror:
                    lit.coat = wp.cw_mul(found.irradiance, reflected_from(at.coat, found.direction))
                if at.clear.density > 0.0 and not at.clear.mirror:
                    lit.coat += wp.cw_mul(found.irradiance, reflected_from(at.clear, found.direction))
        return lit

    @wp.func
    def lamp_light(lights: Lights, geometry: Geometry, materials: Any, at: LitPlace, time: float) -> Lit:
        """Return what all lamps send to a place if nothing stands between: the base's over π.

        Of a coated place's base, light counts that its coat lets pass; as much as it does from the lamp's middle.
        """
        total = Lit()
        for light in range(lights.first_environment):
            # One that is never drawn is left to scattering.
            if lights.probability[light] > 0.0:
                one = Lit()
                if wp.static(features.triangle_lights):
                    if light < lights.first_sphere:
                        one = from_triangle(lights, geometry, materials, light, at, time)
                if wp.static(features.sphere_lights):
                    if light >= lights.first_sphere and light < lights.first_punctual:
                        one = from_sphere(lights, geometry, materials, light - lights.first_sphere, at, time)
                if wp.static(features.punctual_lights):
                    if light >= lights.first_punctual:
                        one = from_punctual(lights, materials, light - lights.first_punctual, at, time)
                total.base += one.base
                total.coat += one.coat
        total.base = total.base / wp.pi
        return total

    @wp.func
    def place_of(materials: Any, surface: SeenSurface) -> LitPlace:
        """Return where a surface is lit, and what its coat reflects."""
        first = surface.first
        at = LitPlace()
        at.position = surface.position
        at.normal = wp.normalize(surface.normal)
        at.coated_by = first.coated_by
        if wp.static(features.coats):
            if at.coated_by > 0:
                # Where all rays come from; behind mirrors, where they seem to.
                eye = first.position - first.toward * first.depth
                wo = wp.normalize(eye - at.position)
                turns = wp.max(1.0 - wp.length_sq(surface.normal), 0.0)
                at.coat = coat_lobe(materials, at.coated_by - 1, at.normal, wo, turns * _WITHIN)
                if materials.rows[at.coated_by - 1].clearcoat > 0.0:
                    at.clear = clear_coat_lobe(materials, at.coated_by - 1, at.normal, wo, turns * _WITHIN)
        return at

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
                    light = lamp_light(lights, geometry, materials, place_of(materials, surfaces[k]), time)
                    surfaces[k].from_lamps = wp.cw_mul(surfaces[k].albedo, light.base) * (lit / most)
                    if wp.static(features.coats):
                        if first.coated_by > 0:
                            # Of the coat's albedo, all but what mirrors on the way here left is in the light.
                            tint = surfaces[k].coat / wp.max(1.0 - surfaces[k].passing, 1.0e-6)
                            seen = lit / most
                            # What stands between a lamp and its reflection is not what shades most of its light.
                            if surfaces[k].coat_all > 0.0:
                                seen = surfaces[k].coat_lit / surfaces[k].coat_all
                            surfaces[k].from_lamps += wp.cw_mul(tint, light.coat) * seen
                    surfaces[k].emission += surfaces[k].from_lamps

    return light_surfaces
