# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018, RUF046
"""What a pixel knows of the light on surfaces, from paths that are kept (`in_turn.py`), as Warp functions.

A path has a mark: 1 + the layer that it is on, or 0 for none, plus 3 times the number of the frame that traced it last.

A path is known as it was some frames ago, so that change would come late. But the same path is compared with itself, a
round earlier, and the mean change a frame is drawn out by the mean age of what is known.

Each thing that a pixel shows is lit by the paths of all pixels around that began on its surface, also of those that an
edge crosses. So nothing need be smoothed afterwards. The sum over a square is that of its rows, and then of a column.
"""

import warp as wp

LAYERS = 2
"""Surfaces that a pixel keeps paths of: those on another one count once no path is on one of them any more."""
ALL_AROUND, HALF, OTHER_HALF = wp.constant(0), wp.constant(1), wp.constant(2)
"""Which of the pixels around: all, and those of either colour of a chequerboard."""
_LAYERS = wp.constant(LAYERS)
_MARKS = wp.constant(LAYERS + 1)
_LEAST = wp.constant(0.2)
"""A change that is drawn out takes away at most all but this share of what is known."""
_ALIKE_NORMAL = wp.constant(0.95)
_MOVES_PX = wp.constant(4.0)
"""A surface is the same where it went no farther from one frame to the next [pixels]."""
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
        position, normal: where the surface is: where its first path began, or what the pixel showed of it last.
        footprint_m: width of a pixel there.
    """

    total: wp.vec3
    count: int
    weight: float
    frames: int
    rate: wp.vec3
    now: wp.vec3
    position: wp.vec3
    normal: wp.vec3
    footprint_m: float


@wp.struct
class Row:
    """Sums over the pixels of a row around one, of the light on the surface of one of its layers, and their weights.

    Those an even number of pixels away are apart from the others, as the two colours of a chequerboard are.
    """

    even: wp.vec3
    odd: wp.vec3
    even_weight: float
    odd_weight: float


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
        layer = Layer()
        layer.position = position
        layer.normal = normal
        layer.footprint_m = footprint_m
        layers[pixel, free] = layer
        found = free
    return found


@wp.func
def _by_now(layer: Layer, turn: int) -> wp.vec3:
    """Return the mean of what is known, drawn out to the frame ``turn``."""
    age = float(turn * layer.count - layer.frames)
    now = wp.vec3()
    for c in range(3):
        now[c] = wp.max(layer.total[c] + layer.rate[c] * age, layer.total[c] * _LEAST)
    return now / float(wp.max(layer.count, 1))


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
    ``joins`` others counts for their mean by now and adds no weight; from then on it counts for what it changes by.
    Elsewhere a path is ``worth`` so much weight.
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
            if joins and layers[pixel, k].count > 0:
                layers[pixel, k].total += _by_now(layers[pixel, k], turn)
            else:
                layers[pixel, k].total += e
            if not joins:
                layers[pixel, k].weight += worth
            layers[pixel, k].count += 1
            layers[pixel, k].frames += turn
    return turn * _MARKS + k + 1


@wp.func
def move_layer(layers: wp.array2d(dtype=Layer), pixel: int, position: wp.vec3, normal: wp.vec3, footprint_m: float):
    """Put that layer where the pixel shows its surface now which is nearest to it, if one is near and alike."""
    nearest = int(-1)
    least = _MOVES_PX * footprint_m
    for k in range(_LAYERS):
        layer = layers[pixel, k]
        off = wp.abs(wp.dot(position - layer.position, normal))
        if layer.count > 0 and off <= least and wp.dot(normal, layer.normal) > _ALIKE_NORMAL:
            nearest = k
            least = off
    if nearest >= 0:
        layers[pixel, nearest].position = position
        layers[pixel, nearest].normal = normal
        layers[pixel, nearest].footprint_m = footprint_m


@wp.func
def draw_out(layers: wp.array2d(dtype=Layer), pixel: int, turn: int):
    """Find what the light on each layer is likely to be by now."""
    for k in range(_LAYERS):
        layers[pixel, k].now = _by_now(layers[pixel, k], turn)


@wp.func
def sum_rows(
    layers: wp.array2d(dtype=Layer),
    weights: wp.array(dtype=float),
    pixel: int,
    width: int,
    out_rows: wp.array2d(dtype=Row),
):
    """Sum what pixels of the same row know of the light on the surfaces of a pixel's layers.

    ``weights`` are those of the pixels of a row or column, an odd number; the middle one is the pixel's own.
    """
    x = pixel % width
    reach = weights.shape[0] // 2
    for k in range(_LAYERS):
        row = Row()
        layer = layers[pixel, k]
        if layer.weight > 0.0:
            for dx in range(wp.max(-reach, -x), wp.min(reach + 1, width - x)):
                for j in range(_LAYERS):
                    mine = weights[dx + reach] * layers[pixel + dx, j].weight
                    if mine > 0.0:
                        position = layers[pixel + dx, j].position
                        normal = layers[pixel + dx, j].normal
                        if on_surface(position, normal, layer.position, layer.normal, layer.footprint_m):
                            if dx % 2 == 0:
                                row.even += mine * layers[pixel + dx, j].now
                                row.even_weight += mine
                            else:
                                row.odd += mine * layers[pixel + dx, j].now
                                row.odd_weight += mine
        out_rows[pixel, k] = row


@wp.func
def _add_column(
    layers: wp.array2d(dtype=Layer),
    rows: wp.array2d(dtype=Row),
    weights: wp.array(dtype=float),
    by: int,
    pixel: int,
    width: int,
    apart: int,
    lit: Lit,
    footprint_m: float,
) -> wp.vec4:
    """Return light times weight, and the weight, of the rows of a column that is ``apart`` pixels from the pixel's."""
    y = pixel // width
    reach = weights.shape[0] // 2
    sums = wp.vec4()
    for dy in range(wp.max(-reach, -y), wp.min(reach + 1, layers.shape[0] // width - y)):
        other = pixel + dy * width + apart
        even = by == ALL_AROUND or ((dy + apart) % 2 == 0) == (by == HALF)
        odd = by == ALL_AROUND or not even
        for k in range(_LAYERS):
            weight = float(0.0)
            total = wp.vec3()
            if even:
                weight = rows[other, k].even_weight
                total = rows[other, k].even
            if odd:
                weight += rows[other, k].odd_weight
                total = total + rows[other, k].odd
            if weight > 0.0:
                position = layers[other, k].position
                if on_surface(position, layers[other, k].normal, lit.position, lit.normal, footprint_m):
                    w = weights[dy + reach]
                    sums += w * wp.vec4(total[0], total[1], total[2], weight)
    return sums


@wp.func
def light_on(
    layers: wp.array2d(dtype=Layer),
    rows: wp.array2d(dtype=Row),
    weights: wp.array(dtype=float),
    by: int,
    pixel: int,
    width: int,
    lit: Lit,
    pixel_angle: float,
) -> wp.vec3:
    """Return the light on a thing: the mean of what paths around found that began on its surface.

    ``rows`` is what `sum_rows` found, and ``by`` tells of which of the pixels around.

    Where no path of the pixel's column did, it is that of the nearest columns, and where none of these did either, that
    of all the pixel's own paths.
    """
    x = pixel % width
    footprint_m = lit.depth * pixel_angle
    sums = wp.vec4()
    # Columns in the order 0, -1, 1, -2, 2 …: of two that are as near, both.
    step = int(0)
    while (sums[3] == 0.0 or step % 2 == 0) and step < weights.shape[0]:
        apart = wp.where(step % 2 == 0, step // 2, -((step + 1) // 2))
        if x + apart >= 0 and x + apart < width:
            sums += _add_column(layers, rows, weights, by, pixel, width, apart, lit, footprint_m)
        step = step + 1
    total = wp.vec3(sums[0], sums[1], sums[2])
    weight = float(sums[3])
    if weight == 0.0:
        for k in range(_LAYERS):
            total += layers[pixel, k].now * float(layers[pixel, k].count)
            weight += float(layers[pixel, k].count)
    return total / wp.max(weight, 1.0e-6)
