# Warp: a variable that changes must be born by a call, and wp.static drops a branch only where it stands alone.
# ruff: noqa: SIM102, UP018
"""Textures: checkerboards and images, filtered by hand, as Warp functions.

All images lie one after the other in one array of texels, RGBA in the bytes of a word from the lowest up; a table says
where each begins and how it is read. A texture's uv are u right and v up.
"""

from typing import Any

import warp as wp

from clsim.render.features import Features
from clsim.render.native import native_code

REPEAT = wp.constant(0)
CLAMP = wp.constant(1)
MIRROR = wp.constant(2)
_GOLDEN = 0.6180339887
_AT_ONCE = 32
_MOST_SQUARES = wp.constant(64)
"""Squares on a line through a pixel; where there are more, they are so small that both colours cover half."""

mat23 = wp.types.matrix(shape=(2, 3), dtype=wp.float32)
"""An affine map of uv."""


@wp.struct
class TextureRow:
    """A texture; ``first`` is its first texel, −1 for a checkerboard; ``decoding`` where its byte table begins.

    ``coarse`` is where its ``levels`` begin, each of half as many rows and columns as the one before.
    """

    first: int
    coarse: int
    levels: int
    width: int
    height: int
    wrap_u: int
    wrap_v: int
    nearest: int
    decoding: int
    uv_matrix: mat23
    color_a: wp.vec3
    color_b: wp.vec3
    scale: float


@wp.struct
class Textures:
    """All textures; ``decoding`` holds what the 256 bytes mean as plain numbers, and then as sRGB.

    ``coarse`` is the texels of all coarser levels: of means over 2×2, 4×4 … of the others.
    """

    rows: wp.array(dtype=TextureRow)
    texels: wp.array(dtype=wp.uint32)
    coarse: wp.array(dtype=wp.uint32)
    decoding: wp.array(dtype=float)


@wp.func
def checker(row: TextureRow, uv: wp.vec2) -> wp.vec4:
    """Return the colour of a checkerboard; the square at the origin of uv has the first colour."""
    square = int(wp.floor(uv[0] * row.scale)) + int(wp.floor(uv[1] * row.scale))
    color = wp.where((square & 1) == 0, row.color_a, row.color_b)
    return wp.vec4(color[0], color[1], color[2], 1.0)


@wp.func
def fold(x: float, mode: int) -> float:
    """Return the place in 0…1 that a coordinate of any size stands for."""
    folded = wp.clamp(x, 0.0, 1.0)
    if mode == REPEAT:
        folded = x - wp.floor(x)
    if mode == MIRROR:
        folded = x - 2.0 * wp.floor(0.5 * x)
        if folded > 1.0:
            folded = 2.0 - folded
    return folded


@wp.func
def neighbour(i: int, n: int, mode: int) -> int:
    """Return the texel that stands for one at most a step outside 0…n − 1; mirrored, it is the edge again."""
    inside = wp.clamp(i, 0, n - 1)
    if mode == REPEAT and inside != i:
        inside = n - 1 - inside
    return inside


@wp.func
def texel(textures: Textures, row: TextureRow, x: int, y: int) -> wp.vec4:
    """Return the linear value of a texel; alpha is never encoded."""
    word = int(textures.texels[row.first + y * row.width + x])
    return wp.vec4(
        textures.decoding[row.decoding + (word & 255)],
        textures.decoding[row.decoding + ((word >> 8) & 255)],
        textures.decoding[row.decoding + ((word >> 16) & 255)],
        textures.decoding[(word >> 24) & 255],
    )


@wp.func
def image(textures: Textures, row: TextureRow, uv: wp.vec2) -> wp.vec4:
    """Return an image's value: texel centres lie at half-integers, row 0 at v = 1."""
    st = row.uv_matrix * wp.vec3(uv[0], uv[1], 1.0)
    x = fold(st[0], row.wrap_u) * float(row.width)
    y = (1.0 - fold(st[1], row.wrap_v)) * float(row.height)
    value = wp.vec4()
    if row.nearest != 0:
        # Places too far away for a number may be any.
        value = texel(textures, row, wp.clamp(int(x), 0, row.width - 1), wp.clamp(int(y), 0, row.height - 1))
    else:
        left = wp.floor(x - 0.5)
        top = wp.floor(y - 0.5)
        right_share = x - 0.5 - left
        bottom_share = y - 0.5 - top
        x0 = neighbour(int(left), row.width, row.wrap_u)
        x1 = neighbour(int(left) + 1, row.width, row.wrap_u)
        y0 = neighbour(int(top), row.height, row.wrap_v)
        y1 = neighbour(int(top) + 1, row.height, row.wrap_v)
        upper = texel(textures, row, x0, y0) * (1.0 - right_share) + texel(textures, row, x1, y0) * right_share
        lower = texel(textures, row, x0, y1) * (1.0 - right_share) + texel(textures, row, x1, y1) * right_share
        value = upper * (1.0 - bottom_share) + lower * bottom_share
    return value


