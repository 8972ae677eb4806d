# ruff: noqa: SIM102, UP018
"""Lights and how they are sampled, as Warp functions.

Lights are numbered: emitting triangles first (each instance's own), then spheres, punctual lights, and the environment.
One is drawn by its power; the cumulative table holds multiples of 2⁻²⁴, as the random numbers do, so that probabilities
are exact. A light whose share rounds to nothing is never drawn, and then counts fully when scattering finds it.
Where several lights stand still, they are one entry of that table, the last, and a tree tells which of them is drawn.
"""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import FAR, Geometry, Surface, hit_sphere, make_sphere_at, offset_origin
from clsim.render.emitters.environment import (
    STEP,
    EnvironmentImage,
    EnvironmentSample,
    environment_towards,
    sample_environment,
)
from clsim.render.emitters.light_tree import LightChoice, LightTree, Receiver, make_light_tree
from clsim.render.emitters.punctual import Punctual, make_punctual
from clsim.render.features.features import Features
from clsim.render.sampling.sampling import cone, cosine_hemisphere, uniform_triangle

_UNCERTAIN = wp.constant(1.0e-6)
"""Some ten roundings: by so many the place where a ray meets a triangle errs for each size of it that the way has."""
_MOST_UNCERTAIN = wp.constant(0.01)
NEVER = wp.constant(1.0e-9)
"""Probability for light that is never drawn, by which may be divided."""


@wp.struct
class Lamp:
    """An emitting triangle that stands still, in world space: all that drawing a point on it needs, side by side."""

    corner: wp.vec3
    reach_m: float
    edge1: wp.vec3
    edge2: wp.vec3
    normal: wp.vec3
    area: float
    material: int


@wp.struct
class Lights:
    """The light table; ``cumulative[i]`` is the probability that a light of number ≤ i is drawn.

    ``probability`` is that of each; lights of the tree have none in these tables.
    """

    cumulative: wp.array[float]
    probability: wp.array[float]
    instance: wp.array[int]
    triangle: wp.array[int]
    instance_first: wp.array[int]
    triangle_rank: wp.array[int]
    lamps: wp.array[Lamp]
    first_sphere: int
    sphere_radiance: wp.array[wp.vec3]
    first_punctual: int
    punctual: Punctual
    first_environment: int
    environment: wp.vec3
    environment_image: EnvironmentImage
    environment_probability: float
    tree: LightTree


@wp.struct
class LightSample:
    """A direction to a light: its density per steradian (0: no light there), radiance and where the shadow ray ends.

    A ``delta`` light has no size: ``pdf`` is its probability, ``radiance`` its irradiance across the direction, and
    scattering never finds it. Of an image of the environment, whose ``radiance`` and ``pdf`` here are 1, `environment`
    tells them where it is ``mapped``: its texels are read only for rays that nothing stops. ``visible`` is what arrives
    of it, 0 to 1, where that is known.
    """

    direction: wp.vec3
    delta: bool
    mapped: bool
    pdf: float
    radiance: wp.vec3
    origin: wp.vec3
    distance: float
    visible: float


@wp.func
def sphere_cone(sphere: wp.vec4, position: wp.vec3) -> float:
    """Return 1 − cos of the half angle under which a sphere is seen; 0 from inside or too near its surface."""
    to_centre = wp.vec3(sphere[0], sphere[1], sphere[2]) - position
    sin2 = sphere[3] * sphere[3] / wp.max(wp.dot(to_centre, to_centre), 1.0e-30)
    size = float(0.0)
    if sin2 < 0.9999:
        size = sin2 / (1.0 + wp.sqrt(1.0 - sin2))
    return size


def make_side(features: Features) -> Any:
    """Return the Warp function ``side(normal, toward)``: the normal on the side to which a direction leads.

    Where nothing passes light it is the normal itself, so that directions behind the surface are told by it.
    """

    @wp.func
    def side(normal: wp.vec3, toward: wp.vec3) -> wp.vec3:
        leaving = normal
        if wp.static(features.transmission):
            if wp.dot(normal, toward) < 0.0:
                leaving = -normal
        return leaving

    return side


