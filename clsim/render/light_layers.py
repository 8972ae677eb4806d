# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018, RUF046
"""What a pixel knows of the light on surfaces, from paths that are kept (`in_turn.py`), as Warp functions.

A path has a mark: 1 + the layer that it is on, or 0 for none, plus 3 times the number of the frame that traced it last.

A path is known as it was some frames ago, so that change would come late. But the same path is compared with itself, a
round earlier, and the mean change a frame is drawn out by the mean age of what is known.

Each thing that a pixel shows is lit by the paths of all pixels around that began on its surface, also of those that an
edge crosses. So nothing need be smoothed afterwards.
"""

import warp as wp

LAYERS = 2
"""Surfaces that a pixel keeps paths of: those on another one count once no path is on one of them any more."""
REACH = 3
"""Half the side of the square from which a thing takes its light [pixels]."""
ALL_AROUND, HALF, OTHER_HALF = wp.constant(0), wp.constant(1), wp.constant(2)
"""Windows: of all pixels around, and of those of either colour of a chequerboard."""
_REACH, _LAYERS = wp.constant(REACH), wp.constant(LAYERS)
_MARKS = wp.constant(LAYERS + 1)
_LEAST = wp.constant(0.2)
"""A change that is drawn out takes away at most all but this share of what is known."""
_ALIKE_NORMAL = wp.constant(0.95)
_OFF_PLANE_SHARE = wp.constant(0.05)
"""Share of how far it is from there by which a path may begin off a surface's plane, beside a pixel's width."""


@wp.struct
class Layer:
    """What a pixel knows of the light on a surface, from those of its paths that began there.

    Attributes:
        total: sum of what each found when it was traced last, as irradiance over π.
        count: how many there are.
        weight: what they count for beside those of other pixels.
        frames: sum of the numbers of the frames in which that was.
        rate: mean change a frame.
        now: the mean as it is likely to be by now.
        position, normal: where the path began that was traced last.
    """

    total: wp.vec3
    count: int
    weight: float
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
def take_off(layers: wp.array2d(dtype=Layer), pixel: int, mark: int, light: wp.vec3):
    """Take what a path found earlier off its layer, if it is in one."""
    k = mark % _MARKS - 1
    if k >= 0:
        layers[pixel, k].weight -= layers[pixel, k].weight / float(layers[pixel, k].count)
        layers[pixel, k].count -= 1
        layers[pixel, k].frames -= mark // _MARKS
        layers[pixel, k].total = layers[pixel, k].total - light
        if layers[pixel, k].count == 0:
            layers[pixel, k].total = wp.vec3()
            layers[pixel, k].weight = 0.0


@wp.func
def _layer_at(
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
def put_on(
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
    worth: float,
    joins: bool,
) -> int:
    """Let what a path has found count instead of what it found ``before``; return its mark.

    A path that finds what it found before stays where it is: what stands still stays exactly as it is. One that
    ``joins`` others counts for their mean and adds no weight; from then on it counts for what it changes by. Elsewhere
    a path is ``worth`` so much weight.
    """
    k = mark % _MARKS - 1
    share = 2.0 / float(kept + 1)
    if mark > 0 and e == before:
        if k >= 0:
            layers[pixel, k].frames += turn - mark // _MARKS
            layers[pixel, k].rate = layers[pixel, k].rate * (1.0 - share)
    else:
        take_off(layers, pixel, mark, before)
        last = k
        k = _layer_at(layers, pixel, position, normal, footprint_m)
        if k >= 0:
            if k == last and layers[pixel, k].count > 0:
                rate = layers[pixel, k].rate
                frames = float(wp.max(turn - mark // _MARKS, 1))
                layers[pixel, k].rate = rate + ((e - before) / frames - rate) * share
            counts = e
            if joins and layers[pixel, k].count > 0:
                counts = layers[pixel, k].total / float(layers[pixel, k].count)
            if not joins:
                layers[pixel, k].weight += worth
            layers[pixel, k].total += counts
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
        count = float(wp.max(layer.count, 1))
        age = float(turn * layer.count - layer.frames)
        for c in range(3):
            layer.now[c] = wp.max(layer.total[c] + layer.rate[c] * age, layer.total[c] * _LEAST) / count
        layers[pixel, k].now = layer.now


@wp.func
def light_on(
    layers: wp.array2d(dtype=Layer),
    windows: wp.array2d(dtype=float),
    by: int,
    pixel: int,
    width: int,
    lit: Lit,
    pixel_angle: float,
) -> wp.vec3:
    """Return the light on a thing: the mean of what paths around found that began on its surface.

    ``by`` is the row of ``windows``, weights of the pixels around, by which it is that mean.

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
            w = windows[by, (dy + _REACH) * (2 * _REACH + 1) + dx + _REACH]
            if w > 0.0:
                for k in range(_LAYERS):
                    mine = w * layers[other, k].weight
                    if mine > 0.0:
                        position = layers[other, k].position
                        if on_surface(position, layers[other, k].normal, lit.position, lit.normal, footprint_m):
                            total += mine * layers[other, k].now
                            weight += mine
    if weight == 0.0:
        for k in range(_LAYERS):
            total += layers[pixel, k].now * float(layers[pixel, k].count)
            weight += float(layers[pixel, k].count)
    return total / wp.max(weight, 1.0e-6)