@wp.struct
class Footprint:
    """What a pixel shows of a flat surface: uv over distance, and 1 over distance, at its corners.

    Both are linear in the picture: so perspective is kept. The corners' order is top left, right, and below likewise.
    """

    top_left: wp.vec3
    top_right: wp.vec3
    bottom_left: wp.vec3
    bottom_right: wp.vec3


@wp.func
def uv_in(footprint: Footprint, x: float, y: float) -> wp.vec2:
    """Return the uv at a place in the pixel, whose corners are at 0 and 1."""
    top = footprint.top_left + (footprint.top_right - footprint.top_left) * x
    bottom = footprint.bottom_left + (footprint.bottom_right - footprint.bottom_left) * x
    both = top + (bottom - top) * y
    return wp.vec2(both[0] / both[2], both[1] / both[2])


@wp.func
def _crossing(from_number: wp.vec2, along: wp.vec2, square: float) -> float:
    """Return where on a line (a number over distance, 1 over distance) the number is that given; 2 where nowhere."""
    t = float(2.0)
    slope = square * along[1] - along[0]
    if wp.abs(slope) > 1.0e-20:
        t = (from_number[0] - square * from_number[1]) / slope
        if t < -1.0e-6:
            # Far ahead the line tends to a number short of it, and had it behind.
            t = 2.0
    return t


@wp.func
def _share_along(start: wp.vec3, end: wp.vec3, scale: float) -> float:
    """Return the share of a checkerboard's first colour on a line through a pixel, from edge to edge of its squares."""
    across = wp.vec2(start[0] * scale, start[2])
    upward = wp.vec2(start[1] * scale, start[2])
    by_across = wp.vec2(end[0] * scale, end[2]) - across
    by_upward = wp.vec2(end[1] * scale, end[2]) - upward
    i = wp.floor(across[0] / across[1])
    j = wp.floor(upward[0] / upward[1])
    right = end[0] * start[2] > start[0] * end[2]
    up = end[1] * start[2] > start[1] * end[2]
    share = float(0.0)
    t = float(0.0)
    for _ in range(_MOST_SQUARES):
        to_side = _crossing(across, by_across, i + wp.where(right, 1.0, 0.0))
        to_top = _crossing(upward, by_upward, j + wp.where(up, 1.0, 0.0))
        to = wp.clamp(wp.min(to_side, to_top), t, 1.0)
        if (int(i) + int(j)) & 1 == 0:
            share += to - t
        t = to
        if t >= 1.0:
            break
        if to_side <= to_top:
            i = i + wp.where(right, 1.0, -1.0)
        else:
            j = j + wp.where(up, 1.0, -1.0)
    return share + 0.5 * (1.0 - t)


@wp.func
def _square(corner: wp.vec3, scale: float) -> wp.vec2:
    """Return the column and the row of the square that a corner lies in."""
    return wp.vec2(wp.floor(corner[0] * scale / corner[2]), wp.floor(corner[1] * scale / corner[2]))


@wp.func
def _share_below(a: float, b: float, c: float, d: float) -> float:
    """Return the share of a square in which a linear function is negative, by its values at corners, all around."""
    values = wp.vec4(a, b, c, d)
    twice = float(0.0)
    begun = bool(False)
    first = wp.vec2()
    last = wp.vec2()
    before = float(d)
    from_x = float(0.0)
    from_y = float(1.0)
    for i in range(4):
        x = wp.where(i == 1 or i == 2, 1.0, 0.0)
        y = wp.where(i >= 2, 1.0, 0.0)
        value = values[i]
        if (before < 0.0) != (value < 0.0):
            t = before / (before - value)
            cut = wp.vec2(from_x + (x - from_x) * t, from_y + (y - from_y) * t)
            if begun:
                twice += last[0] * cut[1] - last[1] * cut[0]
            else:
                first = cut
            begun = True
            last = cut
        if value < 0.0:
            corner = wp.vec2(x, y)
            if begun:
                twice += last[0] * corner[1] - last[1] * corner[0]
            else:
                first = corner
            begun = True
            last = corner
        before = value
        from_x = x
        from_y = y
    twice += last[0] * first[1] - last[1] * first[0]
    return 0.5 * wp.abs(twice)