def make_lights(features: Features, surface: Any, emitted: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Return the Warp functions ``sample_light`` and, for what scattering finds, the densities with which it draws.

    They are ``triangle_pdf``, ``sphere_pdf`` and ``environment``, which also tells its radiance. The last function is
    ``on_lamp``: a point of a triangle, by its number among the lights and the weights of its corners.
    """
    sphere_at = make_sphere_at(features)
    towards_punctual = make_punctual(features)
    side = make_side(features)
    draw_of_tree, pdf_of_tree = make_light_tree(features)

    @wp.func
    def choose(lights: Lights, to: Receiver, u: float, finer: float) -> LightChoice:
        # A step up, so that the first entry above ``u`` is found.
        choice = LightChoice(wp.lower_bound(lights.cumulative, u + STEP), 0.0)  # type: ignore[call-arg]
        if wp.static(features.light_tree):
            if choice.light > lights.first_environment:
                left = (u + lights.tree.probability - 1.0) / lights.tree.probability
                choice = draw_of_tree(lights.tree, to, left, finer)
                choice.probability = choice.probability * lights.tree.probability
            else:
                choice.probability = lights.probability[choice.light]
        else:
            choice.probability = lights.probability[choice.light]
        return choice

    @wp.func
    def chance(lights: Lights, light: int, to: Receiver) -> float:
        """The probability with which a light is drawn for a point."""
        probability = lights.probability[light]
        if wp.static(features.light_tree):
            if lights.tree.slots[light] >= 0:
                probability = lights.tree.probability * pdf_of_tree(lights.tree, light, to)
        return probability

    @wp.func
    def area_pdf(probability: float, point: Surface, direction: wp.vec3, t: float) -> float:
        """The density per steradian of a point that is drawn evenly on a triangle with that probability."""
        pdf = float(0.0)
        cosine = wp.abs(wp.dot(point.normal, direction))
        if cosine * point.area > 1.0e-20:
            pdf = probability * t * t / (cosine * point.area)
        return pdf

    @wp.func
    def triangle_pdf(
        lights: Lights, instance: int, triangle: int, point: Surface, direction: wp.vec3, seen_from: Receiver
    ) -> float:
        pdf = float(0.0)
        rank = lights.triangle_rank[triangle]
        if rank >= 0:
            probability = chance(lights, lights.instance_first[instance] + rank, seen_from)
            pdf = area_pdf(probability, point, direction, wp.length(point.position - seen_from.position))
        return pdf

    @wp.func
    def on_lamp(lights: Lights, geometry: Geometry, light: int, weights: wp.vec3, time: float) -> Surface:
        point = Surface()
        if wp.static(features.still_lamps):
            lamp = lights.lamps[light]
            point.position = lamp.corner + lamp.edge1 * weights[1] + lamp.edge2 * weights[2]
            point.normal = lamp.normal
            point.area = lamp.area
            point.reach_m = lamp.reach_m
            point.material = lamp.material
            point.front = True
        else:
            point = surface(geometry, lights.instance[light], lights.triangle[light], weights[0], weights[1], time)
        return point

    @wp.func
    def sphere_pdf(lights: Lights, geometry: Geometry, index: int, seen_from: Receiver, time: float) -> float:
        pdf = float(0.0)
        size = sphere_cone(sphere_at(geometry, index, time), seen_from.position)
        if size > 0.0:
            pdf = chance(lights, lights.first_sphere + index, seen_from) / (2.0 * wp.pi * size)
        return pdf

    @wp.func
    def environment(lights: Lights, normal: wp.vec3, direction: wp.vec3) -> EnvironmentSample:
        if wp.static(features.environment_map):
            sample = environment_towards(lights.environment_image, direction)
        else:
            sample = EnvironmentSample(direction, lights.environment, wp.max(wp.dot(normal, direction), 0.0) / wp.pi)  # type: ignore[call-arg]
        sample.pdf = sample.pdf * lights.environment_probability
        return sample

    # Each is called from one place, where the compiler puts it whole; else the scene would be copied for the call.
    @wp.func(inline=True)
    def towards_triangle(
        lights: Lights, geometry: Geometry, materials: Any, point: Surface, drawn: LightChoice, u: wp.vec2, time: float
    ) -> LightSample:
        sample = LightSample()
        lamp = on_lamp(lights, geometry, drawn.light, uniform_triangle(u), time)
        away = lamp.position - point.position
        leaving = side(point.normal, away)
        distance2 = wp.dot(away, away)
        if distance2 > 1.0e-30 and wp.dot(away, leaving) > 0.0:
            toward = away / wp.sqrt(distance2)
            if wp.dot(lamp.normal, away) > 0.0:
                lamp.front = False
                lamp.normal = -lamp.normal
            sample.pdf = area_pdf(drawn.probability, lamp, toward, wp.sqrt(distance2))
            sample.radiance = emitted(materials, lamp)
            sample.origin = offset_origin(point.position, leaving, point.reach_m)
            # The shadow ray ends before the lamp, by roundings of the way there and of the lamp's own place.
            reach_m = wp.max(lamp.reach_m, wp.sqrt(distance2))
            shadow = offset_origin(lamp.position, lamp.normal, reach_m) - sample.origin
            distance = wp.length(shadow)
            sample.direction = shadow / distance
            # A small triangle that is far away is met less exactly than roundings tell.
            uncertain = wp.min(_UNCERTAIN * wp.sqrt(distance2 / lamp.area), _MOST_UNCERTAIN)
            sample.distance = distance * (1.0 - uncertain)
        return sample

    @wp.func(inline=True)
    def towards_sphere(
        lights: Lights, geometry: Geometry, point: Surface, drawn: LightChoice, u: wp.vec2, time: float
    ) -> LightSample:
        sample = LightSample()
        index = drawn.light - lights.first_sphere
        sphere = sphere_at(geometry, index, time)
        size = sphere_cone(sphere, point.position)
        if size > 0.0:
            centre = wp.vec3(sphere[0], sphere[1], sphere[2])
            toward = cone(wp.normalize(centre - point.position), size, u)
            leaving = side(point.normal, toward)
            if wp.dot(toward, leaving) > 0.0:
                sample.pdf = drawn.probability / (2.0 * wp.pi * size)
                sample.radiance = lights.sphere_radiance[index]
                sample.direction = toward
                sample.origin = offset_origin(point.position, leaving, point.reach_m)
                t = hit_sphere(sphere, sample.origin, toward)
                if t < 0.0:  # grazes the edge by rounding
                    t = wp.dot(centre - sample.origin, toward)
                sample.distance = 0.9999 * t
        return sample

    @wp.func(inline=True)
    def towards_point(lights: Lights, materials: Any, point: Surface, drawn: LightChoice, time: float) -> LightSample:
        sample = LightSample()
        index = drawn.light - lights.first_punctual
        found = towards_punctual(lights.punctual, materials.textures, index, point.position, time)
        leaving = side(point.normal, found.direction)
        if wp.dot(found.direction, leaving) > 0.0:
            sample.delta = True
            sample.pdf = drawn.probability
            sample.radiance = found.irradiance
            sample.direction = found.direction
            sample.origin = offset_origin(point.position, leaving, point.reach_m)
            sample.distance = found.distance
        return sample

    @wp.func(inline=True)
    def towards_environment(lights: Lights, point: Surface, u: wp.vec2) -> LightSample:
        sample = LightSample()
        if wp.static(features.environment_map):
            towards = sample_environment(lights.environment_image, u)
            drawn = EnvironmentSample(towards, wp.vec3(1.0, 1.0, 1.0), 1.0)  # type: ignore[call-arg]
            sample.mapped = True
        else:
            drawn = environment(lights, point.shading_normal, cosine_hemisphere(point.shading_normal, u))
        leaving = side(point.normal, drawn.direction)
        if wp.dot(drawn.direction, leaving) > 0.0:
            sample.pdf = drawn.pdf
            sample.radiance = drawn.radiance
            sample.direction = drawn.direction
            sample.origin = offset_origin(point.position, leaving, point.reach_m)
            sample.distance = FAR
        return sample

    @wp.func
    def sample_light(
        lights: Lights,
        geometry: Geometry,
        materials: Any,
        point: Surface,
        to: Receiver,
        choice: float,
        finer: float,
        u: wp.vec2,
        time: float,
    ) -> LightSample:
        """Draw a light for a point, by ``choice`` and then ``finer``, and a place on it by ``u``."""
        sample = LightSample()
        drawn = choose(lights, to, choice, finer)
        light = drawn.light
        if wp.static(features.triangle_lights):
            if light >= 0 and light < lights.first_sphere:
                sample = towards_triangle(lights, geometry, materials, point, drawn, u, time)
        if wp.static(features.sphere_lights):
            if light >= lights.first_sphere and light < lights.first_punctual:
                sample = towards_sphere(lights, geometry, point, drawn, u, time)
        if wp.static(features.punctual_lights):
            if light >= lights.first_punctual and light < lights.first_environment:
                sample = towards_point(lights, materials, point, drawn, time)
        if wp.static(features.environment):
            if light == lights.first_environment:
                sample = towards_environment(lights, point, u)
        return sample

    return sample_light, triangle_pdf, sphere_pdf, environment, on_lamp
