# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018, RUF046
"""The kernel that keeps a pixel's paths and traces some of them again in each frame, in turn.

A pixel has ``settings.samples`` paths, each with random numbers of its own that are the same in every frame. Few are
traced again in a frame: one in every n-th where light is quiet, more where it changes. Of the others the last is known,
so that noise is that of all. What stands still stays as it is.

What changes would come late: a path is known as it was some frames ago. So the same path is compared with itself, a
round earlier, and the mean change a frame is drawn out by the mean age of what is known.

A pixel's paths are kept by the surface on which they begin, of which it knows two (`Layer`). Once all are traced, each
thing that a pixel shows is lit by the paths of all pixels around that began on its surface, also of those that an edge
crosses. So nothing need be smoothed afterwards.
"""

from typing import Any

import warp as wp

from clsim.render import sampling
from clsim.render.film import Sample
from clsim.render.first_hits import Looks, Seen
from clsim.render.shadow_rays import Shadows
from clsim.render.sobol import reverse_bits
from clsim.render.things import THINGS, Thing, lit_albedo, store_things

REACH = 3
"""Half the side of the square from which a thing takes its light [pixels]."""
LAYERS = 2
"""Surfaces that a pixel keeps paths of: those on another one count once no path is on one of them any more."""
LIT = 4
"""Things of a pixel that have a light of their own; the others have that of the last."""
_REACH, _LAYERS, _LIT = wp.constant(REACH), wp.constant(LAYERS), wp.constant(LIT)
_MARKS = wp.constant(LAYERS + 1)
_LEAST = wp.constant(0.2)
"""A change that is drawn out takes away at most all but this share of what is known."""
_ALIKE_NORMAL = wp.constant(0.95)
_OFF_PLANE_SHARE = wp.constant(0.05)
"""Share of how far it is from there by which a path may begin off a surface's plane, beside a pixel's width."""


@wp.struct
class Turns:
    """How many samples pixels get in this frame.

    Attributes:
        looks: first-hit rays of a pixel.
        probe: paths that are traced again where light changes.
        every: elsewhere it is one, in each so many-th frame, in turn with its neighbours.
        turn: number of the frame.
    """

    looks: Looks
    probe: int
    every: int
    turn: int


@wp.struct
class Layer:
    """What a pixel knows of the light on a surface, from those of its paths that began there.

    Attributes:
        total: sum of what each found when it was traced last, as irradiance over π.
        count: how many there are.
        frames: sum of the numbers of the frames in which that was.
        rate: mean change a frame.
        now: ``total`` as it is likely to be by now.
        position, normal: where the path began that was traced last.
    """

    total: wp.vec3
    count: int
    frames: int
    rate: wp.vec3
    now: wp.vec3
    position: wp.vec3
    normal: wp.vec3


@wp.struct
class Lit:
    """A thing that a pixel shows: what it reflects of the light, share and albedo in one, and where it is."""

    reflects: wp.vec3
    position: wp.vec3
    normal: wp.vec3
    depth: float


@wp.func
def on_surface(position: wp.vec3, normal: wp.vec3, at: wp.vec3, facing: wp.vec3, footprint_m: float) -> bool:
    """Whether a place lies on the surface of another one."""
    apart = position - at
    off = wp.dot(apart, facing)
    near = off * off < footprint_m * footprint_m + _OFF_PLANE_SHARE * _OFF_PLANE_SHARE * wp.dot(apart, apart)
    return near and wp.dot(normal, facing) > _ALIKE_NORMAL


@wp.func
def _layer_of(
    layers: wp.array2d(dtype=Layer), pixel: int, position: wp.vec3, normal: wp.vec3, footprint_m: float
) -> int:
    """Return the layer of the surface that a path began on, or one that is free for it; −1 if there is none."""
    found = int(-1)
    free = int(-1)
    for k in range(_LAYERS):
        layer = layers[pixel, k]
        same = on_surface(position, normal, layer.position, layer.normal, footprint_m)
        if found < 0 and layer.count > 0 and same:
            found = k
        if layer.count == 0:
            free = k
    if found < 0 and free >= 0:
        layers[pixel, free] = Layer()
        found = free
    return found


@wp.func
def _take_off(layers: wp.array2d(dtype=Layer), pixel: int, mark: int, light: wp.vec3):
    """Take what a path found earlier off its layer, if it is in one."""
    k = mark % _MARKS - 1
    if k >= 0:
        layers[pixel, k].count -= 1
        layers[pixel, k].frames -= mark // _MARKS
        layers[pixel, k].total = layers[pixel, k].total - light
        if layers[pixel, k].count == 0:
            layers[pixel, k].total = wp.vec3()


