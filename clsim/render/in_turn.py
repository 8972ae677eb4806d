# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018, SIM102, RUF046
"""The kernel that keeps a pixel's paths and traces some of them again in each frame, in turn.

A pixel has ``settings.samples`` paths, each with random numbers of its own that are the same in every frame. Few are
traced again in a frame: one in every n-th where light is quiet, more where it changes. Of the others the last is known,
so that noise is that of all. What stands still stays as it is.

The first frame traces a part of them, and later ones add one by one. Such a path counts for what is known already, and
then for what it changes by: to know the light better is no event.

A pixel's paths are kept by the surface on which they begin, of which it knows two (`light_layers.py`). Once all are
traced, each thing that a pixel shows is lit by them.

First-hit rays are the same in every frame too, and the camera stands still. So what a pixel shows is kept while all of
its rays stay out of where something moves (`guards.py`).

Some pixels may be looked at twice, by other first-hit rays. No path is traced for that: how far the light is off is
told by two halves of the pixels around.
"""

from typing import Any

import warp as wp

from clsim.frames import rendered_planes
from clsim.render import sampling
from clsim.render.corners import corner_near
from clsim.render.film import Sample
from clsim.render.first_hits import Looks, Seen
from clsim.render.light_layers import (
    ALL_AROUND,
    HALF,
    OTHER_HALF,
    Layer,
    Lit,
    Row,
    draw_out,
    light_on,
    move_layer,
    put_on,
    sum_rows,
    take_off,
)
from clsim.render.shadow_rays import Shadows
from clsim.render.sobol import reverse_bits
from clsim.render.things import THINGS, Thing, lit_albedo, store_things

LIT = 4
"""Things of a pixel that have a light of their own; the others have that of the last."""
_LIT = wp.constant(LIT)
_SHOWN = rendered_planes(first_hit_rays=True)
PLANES = len(_SHOWN.names)
"""Planes of what a pixel shows."""
_PLANES, _SAMPLES = wp.constant(PLANES), wp.constant(_SHOWN.first("Samples"))
_AGAIN = wp.constant(-3)
"""Names the random numbers of a second look; no path has a negative number."""
_OFF = wp.constant(0.125**0.5)
"""How far a look is off, as a part of what halves of the pixels around differ by, each of twice the variance of all."""
_QUIET, _ALL = wp.constant(0), wp.constant(2)
"""Grades of pixels (`make_in_turn`)."""


@wp.struct
class Turns:
    """How many samples pixels get in this frame.

    Attributes:
        looks: first-hit rays of a pixel.
        known: paths of each pixel that are traced in turn, and in the first frame all.
        more: paths that are traced for the first time, after those.
        worth: what a path counts for, beside one of the first frame.
        probe: paths that are traced again where light changes.
        every: elsewhere it is one, in each so many-th frame, in turn with its neighbours.
        turn: number of the frame.
        generation: number of the guards, from 1; 0 where there are none.
    """

    looks: Looks
    known: int
    more: int
    worth: float
    probe: int
    every: int
    turn: int
    generation: int


@wp.func
def _wanted(grade: int, pixel: int, width: int, steering: Turns) -> int:
    """Return how many of a pixel's known paths are traced."""
    wanted = int(steering.probe)
    if grade == _ALL:
        wanted = steering.known
    if grade == _QUIET:
        # Diagonals, so that each who waits has neighbours on all sides who do not.
        turn = pixel % width + pixel // width + steering.turn
        wanted = wp.where(turn % steering.every == 0, 1, 0)
    return wanted


@wp.func
def _same_corners(seen_in: wp.array(dtype=int), pixel: int, width: int, generation: int) -> bool:
    """Whether what a pixel's four corners saw is kept, and those next to them; ``seen_in`` is of corners."""
    row = width + 1
    column = pixel % width
    line = pixel // width
    same = bool(True)
    for k in range(12):
        place = corner_near(k)
        x = column + place[0]
        y = line + place[1]
        corner = y * row + x
        if x >= 0 and x < row and y >= 0 and corner < seen_in.shape[0]:
            same = same and seen_in[corner] == generation
    return same


