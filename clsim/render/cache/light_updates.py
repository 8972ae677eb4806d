# ruff: noqa: UP018, RUF046
"""Updates of the radiance cache: kernels that add paths to its cells between frames.

Sums are of whole numbers (`_UNIT` parts), so that their order is without effect and runs are bit-identical.
"""

from typing import Any, NamedTuple

import warp as wp

from clsim.render.cache.light_cache import LEVELS, Asked, Cell, Followed, before_change, look_up_at, tells_before
from clsim.render.cache.light_grid import (
    add_shared,
    along_face,
    face_of,
    find_or_make,
    grid_of,
    in_cells,
    key_of,
    size_of,
)
from clsim.render.device.compiler import kernel_options, one_at_a_time

wp.set_module_options(kernel_options())

SUMS = 12
"""Of R, G and B, the number of paths, the sum of the squares of what they found (the mean over R, G and B), and sums of
their places in the cell, u and v from 0 to 1: of these, of their squares and product, and of what was found times
each."""
_COUNT, _SQUARES, _PLACES = wp.constant(3), wp.constant(4), wp.constant(5)
_PATHS = wp.constant(1)
"""Of what a pixel spent: primary rays, and these."""
_LEVELS = wp.constant(LEVELS)
_UNIT = wp.constant(4294967296.0)
_LEAST_SPREAD = wp.constant(1.0e-4)
"""Variance of the places of paths along u or v, in sides of a cell, of which there is always that much."""
_FEW = wp.constant(12.0)
"""Paths of which no plane is made: one bright path among so few looks like a slope, and is far off at the edge."""
_BY_CHANCE = wp.constant(2.0)
"""What a plane explains by chance alone is some twice the variance of one path over their number."""
_LARGEST = wp.constant(65536.0)
"""Irradiance, and its square, count as no more than this, in units of `Asked.unit`: sums stay below 2⁶³ for 30,000
paths as bright."""