@wp.func
def _put_on(
    layers: wp.array2d(dtype=Layer),
    pixel: int,
    mark: int,
    before: wp.vec3,
    e: wp.vec3,
    position: wp.vec3,
    normal: wp.vec3,
    footprint_m: float,
    turn: int,
    kept: int,
) -> int:
    """Let what a path has found count instead of what it found ``before``; return its mark.

    A path that finds what it found before stays where it is: what stands still stays exactly as it is.
    """
    k = mark % _MARKS - 1
    share = 2.0 / float(kept + 1)
    if mark > 0 and e == before:
        if k >= 0:
            layers[pixel, k].frames += turn - mark // _MARKS
            layers[pixel, k].rate = layers[pixel, k].rate * (1.0 - share)
    else:
        _take_off(layers, pixel, mark, before)
        last = k
        k = _layer_of(layers, pixel, position, normal, footprint_m)
        if k >= 0:
            if k == last and layers[pixel, k].count > 0:
                rate = layers[pixel, k].rate
                frames = float(wp.max(turn - mark // _MARKS, 1))
                layers[pixel, k].rate = rate + ((e - before) / frames - rate) * share
            layers[pixel, k].total += e
            layers[pixel, k].count += 1
            layers[pixel, k].frames += turn
            layers[pixel, k].position = position
            layers[pixel, k].normal = normal
    return turn * _MARKS + k + 1


@wp.func
def draw_out(layers: wp.array2d(dtype=Layer), pixel: int, turn: int):
    """Find what the light on each layer is likely to be by now."""
    for k in range(_LAYERS):
        layer = layers[pixel, k]
        age = float(turn * layer.count - layer.frames)
        for c in range(3):
            layer.now[c] = wp.max(layer.total[c] + layer.rate[c] * age, layer.total[c] * _LEAST)
        layers[pixel, k].now = layer.now


@wp.func
def light_on(
    layers: wp.array2d(dtype=Layer),
    window: wp.array(dtype=float),
    pixel: int,
    width: int,
    lit: Lit,
    pixel_angle: float,
) -> wp.vec3:
    """Return the light on a thing: the mean of what paths around found that began on its surface.

    Where none did, it is that of all its own pixel's.
    """
    x = pixel % width
    y = pixel // width
    footprint_m = lit.depth * pixel_angle
    total = wp.vec3()
    weight = float(0.0)
    for dy in range(wp.max(-_REACH, -y), wp.min(_REACH + 1, layers.shape[0] // width - y)):
        for dx in range(wp.max(-_REACH, -x), wp.min(_REACH + 1, width - x)):
            other = pixel + dy * width + dx
            w = window[(dy + _REACH) * (2 * _REACH + 1) + dx + _REACH]
            for k in range(_LAYERS):
                count = layers[other, k].count
                if count > 0 and w > 0.0:
                    position = layers[other, k].position
                    if on_surface(position, layers[other, k].normal, lit.position, lit.normal, footprint_m):
                        total += w * layers[other, k].now
                        weight += w * float(count)
    if weight == 0.0:
        for k in range(_LAYERS):
            total += layers[pixel, k].now
            weight += float(layers[pixel, k].count)
    return total / wp.max(weight, 1.0e-6)


@wp.func
def _note_things(
    things: wp.array(dtype=Thing), number: int, pixel: int, lit: wp.array2d(dtype=Lit), lit_things: wp.array(dtype=int)
) -> wp.vec3:
    """Note what is to be lit once all paths are traced; return the light that is sent out."""
    emission = wp.vec3()
    noted = int(0)
    for k in range(number):
        emission += things[k].emission * things[k].share
        if things[k].first.hit:
            reflects = things[k].albedo * things[k].share
            if noted < _LIT:
                thing = Lit()
                thing.reflects = reflects
                thing.position = things[k].position
                thing.normal = wp.normalize(things[k].normal)
                thing.depth = things[k].depth
                lit[pixel, noted] = thing
                noted = noted + 1
            else:
                lit[pixel, _LIT - 1].reflects += reflects
    lit_things[pixel] = noted
    return emission


def make_in_turn(
    sobol: bool,
    look: Any,
    shoot: Any,
    scene_type: Any,
    view_type: Any,
    settings_type: Any,
    options: Any,
) -> Any:
    """Return the kernel; a thread is ``pixels`` pixels, or corners of pixels in the pass that fills ``corners``.

    ``grades`` is uint8 ``[H·W]``: 0 where light is quiet, 1 where it changes, 2 where all paths are traced. Kept from
    frame to frame: ``light``, vec3 ``[H·W, samples]``, what each path found last, ``marks``, int32 ``[H·W, samples]``,
    3 times the number of the frame in which that was, plus 1 + its layer, ``layers`` ``[H·W, LAYERS]``, and
    ``traced``, int32 ``[H·W]``, how many paths a pixel ever had. ``lit`` and ``lit_things`` tell what a pixel shows.

    The pass with ``lighting`` comes last: it adds the light on that to the planes of radiance. Its ``window`` holds
    the weights of the pixels around, row by row.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def render_in_turn(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first_pixel: int,
        pixels: int,
        corner_pass: bool,
        lighting: bool,
        corners: wp.array(dtype=Sample),
        steering: Turns,
        grades: wp.array(dtype=wp.uint8),
        light: wp.array2d(dtype=wp.vec3),
        marks: wp.array2d(dtype=int),
        layers: wp.array2d(dtype=Layer),
        traced: wp.array(dtype=int),
        lit: wp.array2d(dtype=Lit),
        lit_things: wp.array(dtype=int),
        window: wp.array(dtype=float),
        out_planes: wp.array2d(dtype=float),
        out_spent: wp.array2d(dtype=int),
    ):
        things = wp.zeros(shape=wp.static(THINGS), dtype=Thing)
        first = first_pixel + wp.tid() * pixels
        for pixel in range(first, first + pixels):
            if lighting:
                radiance = wp.vec3(0.0, 0.0, 0.0)
                for k in range(lit_things[pixel]):
                    thing = lit[pixel, k]
                    e = light_on(layers, window, pixel, settings.width, thing, steering.looks.pixel_angle)
                    radiance += wp.cw_mul(thing.reflects, e)
                for c in range(3):
                    out_planes[c, pixel] = out_planes[c, pixel] + radiance[c]
                continue
            state = sampling.absorb(settings.stream, pixel)
            corner = wp.where(corner_pass, pixel, -1)
            nearest = wp.where(corner_pass, pixel, pixel + pixel // settings.width)
            row = settings.width + 1
            seen = look(
                scene,
                camera,
                settings,
                pixel,
                0,
                state,
                steering.looks,
                corner,
                corners,
                nearest,
                row,
                Seen(),
                Shadows(),
                things,
            )
            if corner_pass:
                continue
            wanted = int(settings.samples)
            if grades[pixel] == wp.uint8(1):
                wanted = steering.probe
            if grades[pixel] == wp.uint8(0):
                # Diagonals, so that each who waits has neighbours on all sides who do not.
                turn = pixel % settings.width + pixel // settings.width + steering.turn
                wanted = wp.where(turn % steering.every == 0, 1, 0)
            stream = sampling.Stream()
            if wp.static(sobol):
                stream.scrambling = sampling.stream_key(sampling.absorb(state, -1))
            for i in range(wanted):
                s = (traced[pixel] + i) % settings.samples
                if wp.static(sobol):
                    stream.reversed_index = reverse_bits(wp.uint32(s))
                stream.key = sampling.stream_key(sampling.absorb(state, s))
                sample = shoot(scene, camera, settings, pixel, 0, stream)
                # A sample that is not finite is dropped whole.
                if sample.hit and sampling.finite(sample.normal) and sampling.finite(sample.radiance):
                    e = wp.cw_div(sample.radiance - sample.emission, lit_albedo(sample))
                    footprint_m = sample.depth * steering.looks.pixel_angle
                    mark = marks[pixel, s]
                    before = light[pixel, s]
                    where = sample.position
                    facing = sample.normal
                    marks[pixel, s] = _put_on(
                        layers, pixel, mark, before, e, where, facing, footprint_m, steering.turn, settings.samples
                    )
                    light[pixel, s] = e
                else:
                    _take_off(layers, pixel, marks[pixel, s], light[pixel, s])
                    marks[pixel, s] = 0
            traced[pixel] = (traced[pixel] + wanted) % settings.samples
            draw_out(layers, pixel, steering.turn)
            emission = _note_things(things, seen.things, pixel, lit, lit_things)
            store_things(things, seen.things, seen.rays + wanted, emission, settings.spectral, pixel, out_planes)
            out_spent[0, pixel] = seen.rays
            out_spent[1, pixel] = wanted

    return render_in_turn
