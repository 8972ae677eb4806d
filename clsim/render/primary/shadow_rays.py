# ruff: noqa: SIM102, UP018, RUF046
"""Shadow rays: from what a pixel shows to places on lamps, and which arrive there, as Warp functions.

Each primary ray may send one. A pixel in a soft shadow that shows one triangle needs many shadow rays, but few primary
ones: its corners tell where on the triangle they start. Each has the same place in the pixel and on a lamp in every
frame. While the camera goes on by a pixel, most of them stay lit, or stay dark. So between two frames only those are
traced that differ in these; the others' part of the light is taken for a line in time.
"""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Geometry, Surface, make_sphere_at
from clsim.render.bsdf.reflections import reflected_by_coats
from clsim.render.camera.film import Sample
from clsim.render.emitters.environment import STEP
from clsim.render.emitters.light_tree import Receiver
from clsim.render.emitters.lights import NEVER, Lights
from clsim.render.emitters.punctual import make_punctual
from clsim.render.features.features import Features
from clsim.render.features.scene_lamps import FEW_LAMPS
from clsim.render.kernel_input import Scene
from clsim.render.sampling import sampling
from clsim.render.sampling.sobol import make_sampler

AT_NONE, AT_ANY = wp.constant(-2), wp.constant(-1)
"""To which place on a lamp a shadow ray goes: none, or one of chance; numbers from 0 are places near the rim."""

_DIMENSIONS = wp.constant(sampling.DIMENSIONS_PER_BOUNCE)
_OfFew = wp.types.vector(length=FEW_LAMPS, dtype=wp.float32)
_ALIKE = wp.constant(4)
"""Lamps at most of which one is drawn by its power: a pixel's own corners ask each of them."""
_LEAST_COSINE = wp.constant(0.05)
"""Stands for that of a lamp's middle which is hidden, so that the parts which are not are drawn now and then."""
MOST_TOLD = wp.constant(64)
"""Rays at most of which it is told whether they reach the lamps: so many bits there are."""


@wp.struct
class Shadow:
    """What a pixel's rays found of the lamps in a frame.

    Attributes:
        triangle: number of the one that the pixel shows; 0 where nothing is told.
        rays: how many asked.
        lit_rays: bit i is set if ray i reached a lamp.
        lamp_all, lamp_lit: sums of what their ways to lamps carry, if nothing stood between, and as it is.
        coat_all, coat_lit: the same of what the coat reflects.
    """

    triangle: int
    rays: int
    lit_rays: wp.uint64
    lamp_all: float
    lamp_lit: float
    coat_all: float
    coat_lit: float


@wp.struct
class Shadows:
    """What a pixel's rays found in the frames before and after a time, and the share of the way between that passed."""

    before: Shadow
    after: Shadow
    share: float


@wp.func
def bit_of(bits: wp.uint64, ray: int) -> float:
    """Return 1 if a ray reached a lamp, else 0."""
    return float((bits >> wp.uint64(ray)) & wp.uint64(1))  # type: ignore[operator]


@wp.func
def are_told(shadows: Shadows, triangle: int) -> bool:
    """Whether both frames tell of the triangle that a pixel shows, by the same rays."""
    a = shadows.before
    b = shadows.after
    return a.triangle > 0 and a.rays > 0 and a.triangle == triangle and b.triangle == triangle and a.rays == b.rays


@wp.func
def next_that_differs(shadows: Shadows, ray: int) -> int:
    """Return the first ray from that one on that reached a lamp in one frame alone; how many there are if none did."""
    differ = shadows.before.lit_rays ^ shadows.after.lit_rays  # type: ignore[operator]
    found = int(ray)
    while found < shadows.before.rays and bit_of(differ, found) == 0.0:
        found = found + 1
    return found


@wp.func
def straight(shadows: Shadows, before: float, after: float) -> float:
    """Return what lies on the line between two values, at the share of the time that has passed."""
    return before + (after - before) * shadows.share


@wp.func
def off_straight(shadows: Shadows, ray: int, sample: Sample) -> wp.vec2:
    """Return by how much more light a ray found than lies on the line between its frames, and the coat of it."""
    before = bit_of(shadows.before.lit_rays, ray)
    lit = straight(shadows, before, bit_of(shadows.after.lit_rays, ray))
    return wp.vec2(sample.lamp_lit - sample.lamp_all * lit, sample.coat_lit - sample.coat_all * lit)


@wp.func
def corner_kind(x: int, y: int) -> int:
    """Return what a corner asks for, 0 … 7: each of a pixel's four asks another place on a lamp, each of eight in two
    rows another lamp."""
    return (x & 1) + 2 * (y & 1) + 2 * (x & 2)