def open_cells(
    spent: wp.array2d[int],
    positions: wp.array2d[wp.vec4],
    normals: wp.array2d[wp.vec4],
    asked: Asked,
    update: int,
    keys: wp.array[wp.int64],
    cells: wp.array[Cell],
    out_rows: wp.array3d[int],
    out_used: wp.array[int],
) -> None:
    """Find or make the cells of each path that are ``asked``, and keep what they knew so far.

    A thread is a pixel. ``spent`` ``[2, H·W]`` tells how many paths it traced; ``positions`` ``[paths, H·W]`` has the
    largest width of the finest cells there [m] last, 0 where a path met nothing. ``normals`` have a number last: twice
    that of the layer, and 1 more where light is smooth.
    """
    pixel = wp.tid()
    for i in range(spent[_PATHS, pixel]):
        p = positions[i, pixel]
        if p[3] > 0.0:
            size = size_of(p[3])
            side_m = wp.pow(2.0, float(size))
            n = normals[i, pixel]
            face = face_of(wp.vec3(n[0], n[1], n[2]))
            layer = int(n[3]) // 2
            finest = wp.where(int(n[3]) % 2 == 1, wp.max(asked.finest, asked.finest_if_smooth), asked.finest)
            for level in range(_LEVELS):
                grid = grid_of(size + level, face, layer)
                at = in_cells(wp.vec3(p[0], p[1], p[2]), side_m)
                key = key_of(grid, face // 2, wp.floor(at[0]), wp.floor(at[1]), wp.floor(at[2]))
                row = int(-1)
                if level >= finest:
                    row = find_or_make(keys, key, out_used)
                out_rows[i, level, pixel] = row
                if row >= 0 and (cells[row].update != update or cells[row].key == wp.int64(0)):
                    # Whoever comes first or at the same time writes the same.
                    cells[row].before = cells[row].light
                    cells[row].tilt_before = cells[row].tilt
                    cells[row].count_before = cells[row].count
                    cells[row].error_before = cells[row].error
                    cells[row].update = update
                    cells[row].key = key
                side_m = side_m * 2.0


def add_to_cells(
    first: int,
    spent: wp.array2d[int],
    positions: wp.array2d[wp.vec4],
    normals: wp.array2d[wp.vec4],
    lights: wp.array2d[wp.vec3],
    rows: wp.array3d[int],
    asked: Asked,
    cells: wp.array[Cell],
    followed: wp.array[Followed],
    sums: wp.array2d[wp.int64],
) -> None:
    """Add each path's irradiance to its cells; a thread is a pixel, from ``first`` on.

    Where the light is followed, it is what the path would have found before that changed.
    """
    pixel = first + wp.tid()
    for i in range(spent[_PATHS, pixel]):
        if positions[i, pixel][3] > 0.0:
            light = lights[i, pixel]
            known = bool(True)
            if asked.follows:
                cached = look_up_at(cells, followed, asked, positions[i, pixel], normals[i, pixel])
                known = tells_before(cached)
                light = before_change(cached, light)
            light = light / asked.unit
            p = positions[i, pixel]
            n = normals[i, pixel]
            axis = face_of(wp.vec3(n[0], n[1], n[2])) // 2
            side_m = wp.pow(2.0, float(size_of(p[3])))
            for level in range(_LEVELS):
                row = rows[i, level, pixel]
                if row >= 0 and known:
                    bright = float(0.0)
                    for channel in range(3):
                        value = wp.clamp(light[channel], 0.0, _LARGEST)
                        bright += value / 3.0
                        add_shared(sums, row, channel, wp.int64(value * _UNIT))
                    add_shared(sums, row, _COUNT, wp.int64(1))
                    add_shared(sums, row, _SQUARES, wp.int64(wp.min(bright * bright, _LARGEST) * _UNIT))
                    at = along_face(axis, in_cells(wp.vec3(p[0], p[1], p[2]), side_m))
                    u = at[0] - wp.floor(at[0])
                    v = at[1] - wp.floor(at[1])
                    add_shared(sums, row, _PLACES, wp.int64(u * _UNIT))
                    add_shared(sums, row, _PLACES + 1, wp.int64(v * _UNIT))
                    add_shared(sums, row, _PLACES + 2, wp.int64(u * u * _UNIT))
                    add_shared(sums, row, _PLACES + 3, wp.int64(v * v * _UNIT))
                    add_shared(sums, row, _PLACES + 4, wp.int64(u * v * _UNIT))
                    add_shared(sums, row, _PLACES + 5, wp.int64(bright * u * _UNIT))
                    add_shared(sums, row, _PLACES + 6, wp.int64(bright * v * _UNIT))
                side_m = side_m * 2.0


@wp.func
def _plane(sums: wp.array2d[wp.int64], row: int, count: float, bright: float, variance: float) -> wp.vec4:
    """Return the tilt of the plane through what the paths of a cell found, and the variance that it leaves.

    It is less steep than that of least squares, and even where chance explains it.
    """
    each = 1.0 / (_UNIT * count)
    u = float(sums[row, _PLACES]) * each
    v = float(sums[row, _PLACES + 1]) * each
    uu = float(sums[row, _PLACES + 2]) * each - u * u
    vv = float(sums[row, _PLACES + 3]) * each - v * v
    uv = float(sums[row, _PLACES + 4]) * each - u * v
    ub = float(sums[row, _PLACES + 5]) * each - u * bright
    vb = float(sums[row, _PLACES + 6]) * each - v * bright
    # Paths along a line tell nothing of what lies off it.
    uu += _LEAST_SPREAD
    vv += _LEAST_SPREAD
    across = wp.max(uu * vv - uv * uv, _LEAST_SPREAD * _LEAST_SPREAD)
    steep = wp.vec2((vv * ub - uv * vb) / across, (uu * vb - uv * ub) / across)
    explained = wp.clamp(steep[0] * ub + steep[1] * vb, 0.0, variance)
    left = wp.max(variance - explained, 0.0)
    share = float(0.0)
    if count > _FEW and explained > 0.0:
        share = wp.max(1.0 - _BY_CHANCE * left / (explained * (count - 3.0)), 0.0)
    steep = steep * (share / bright)
    return wp.vec4(1.0 - steep[0] * u - steep[1] * v, steep[0], steep[1], variance - share * (2.0 - share) * explained)


def average(
    first: int,
    spent: wp.array2d[int],
    positions: wp.array2d[wp.vec4],
    rows: wp.array3d[int],
    sums: wp.array2d[wp.int64],
    cells: wp.array[Cell],
) -> None:
    """Turn the sums of the cells that were added to into means; a thread is a pixel, from ``first`` on.

    All threads of a cell write the same.
    """
    pixel = first + wp.tid()
    for i in range(spent[_PATHS, pixel]):
        if positions[i, pixel][3] > 0.0:
            for level in range(_LEVELS):
                row = rows[i, level, pixel]
                if row >= 0 and sums[row, _COUNT] > wp.int64(0):
                    count = float(sums[row, _COUNT])
                    total = wp.vec3(float(sums[row, 0]), float(sums[row, 1]), float(sums[row, 2]))
                    cells[row].light = total / (_UNIT * count)
                    cells[row].count = count
                    bright = (total[0] + total[1] + total[2]) / (3.0 * _UNIT * count)
                    squares = float(sums[row, _SQUARES]) / (_UNIT * count)
                    # One path tells nothing of how different others are: its light may be any.
                    error = float(1.0)
                    cells[row].tilt = wp.vec3(1.0, 0.0, 0.0)
                    if count > 1.0 and bright > 0.0:
                        fit = _plane(sums, row, count, bright, wp.max(squares - bright * bright, 0.0))
                        cells[row].tilt = wp.vec3(fit[0], fit[1], fit[2])
                        error = wp.sqrt(fit[3] / (count - 1.0)) / bright
                    cells[row].error = wp.min(error, 1.0) * bright


def move_cells(
    source_sums: wp.array2d[wp.int64],
    source: wp.array[Cell],
    oldest: int,
    keys: wp.array[wp.int64],
    sums: wp.array2d[wp.int64],
    cells: wp.array[Cell],
    out_used: wp.array[int],
    out_rows: wp.array[int],
) -> None:
    """Copy the cells that were added to since the update ``oldest``; a thread is a row of ``source``.

    ``out_rows`` tells where each is now, −1 where it was not copied.
    """
    row = wp.tid()
    cell = source[row]
    out_rows[row] = -1
    if cell.key != wp.int64(0) and cell.update >= oldest:
        to = find_or_make(keys, cell.key, out_used)
        if to >= 0:
            cells[to] = cell
            out_rows[row] = to
            for field in range(wp.static(SUMS)):
                sums[to, field] = source_sums[row, field]


class Updates(NamedTuple):
    """The kernels `open_cells`, `add_to_cells`, `average` and `move_cells`."""

    open_cells: Any
    add_to_cells: Any
    average: Any
    move_cells: Any


@one_at_a_time
def build_updates() -> Updates:
    """Return the kernels that keep what paths find, which are the same for all scenes."""
    return Updates(*map(wp.kernel(enable_backward=False), (open_cells, add_to_cells, average, move_cells)))