@wp.func
def _beyond(corner: wp.vec3, edge: float, axis: int, scale: float) -> float:
    """Return by how much a corner lies beyond an edge between columns, 0, or rows, 1; times 1 over its distance."""
    return corner[axis] * scale - edge * corner[2]


@wp.func
def square_shown(row: TextureRow, footprint: Footprint) -> wp.vec3:
    """Return the column and the row of the one square that a pixel shows of a checkerboard, and 1; else the last is 0.

    A pixel that moves straight from one place in a square to another stays in it: squares are convex.
    """
    square = _square(footprint.top_left, row.scale)
    off = wp.length_sq(_square(footprint.top_right, row.scale) - square)
    off += wp.length_sq(_square(footprint.bottom_left, row.scale) - square)
    off += wp.length_sq(_square(footprint.bottom_right, row.scale) - square)
    return wp.vec3(square[0], square[1], wp.where(off == 0.0, 1.0, 0.0))


@wp.func
def checker_mean(row: TextureRow, footprint: Footprint, lines: int) -> wp.vec4:
    """Return the mean colour of a checkerboard over a pixel: exact where one edge crosses it, else along many lines.

    They run across the edges of squares that the pixel shows, as far as they can: along an edge, a line would see all
    of one side or of the other.
    """
    square = _square(footprint.top_left, row.scale)
    off_right = _square(footprint.top_right, row.scale) - square
    off_below = _square(footprint.bottom_left, row.scale) - square
    off_both = _square(footprint.bottom_right, row.scale) - square
    # Which edges cross the pixel: those between columns, those between rows.
    columns = wp.abs(off_right[0]) + wp.abs(off_below[0]) + wp.abs(off_both[0]) > 0.0
    rows = wp.abs(off_right[1]) + wp.abs(off_below[1]) + wp.abs(off_both[1]) > 0.0
    share = wp.where((int(square[0]) + int(square[1])) & 1 == 0, 1.0, 0.0)
    axis = wp.where(columns, 0, 1)
    off = wp.vec3(off_right[axis], off_below[axis], off_both[axis])
    if columns != rows and wp.max(off) - wp.min(off) <= 1.0 and wp.max(wp.abs(off)) == 1.0:
        # One edge crosses the pixel. What lies before it has the colour of the lower number.
        edge = square[axis] + wp.where(wp.min(off) < 0.0, 0.0, 1.0)
        share = _share_below(
            _beyond(footprint.top_left, edge, axis, row.scale),
            _beyond(footprint.top_right, edge, axis, row.scale),
            _beyond(footprint.bottom_right, edge, axis, row.scale),
            _beyond(footprint.bottom_left, edge, axis, row.scale),
        )
        if (int(edge) - 1 + int(square[1 - axis])) & 1 != 0:
            share = 1.0 - share
    elif columns or rows:
        middle = uv_in(footprint, 0.5, 0.5)
        right = uv_in(footprint, 1.0, 0.5) - middle
        down = uv_in(footprint, 0.5, 1.0) - middle
        transposed = bool(False)
        counts = wp.vec2(wp.where(columns, 1.0, 0.0), wp.where(rows, 1.0, 0.0))
        if counts[0] * wp.abs(down[0]) + counts[1] * wp.abs(down[1]) > (
            counts[0] * wp.abs(right[0]) + counts[1] * wp.abs(right[1])
        ):
            transposed = True
        ahead = footprint.top_right
        aside = footprint.bottom_left
        if transposed:
            ahead = footprint.bottom_left
            aside = footprint.top_right
        share = float(0.0)
        for line in range(lines):
            y = (float(line) + 0.5) / float(lines)
            start = footprint.top_left + (aside - footprint.top_left) * y
            end = ahead + (footprint.bottom_right - ahead) * y
            share += _share_along(start, end, row.scale)
        share = share / float(lines)
    color = row.color_a * share + row.color_b * (1.0 - share)
    return wp.vec4(color[0], color[1], color[2], 1.0)