@wp.func
def asks_neighbours(lights: Lights) -> bool:
    """Whether there are more lamps than a pixel has corners, so that those around it ask for the others."""
    return lights.first_environment > _ALIKE  # type: ignore[no-any-return]


@wp.func
def _turn_of(lights: Lights, corner: int) -> int:
    """Return whose turn it is among the lamps where a corner of that kind asks for one."""
    return wp.where(asks_neighbours(lights), corner, corner & 3)  # type: ignore[no-any-return]


@wp.func
def _draw_of(lights: Lights, light: int) -> float:
    """Return the number in 0 … 1 by which a lamp is drawn."""
    middle = lights.cumulative[light] - 0.5 * lights.probability[light]
    return wp.min(middle, lights.cumulative[lights.first_environment - 1] - STEP)  # type: ignore[no-any-return]


@wp.func
def _rim_place(corner: int) -> wp.vec2:
    """Return two numbers in 0 … 1 by which a place on that lamp is drawn.

    It lies near the rim, for there what shades a lamp begins; the last is a triangle's corner and a sphere's middle.
    """
    place = corner & 3
    return wp.vec2(wp.where(place == 3, 0.02, 0.98), wp.min(0.05 + 0.33 * float(place), 0.98))


@wp.func
def _seen_cosine(cosine: float) -> float:
    """Return a cosine, or a little where the middle of a lamp is hidden."""
    return wp.max(cosine, _LEAST_COSINE)  # type: ignore[no-any-return]


@wp.struct
class ShadowStart:
    """Where shadow rays start: a place, its shading normal, how its triangle faces, and its largest coordinate.

    Where it is ``coated_by`` the material of that number from 1, ``seen_from`` is the direction to the eye.
    """

    position: wp.vec3
    normal: wp.vec3
    facing: wp.vec3
    reach_m: float
    coated_by: int
    seen_from: wp.vec3


@wp.func
def start_at(sample: Sample) -> ShadowStart:
    """Return where shadow rays start from what a primary ray saw."""
    start = ShadowStart()
    start.position = sample.position
    start.normal = sample.normal
    start.facing = sample.facing
    start.reach_m = sample.reach_m
    start.coated_by = sample.coated_by
    start.seen_from = -sample.toward
    return start


@wp.func
def _lamp_in_turn(may_send: Any, turn: int) -> int:
    """Return the lamp that a corner asks: whose turn it is of those that may send light to its place; -1 if none may.

    They take turns whatever their power: where all seems plain, no other ray asks for shadows.
    """
    number = int(0)
    for light in range(wp.static(FEW_LAMPS)):
        if may_send[light] > 0.0:
            number = number + 1
    found = int(-1)
    left = turn % wp.max(number, 1)
    for light in range(wp.static(FEW_LAMPS)):
        if may_send[light] > 0.0:
            if left == 0:
                found = light
            left = left - 1
    return found


@wp.func
def _draw_lamp(lights: Lights, may_send: Any, u: float) -> wp.vec2:
    """Return a number in 0 … 1 by which a lamp is drawn, and its probability over that by power.

    Lamps are drawn by how much each may send to a place. By power, most rays of a place in the light of one spot of
    several would go to the others.
    """
    total = float(0.0)
    for light in range(lights.first_environment):
        total += may_send[light]
    left = u * total
    drawn = float(0.0)
    ratio = float(0.0)
    for light in range(lights.first_environment):
        one = may_send[light]
        if one > 0.0 and left >= 0.0:
            # The last one that is not above what is left.
            drawn = _draw_of(lights, light)
            ratio = one / (total * lights.probability[light])
            left = left - one
    return wp.vec2(drawn, ratio)