@wp.func
def _note_things(
    things: wp.array(dtype=Thing), number: int, place: int, lit: wp.array2d(dtype=Lit), lit_things: wp.array(dtype=int)
) -> wp.vec3:
    """Note at ``place`` what is to be lit once all paths are traced; return the light that is sent out."""
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
                lit[place, noted] = thing
                noted = noted + 1
            else:
                lit[place, _LIT - 1].reflects += reflects
    lit_things[place] = noted
    return emission


@wp.func
def _reflected(
    lit: wp.array2d(dtype=Lit),
    lit_things: wp.array(dtype=int),
    layers: wp.array2d(dtype=Layer),
    rows: wp.array2d(dtype=Row),
    weights: wp.array(dtype=float),
    by: int,
    pixel: int,
    place: int,
    width: int,
    pixel_angle: float,
) -> wp.vec3:
    """Return what a pixel's things, noted at ``place``, reflect of the light on them, by those of the pixels around."""
    radiance = wp.vec3()
    for k in range(lit_things[place]):
        thing = lit[place, k]
        e = light_on(layers, rows, weights, by, pixel, width, thing, pixel_angle)
        radiance += wp.cw_mul(thing.reflects, e)
    return radiance


def make_in_turn(
    sobol: bool,
    keeps_looks: bool,
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
    where and when that was (`light_layers.py`), ``layers`` ``[H·W, LAYERS]``, and
    ``traced``, int32 ``[H·W]``, which path is the next one. ``lit`` and ``lit_things`` tell what a pixel shows, and so
    does ``shown``, float ``[PLANES, H·W]``, its planes without that light.

    Where it ``keeps_looks``, ``seen_in``, int32 ``[H·W]``, tells in which generation of the guards a pixel's rays were
    traced and stayed out of them, and ``corner_seen_in``, int32 ``[(H + 1)·(W + 1)]``, the same of corners; else 0.

    Two passes come last: that of ``summing`` fills ``rows`` ``[H·W, LAYERS]``, and that of ``lighting`` adds the light
    on what a pixel shows to the planes of radiance. ``weights`` are those of the pixels around in a row or column.

    Once a frame is done, a pass with ``again`` = n > 0, whose threads are every n-th pixel, looks at these once more.
    What it sees is kept behind that of the H·W pixels. It writes to ``out_twice`` alone, float ``[2, H·W / n]``: the
    luminance of two looks, which differ as two runs of other random numbers do.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def render_in_turn(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first_pixel: int,
        pixels: int,
        corner_pass: bool,
        summing: bool,
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
        shown: wp.array2d(dtype=float),
        seen_in: wp.array(dtype=int),
        corner_seen_in: wp.array(dtype=int),
        rows: wp.array2d(dtype=Row),
        weights: wp.array(dtype=float),
        again: int,
        out_planes: wp.array2d(dtype=float),
        out_spent: wp.array2d(dtype=int),
        out_twice: wp.array2d(dtype=float),
    ):
        things = wp.zeros(shape=wp.static(THINGS), dtype=Thing)
        first = first_pixel + wp.tid() * pixels
        angle = steering.looks.pixel_angle
        for number in range(first, first + pixels):
            pixel = number * wp.max(again, 1)
            if summing:
                sum_rows(layers, weights, pixel, settings.width, rows)
                continue
            if lighting:
                width = settings.width
                radiance = _reflected(lit, lit_things, layers, rows, weights, ALL_AROUND, pixel, pixel, width, angle)
                for c in range(3):
                    out_planes[c, pixel] = out_planes[c, pixel] + radiance[c]
                continue
            state = sampling.absorb(settings.stream, pixel)
            place = int(pixel)
            if again > 0:
                state = sampling.absorb(state, _AGAIN)
                place = traced.shape[0] + number
            corner = wp.where(corner_pass, pixel, -1)
            nearest = wp.where(corner_pass, pixel, pixel + pixel // settings.width)
            row = settings.width + 1
            kept = bool(False)
            if wp.static(keeps_looks):
                if corner_pass:
                    kept = corner_seen_in[pixel] == steering.generation
                else:
                    same = _same_corners(corner_seen_in, pixel, settings.width, steering.generation)
                    kept = seen_in[place] == steering.generation and (same or steering.looks.steps == 0)
            seen = Seen()
            if not kept:
                seen = look(
                    scene, camera, settings, pixel, 0, state, steering.looks, corner, corners, nearest, row, Seen(),
                    Shadows(), things,
                )  # fmt: skip
            if wp.static(keeps_looks):
                if corner_pass and not kept:
                    corner_seen_in[pixel] = wp.where(corners[pixel].guarded, 0, steering.generation)
            if corner_pass:
                continue
            if not kept:
                emission = _note_things(things, seen.things, place, lit, lit_things)
                if wp.static(keeps_looks) or again > 0:
                    store_things(things, seen.things, seen.rays, emission, settings.spectral, place, shown)
                else:
                    store_things(things, seen.things, seen.rays, emission, settings.spectral, pixel, out_planes)
                if wp.static(keeps_looks):
                    seen_in[place] = wp.where(seen.guarded, 0, steering.generation)
            if again > 0:
                found = wp.zeros(shape=3, dtype=wp.vec3)
                for by in range(3):
                    e = _reflected(lit, lit_things, layers, rows, weights, by, pixel, place, settings.width, angle)
                    found[by] = e
                off = _OFF * (found[HALF] - found[OTHER_HALF])
                now = wp.vec3(out_planes[0, pixel], out_planes[1, pixel], out_planes[2, pixel])
                then = found[ALL_AROUND] + wp.vec3(shown[0, place], shown[1, place], shown[2, place])
                out_twice[0, number] = sampling.brightness(now + off, settings.spectral)
                out_twice[1, number] = sampling.brightness(then - off, settings.spectral)
                continue
            grade = int(grades[pixel])
            wanted = _wanted(grade, pixel, settings.width, steering)
            stream = sampling.Stream()
            if wp.static(sobol):
                stream.scrambling = sampling.stream_key(sampling.absorb(state, -1))
            for i in range(wanted + steering.more):
                s = (traced[pixel] + i) % steering.known
                if i >= wanted:
                    s = steering.known + i - wanted
                if wp.static(sobol):
                    stream.reversed_index = reverse_bits(wp.uint32(s))
                stream.key = sampling.stream_key(sampling.absorb(state, s))
                sample = shoot(scene, camera, settings, pixel, 0, stream)
                mark = marks[pixel, s]
                before = light[pixel, s]
                # A sample that is not finite is dropped whole.
                if sample.hit and sampling.finite(sample.normal) and sampling.finite(sample.radiance):
                    e = wp.cw_div(sample.radiance - sample.emission, lit_albedo(sample))
                    footprint_m = sample.depth * steering.looks.pixel_angle
                    joins = i >= wanted
                    marks[pixel, s] = put_on(
                        layers, pixel, mark, before, e, sample.position, sample.normal, footprint_m, steering.turn,
                        settings.samples, steering.worth, joins,
                    )  # fmt: skip
                    light[pixel, s] = e
                else:
                    take_off(layers, pixel, mark, before)
                    marks[pixel, s] = 0
            traced[pixel] = (traced[pixel] + wanted) % steering.known
            if not kept:
                for k in range(seen.things):
                    if things[k].first.hit:
                        normal = wp.normalize(things[k].normal)
                        move_layer(layers, pixel, things[k].position, normal, things[k].depth * angle)
            draw_out(layers, pixel, steering.turn)
            if wp.static(keeps_looks):
                for plane in range(_PLANES):
                    out_planes[plane, pixel] = shown[plane, pixel]
            out_planes[_SAMPLES, pixel] = out_planes[_SAMPLES, pixel] + float(wanted + steering.more)
            out_spent[0, pixel] = seen.rays
            out_spent[1, pixel] = wanted + steering.more

    return render_in_turn
