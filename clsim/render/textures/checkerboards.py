# ruff: noqa: UP018
"""Checkerboards, and their means over what a pixel shows, as Warp functions."""

import warp as wp

from clsim.render.textures.texture_data import Footprint, TextureRow, uv_in

_MOST_SQUARES = wp.constant(64)
"""Squares on a line through a pixel; where there are more, they are so small that both colours cover half."""


@wp.func
def checker(row: TextureRow, uv: wp.vec2) -> wp.vec4:
    """Return the colour of a checkerboard; the square at the origin of uv has the first colour."""
    square = int(wp.floor(uv[0] * row.scale)) + int(wp.floor(uv[1] * row.scale))
    color = wp.where((square & 1) == 0, row.color_a, row.color_b)
    return wp.vec4(color[0], color[1], color[2], 1.0)


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
