# Warp: a variable that changes must be born by a call, and wp.static drops a branch only where it stands alone.
# ruff: noqa: SIM102, UP018
"""Lights and how they are sampled, as Warp functions.

Lights are numbered: emitting triangles first (each instance's own), then spheres, then the environment. One is drawn
by its power; the cumulative table holds multiples of 2⁻²⁴, as the random numbers do, so that probabilities are exact. A
light whose share rounds to nothing is never drawn, and then counts fully when scattering finds it.
"""

from typing import Any

import warp as wp

from clsim.render.features import Features
from clsim.render.geometry import FAR, Geometry, Surface, hit_sphere, offset_origin
from clsim.render.sampling import cone, cosine_hemisphere, uniform_triangle


@wp.struct
class Lights:
    """The light table; ``cumulative[i]`` is the probability that a light of number ≤ i is drawn."""

    cumulative: wp.array(dtype=float)
    probability: wp.array(dtype=float)
    instance: wp.array(dtype=int)
    triangle: wp.array(dtype=int)
    instance_first: wp.array(dtype=int)
    triangle_rank: wp.array(dtype=int)
    first_sphere: int
    sphere_radiance: wp.array(dtype=wp.vec3)
    environment: wp.vec3
    environment_probability: float


@wp.struct
class LightSample:
    """A direction to a light: its density per steradian (0: no light there), radiance and where the shadow ray ends."""

    direction: wp.vec3
    pdf: float
    radiance: wp.vec3
    origin: wp.vec3
    distance: float


@wp.func
def sphere_cone(sphere: wp.vec4, position: wp.vec3) -> float:
    """Return 1 − cos of the half angle under which a sphere is seen; 0 from inside or too near its surface."""
    to_centre = wp.vec3(sphere[0], sphere[1], sphere[2]) - position
    sin2 = sphere[3] * sphere[3] / wp.max(wp.dot(to_centre, to_centre), 1.0e-30)
    size = float(0.0)
    if sin2 < 0.9999:
        size = sin2 / (1.0 + wp.sqrt(1.0 - sin2))
    return size


def make_lights(features: Features, surface: Any, emitted: Any) -> tuple[Any, Any, Any, Any]:
    """Return the Warp functions ``sample_light`` and the densities with which it draws what scattering finds."""

    @wp.func
    def triangle_pdf(
        lights: Lights, instance: int, triangle: int, point: Surface, direction: wp.vec3, t: float
    ) -> float:
        pdf = float(0.0)
        rank = lights.triangle_rank[triangle]
        cosine = wp.abs(wp.dot(point.normal, direction))
        if rank >= 0 and cosine * point.area > 1.0e-20:
            probability = lights.probability[lights.instance_first[instance] + rank]
            pdf = probability * t * t / (cosine * point.area)
        return pdf

    @wp.func
    def sphere_pdf(lights: Lights, geometry: Geometry, index: int, position: wp.vec3) -> float:
        pdf = float(0.0)
        size = sphere_cone(geometry.spheres[index], position)
        if size > 0.0:
            pdf = lights.probability[lights.first_sphere + index] / (2.0 * wp.pi * size)
        return pdf

    @wp.func
    def environment_pdf(lights: Lights, normal: wp.vec3, direction: wp.vec3) -> float:
        return lights.environment_probability * wp.max(wp.dot(normal, direction), 0.0) / wp.pi

    @wp.func
    def sample_light(
        lights: Lights, geometry: Geometry, materials: Any, point: Surface, choice: float, u: wp.vec2
    ) -> LightSample:
        sample = LightSample()
        sample.pdf = 0.0
        # Half a step up, so that the first entry above ``choice`` is found.
        light = wp.lower_bound(lights.cumulative, choice + 2.9802322e-08)
        if wp.static(features.triangle_lights):
            if light < lights.first_sphere:
                weights = uniform_triangle(u)
                instance = lights.instance[light]
                triangle = lights.triangle[light]
                lamp = surface(geometry, instance, triangle, weights[0], weights[1])
                away = lamp.position - point.position
                distance2 = wp.dot(away, away)
                if distance2 > 1.0e-30 and wp.dot(away, point.normal) > 0.0:
                    toward = away / wp.sqrt(distance2)
                    if wp.dot(lamp.normal, toward) > 0.0:
                        lamp.front = False
                        lamp.normal = -lamp.normal
                    sample.pdf = triangle_pdf(lights, instance, triangle, lamp, toward, wp.sqrt(distance2))
                    sample.radiance = emitted(materials, lamp)
                    sample.origin = offset_origin(point.position, point.normal, geometry.scale_m)
                    # The shadow ray ends as far before the lamp as it starts off the surface.
                    shadow = offset_origin(lamp.position, lamp.normal, geometry.scale_m) - sample.origin
                    sample.distance = wp.length(shadow)
                    sample.direction = shadow / sample.distance
        if wp.static(features.sphere_lights):
            if light >= lights.first_sphere and light < lights.first_sphere + geometry.spheres.shape[0]:
                index = light - lights.first_sphere
                sphere = geometry.spheres[index]
                size = sphere_cone(sphere, point.position)
                if size > 0.0:
                    centre = wp.vec3(sphere[0], sphere[1], sphere[2])
                    toward = cone(wp.normalize(centre - point.position), size, u)
                    if wp.dot(toward, point.normal) > 0.0:
                        sample.pdf = lights.probability[light] / (2.0 * wp.pi * size)
                        sample.radiance = lights.sphere_radiance[index]
                        sample.direction = toward
                        sample.origin = offset_origin(point.position, point.normal, geometry.scale_m)
                        t = hit_sphere(sphere, sample.origin, toward)
                        if t < 0.0:  # grazes the edge by rounding
                            t = wp.dot(centre - sample.origin, toward)
                        sample.distance = 0.9999 * t
        if wp.static(features.environment):
            if light == lights.first_sphere + geometry.spheres.shape[0]:
                toward = cosine_hemisphere(point.shading_normal, u)
                if wp.dot(toward, point.normal) > 0.0:
                    sample.pdf = environment_pdf(lights, point.shading_normal, toward)
                    sample.radiance = lights.environment
                    sample.direction = toward
                    sample.origin = offset_origin(point.position, point.normal, geometry.scale_m)
                    sample.distance = FAR
        return sample

    return sample_light, triangle_pdf, sphere_pdf, environment_pdf
