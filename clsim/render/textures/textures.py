# ruff: noqa: SIM102, UP018
"""Textures: checkerboards and images, filtered by hand, as Warp functions."""

from typing import Any

import warp as wp

from clsim.render.features.features import Features
from clsim.render.native import native_code
from clsim.render.textures.checkerboards import checker, checker_mean
from clsim.render.textures.texture_data import MIRROR, REPEAT, Footprint, Spot, TextureRow, Textures, uv_in

_GOLDEN = 0.6180339887
_AT_ONCE = 32


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
def spot_of(row: TextureRow, uv: wp.vec2) -> Spot:
    """Return where an image is read: texel centres lie at half-integers, row 0 at v = 1."""
    st = row.uv_matrix * wp.vec3(uv[0], uv[1], 1.0)
    x = fold(st[0], row.wrap_u) * float(row.width)
    y = (1.0 - fold(st[1], row.wrap_v)) * float(row.height)
    spot = Spot()
    spot.decoding = row.decoding
    if row.nearest != 0:
        # Places too far away for a number may be any.
        nearest_row = wp.clamp(int(y), 0, row.height - 1)
        spot.upper_left = row.first + nearest_row * row.width + wp.clamp(int(x), 0, row.width - 1)
        spot.upper_right = spot.upper_left
        spot.lower_left = spot.upper_left
        spot.lower_right = spot.upper_left
    else:
        left = wp.floor(x - 0.5)
        top = wp.floor(y - 0.5)
        spot.right_share = x - 0.5 - left
        spot.bottom_share = y - 0.5 - top
        x0 = neighbour(int(left), row.width, row.wrap_u)
        x1 = neighbour(int(left) + 1, row.width, row.wrap_u)
        upper = row.first + neighbour(int(top), row.height, row.wrap_v) * row.width
        lower = row.first + neighbour(int(top) + 1, row.height, row.wrap_v) * row.width
        spot.upper_left = upper + x0
        spot.upper_right = upper + x1
        spot.lower_left = lower + x0
        spot.lower_right = lower + x1
    return spot


@wp.func
def texel(textures: Textures, decoding: int, place: int) -> wp.vec4:
    """Return the linear value of a texel; alpha is never encoded."""
    word = int(textures.texels[place])
    return wp.vec4(
        textures.decoding[decoding + (word & 255)],
        textures.decoding[decoding + ((word >> 8) & 255)],
        textures.decoding[decoding + ((word >> 16) & 255)],
        textures.decoding[(word >> 24) & 255],
    )


@wp.func
def at_spot(textures: Textures, s: Spot) -> wp.vec4:
    """Return what an image shows there, interpolated between texels."""
    left, right = 1.0 - s.right_share, s.right_share
    upper = texel(textures, s.decoding, s.upper_left) * left + texel(textures, s.decoding, s.upper_right) * right
    lower = texel(textures, s.decoding, s.lower_left) * left + texel(textures, s.decoding, s.lower_right) * right
    return upper * (1.0 - s.bottom_share) + lower * s.bottom_share


@wp.func
def image(textures: Textures, row: TextureRow, uv: wp.vec2) -> wp.vec4:
    """Return an image's value."""
    return at_spot(textures, spot_of(row, uv))


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
def smooth_mean(  # type: ignore[empty-body]
    textures: Textures, row: TextureRow, footprint: Footprint, places: int, bend: wp.vec3
) -> wp.vec4:
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
def _prefetch(array: wp.array[wp.uint32], index: int) -> None: ...


def make_textures(features: Features) -> tuple[Any, Any, Any]:
    """Return the Warp functions ``lookup(textures, index, uv)`` and ``mean(textures, index, footprint, places, bend)``.

    Both return linear R, G, B and alpha; ``mean`` that over a pixel, of colours `bent` by ``bend``: of images, from so
    many places on a Fibonacci lattice, of checkerboards, exact along the lines of as fine a grid. A third,
    ``foresee(textures, index, uv)``, asks for texels to the left of a place, which come from far away in memory, and
    returns where it is, for ``at_spot``; of a checkerboard that has no ``decoding``.
    """

    @wp.func
    def foresee(textures: Textures, index: int, uv: wp.vec2) -> Spot:
        spot = Spot()
        spot.decoding = -1
        if wp.static(features.images):
            if textures.rows[index].first >= 0:
                spot = spot_of(textures.rows[index], uv)
                _prefetch(textures.texels, spot.upper_left)
                _prefetch(textures.texels, spot.lower_left)
        return spot

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