def make_rough_light(features: Features, on_lamp: Any, shining: Any) -> Any:
    """Return the Warp function ``rough_light(lights, geometry, materials, light, start, time) -> float``.

    It is the luminance of the irradiance that a lamp gives a place if nothing stands between, as if all of the lamp
    were where its middle is. ``on_lamp`` is of `make_lights`, which takes the same ``shining``.
    """
    sphere_at = make_sphere_at(features)
    towards_punctual = make_punctual(features)

    @wp.func
    def rough_light(
        lights: Lights, geometry: Geometry, materials: Any, light: int, start: ShadowStart, time: float
    ) -> float:
        found = float(0.0)
        if lights.probability[light] > 0.0:
            if wp.static(features.triangle_lights):
                if light < lights.first_sphere:
                    lamp = on_lamp(lights, geometry, light, wp.vec3(1.0, 1.0, 1.0) / 3.0, time)
                    away = lamp.position - start.position
                    facing = -wp.dot(lamp.normal, away)
                    if facing < 0.0:
                        lamp.front = False
                    distance = wp.max(wp.length(away), 1.0e-15)
                    solid = lamp.area * _seen_cosine(wp.abs(facing) / distance) / (distance * distance)
                    cosine = _seen_cosine(wp.dot(start.normal, away) / distance)
                    found = sampling.luminance(shining(materials, lamp)) * solid * cosine
            if wp.static(features.sphere_lights):
                if light >= lights.first_sphere and light < lights.first_punctual:
                    sphere = sphere_at(geometry, light - lights.first_sphere, time)
                    away = wp.vec3(sphere[0], sphere[1], sphere[2]) - start.position
                    distance = wp.max(wp.length(away), 1.0e-15)
                    sine = wp.min(sphere[3] / distance, 1.0)
                    radiance = sampling.luminance(lights.sphere_radiance[light - lights.first_sphere])
                    found = wp.pi * radiance * sine * sine * _seen_cosine(wp.dot(start.normal, away) / distance)
            if wp.static(features.punctual_lights):
                if light >= lights.first_punctual:
                    index = light - lights.first_punctual
                    sent = towards_punctual(lights.punctual, materials.textures, index, start.position, time)
                    found = sampling.luminance(sent.irradiance) * wp.max(wp.dot(sent.direction, start.normal), 0.0)
        return found

    return rough_light


def make_shadow_ray(
    features: Features, sample_light: Any, agree: Any, visibility: Any, on_lamp: Any, shining: Any
) -> Any:
    """Return the Warp function ``shadow_ray(scene, start, to_lamps, stream, time) -> wp.vec4``.

    It goes to a place on a lamp. It returns the luminance of that light if nothing stood between, over the density of
    the place, and what of it arrives; then both of what a coat reflects. Of the lamps alone: which rays meet the bright
    squares of a texture makes no shadow.
    """
    uniform2 = make_sampler(features.sobol)
    rough_light = make_rough_light(features, on_lamp, shining)

    @wp.func(inline=True)
    def shadow_ray(scene: Scene, start: ShadowStart, to_lamps: int, stream: sampling.Stream, time: float) -> wp.vec4:
        point = Surface()
        point.position = start.position
        point.normal = start.facing
        point.shading_normal = start.normal
        point.reach_m = start.reach_m
        to = Receiver()
        to.position = start.position
        to.normal = start.normal
        draw = float(0.0)
        ratio = float(1.0)
        u = wp.vec2()
        may_send = _OfFew()
        if scene.lights.first_environment > _ALIKE:
            for lamp in range(scene.lights.first_environment):
                may_send[lamp] = rough_light(scene.lights, scene.geometry, scene.materials, lamp, start, time)
        if to_lamps >= 0:
            turn = _turn_of(scene.lights, to_lamps)
            light_asked = turn % scene.lights.first_environment
            if scene.lights.first_environment > _ALIKE:
                light_asked = _lamp_in_turn(may_send, turn)
            draw = _draw_of(scene.lights, wp.max(light_asked, 0))
            ratio = wp.where(light_asked < 0, 0.0, 1.0)
            u = _rim_place(to_lamps)
        else:
            draw = uniform2(stream, _DIMENSIONS + sampling.CHOICE)[0]
            if scene.lights.first_environment > _ALIKE:
                by_light = _draw_lamp(scene.lights, may_send, draw)
                draw = by_light[0]
                ratio = by_light[1]
            else:
                others = wp.max(scene.lights.environment_probability, NEVER)
                draw = draw * (1.0 - others)
            u = uniform2(stream, _DIMENSIONS + sampling.LIGHT)
        found = wp.vec4()
        # Few enough lamps that none is drawn by a tree, which alone takes a finer number.
        light = sample_light(scene.lights, scene.geometry, scene.materials, point, to, draw, 0.0, u, time)
        light.pdf = light.pdf * ratio
        if light.pdf > 0.0 and agree(point, light.direction):
            facing = wp.max(wp.dot(light.direction, start.normal), 0.0)
            found[0] = sampling.luminance(light.radiance) * facing / light.pdf
            if found[0] > 0.0:
                if wp.static(features.coats):
                    if start.coated_by > 0:
                        share = reflected_by_coats(
                            scene.materials, start.coated_by - 1, start.normal, start.seen_from, light.direction
                        )
                        found[2] = sampling.luminance(wp.cw_mul(light.radiance, share)) / light.pdf
                lit = visibility(scene, light.origin, light.direction, light.distance, time)
                found[1] = found[0] * lit
                found[3] = found[2] * lit
        return found

    return shadow_ray