@wp.func
def bent(color: wp.vec3, bend: wp.vec3) -> wp.vec3:
    """Return c / (1 − bend·c): of colours under a coat that light crosses again and again."""
    return wp.cw_div(color, wp.vec3(1.0, 1.0, 1.0) - wp.cw_mul(bend, color))


@wp.func
def straightened(color: wp.vec3, bend: wp.vec3) -> wp.vec3:
    """Return the colour that is ``bent`` to that one."""
    return wp.cw_div(color, wp.vec3(1.0, 1.0, 1.0) + wp.cw_mul(bend, color))


@wp.func_native(
    native_code("image_mean.h", {"REPEAT": REPEAT, "MIRROR": MIRROR, "GOLDEN": _GOLDEN, "AT_ONCE": _AT_ONCE})
)
def smooth_mean(textures: Textures, row: TextureRow, footprint: Footprint, places: int, bend: wp.vec3) -> wp.vec4:
    """Return the mean of an image's colours, interpolated between its texels and `bent`, at so many places."""
    ...


@wp.func
def image_mean(textures: Textures, row: TextureRow, footprint: Footprint, places: int, bend: wp.vec3) -> wp.vec4:
    """Return the mean of an image's `bent` colours at so many places of a pixel, on a Fibonacci lattice."""
    total = wp.vec4()
    if row.nearest == 0:
        total = smooth_mean(textures, row, footprint, places, bend)
    else:
        y = float(0.5)
        for i in range(places):
            uv = uv_in(footprint, (float(i) + 0.5) / float(places), y)
            rgba = image(textures, row, uv)
            color = bent(wp.vec3(rgba[0], rgba[1], rgba[2]), bend)
            total += wp.vec4(color[0], color[1], color[2], rgba[3]) / float(places)
            y = y + wp.static(_GOLDEN)
            y = y - wp.floor(y)
    return total


@wp.func_native(native_code("prefetch.h"))
def _prefetch(array: wp.array(dtype=wp.uint32), index: int): ...


@wp.func
def _foresee_image(textures: Textures, row: TextureRow, uv: wp.vec2):
    """Ask for the two texels to the left of a place, which come from far away in memory."""
    st = row.uv_matrix * wp.vec3(uv[0], uv[1], 1.0)
    x = neighbour(int(wp.floor(fold(st[0], row.wrap_u) * float(row.width) - 0.5)), row.width, row.wrap_u)
    y = int(wp.floor((1.0 - fold(st[1], row.wrap_v)) * float(row.height) - 0.5))
    _prefetch(textures.texels, row.first + neighbour(y, row.height, row.wrap_v) * row.width + x)
    _prefetch(textures.texels, row.first + neighbour(y + 1, row.height, row.wrap_v) * row.width + x)


def make_textures(features: Features) -> tuple[Any, Any, Any]:
    """Return the Warp functions ``lookup(textures, index, uv)`` and ``mean(textures, index, footprint, places, bend)``.

    Both return linear R, G, B and alpha; ``mean`` that over a pixel, of colours `bent` by ``bend``: of images, from so
    many places on a Fibonacci lattice, of checkerboards, exact along the lines of as fine a grid. A third,
    ``foresee(textures, index, uv)``, says that a place will be looked up soon.
    """

    @wp.func
    def foresee(textures: Textures, index: int, uv: wp.vec2):
        if wp.static(features.images):
            if textures.rows[index].first >= 0:
                _foresee_image(textures, textures.rows[index], uv)

    @wp.func
    def lookup(textures: Textures, index: int, uv: wp.vec2) -> wp.vec4:
        row = textures.rows[index]
        value = wp.vec4()
        if wp.static(features.checkers):
            if row.first < 0:
                value = checker(row, uv)
        if wp.static(features.images):
            if row.first >= 0:
                value = image(textures, row, uv)
        return value

    @wp.func
    def mean(textures: Textures, index: int, footprint: Footprint, places: int, bend: wp.vec3) -> wp.vec4:
        row = textures.rows[index]
        total = wp.vec4()
        if wp.static(features.checkers):
            if row.first < 0:
                board = TextureRow()
                board.scale = row.scale
                board.color_a = bent(row.color_a, bend)
                board.color_b = bent(row.color_b, bend)
                total = checker_mean(board, footprint, int(wp.sqrt(float(places))))
        if wp.static(features.images):
            if row.first >= 0:
                total = image_mean(textures, row, footprint, places, bend)
        return total

    return lookup, mean, foresee
