# ruff: noqa: SIM102
"""Shadow rays: from what a pixel shows to places on lamps, and which arrive there, as Warp functions.

Each primary ray may send one. A pixel in a soft shadow that shows one triangle needs many shadow rays, but few primary
ones: its corners tell where on the triangle they start. Each has the same place in the pixel and on a lamp in every
frame. While the camera goes on by a pixel, most of them stay lit, or stay dark. So between two frames only those are
traced that differ in these; the others' part of the light is taken for a line in time.
"""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Surface
from clsim.render.bsdf.reflections import reflected_by_coats
from clsim.render.camera.film import Sample
from clsim.render.emitters.environment import STEP
from clsim.render.emitters.light_tree import Receiver
from clsim.render.emitters.lights import NEVER, Lights
from clsim.render.features.features import Features
from clsim.render.kernel_input import Scene
from clsim.render.sampling import sampling
from clsim.render.sampling.sobol import make_sampler

AT_NONE, AT_ANY = wp.constant(-2), wp.constant(-1)
"""To which place on a lamp a shadow ray goes: none, or one of chance; numbers from 0 are places near the rim."""

_DIMENSIONS = wp.constant(sampling.DIMENSIONS_PER_BOUNCE)
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
    return lights.first_environment > 4


@wp.func
def _rim_draw(lights: Lights, corner: int) -> float:
    """Return the number in 0 … 1 by which the lamp is drawn that a corner of that kind asks.

    They take turns among the lamps, whatever their power: where all seems plain, no other ray asks for shadows.
    """
    kind = wp.where(asks_neighbours(lights), corner, corner & 3)
    light = kind % lights.first_environment
    middle = lights.cumulative[light] - 0.5 * lights.probability[light]
    return wp.min(middle, lights.cumulative[lights.first_environment - 1] - STEP)  # type: ignore[no-any-return]


@wp.func
def _rim_place(corner: int) -> wp.vec2:
    """Return two numbers in 0 … 1 by which a place on that lamp is drawn.

    It lies near the rim, for there what shades a lamp begins; the last is a triangle's corner and a sphere's middle.
    """
    place = corner & 3
    return wp.vec2(wp.where(place == 3, 0.02, 0.98), wp.min(0.05 + 0.33 * float(place), 0.98))


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


def make_shadow_ray(features: Features, sample_light: Any, agree: Any, visibility: Any) -> Any:
    """Return the Warp function ``shadow_ray(scene, start, to_lamps, stream, time) -> wp.vec4``.

    It goes to a place on a lamp. It returns the luminance of that light if nothing stood between, over the density of
    the place, and what of it arrives; then both of what a coat reflects. Of the lamps alone: which rays meet the bright
    squares of a texture makes no shadow.
    """
    uniform2 = make_sampler(features.sobol)

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
        draw = 0.0
        u = wp.vec2()
        if to_lamps >= 0:
            draw = _rim_draw(scene.lights, to_lamps)
            u = _rim_place(to_lamps)
        else:
            others = wp.max(scene.lights.environment_probability, NEVER)
            draw = uniform2(stream, _DIMENSIONS + sampling.CHOICE)[0] * (1.0 - others)
            u = uniform2(stream, _DIMENSIONS + sampling.LIGHT)
        found = wp.vec4()
        # Few enough lamps that none is drawn by a tree, which alone takes a finer number.
        light = sample_light(scene.lights, scene.geometry, scene.materials, point, to, draw, 0.0, u, time)
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
