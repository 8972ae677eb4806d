# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018, SIM102, RUF046
"""Light kept on surfaces: what paths found, remembered in the cells of a hashed grid in the world.

Where nothing but the camera moves, the irradiance of a surface does not change; so all paths that ever ended a first
hit there may be averaged. A cell holds the sum of irradiances found in a cube about a pixel wide, of surfaces that face
one of six ways; each path counts in such a cube and in larger ones, `LEVELS` in all. Seen from a first hit, the
cells round it are interpolated, and where a level knows few paths the next coarser one takes part (after Binder,
Fricke and Keller, "Massively Parallel Path Space Filtering", 2021, without its jitter).

The average becomes better with every frame, and so it changes; that must fire no events. Hence a cell also keeps what
it knew before the last frame's paths, and `look_up` gives both: their ratio is a gain of knowledge, not of light.

Sums are of whole numbers (`_UNIT` parts), so that their order is without effect and runs are bit-identical.
"""

import warp as wp

from clsim.render import sampling
from clsim.render.sampling import luminance

LEVELS = 4
_LEVELS = wp.constant(LEVELS)
_WANTED = wp.constant(64.0)
"""Paths with which a level counts as much as all coarser ones."""
_ENOUGH = wp.constant(0.02)
"""Share of the coarser levels below which they are not asked."""
_PROBES = wp.constant(64)
_UNIT = wp.constant(4294967296.0)
_LARGEST = wp.constant(65536.0)
"""Irradiance counts as no more than this: sums stay below 2⁶³ for 30,000 paths as bright."""

FIELDS = 8
"""A cell is one line of a processor's cache: key (0 where free), sums of R, G and B, paths; luminance and paths before
the last update that added to it; number of that update."""
_KEY = wp.constant(0)
_SUM = wp.constant(1)
_COUNT = wp.constant(4)
_SUM_BEFORE = wp.constant(5)
_COUNT_BEFORE = wp.constant(6)
_UPDATE = wp.constant(7)


@wp.struct
class Kept:
    """What the cells know of the light at a point.

    Attributes:
        light: irradiance over π, as the cells know it.
        before: its luminance, as they knew it before the last update.
        known: 1 where many paths were near, 0 where none was.
        known_before: whether any path was near before the last update.
    """

    light: wp.vec3
    before: float
    known: float
    known_before: bool


@wp.func
def _side_m(footprint_m: float) -> float:
    """Return the side of the finest cells for a pixel so wide: a power of 2, so that few sides occur."""
    return wp.pow(2.0, wp.floor(wp.log2(wp.max(footprint_m, 1.0e-9))))


@wp.func
def _face(normal: wp.vec3) -> int:
    """Return which of six ways a surface faces."""
    axis = int(0)
    if wp.abs(normal[1]) > wp.abs(normal[axis]):
        axis = 1
    if wp.abs(normal[2]) > wp.abs(normal[axis]):
        axis = 2
    return 2 * axis + wp.where(normal[axis] > 0.0, 1, 0)


@wp.func
def _grid(side_m: float, face: int) -> wp.uint64:
    """Return what tells the cells of this side and face from others, for `_key_of`."""
    return sampling.absorb(wp.uint64(face), int(wp.log2(side_m)))


@wp.func
def _key_of(grid: wp.uint64, x: float, y: float, z: float) -> wp.int64:
    """Return the key of the cell with these whole coordinates, never 0."""
    mixed = wp.uint64(wp.int64(x)) * wp.uint64(0x9E3779B97F4A7C15) + wp.uint64(wp.int64(y)) * wp.uint64(
        0xD1342543DE82EF95
    )
    mixed = mixed + wp.uint64(wp.int64(z)) * wp.uint64(0x94D049BB133111EB)
    return wp.int64(sampling.mix64(grid + mixed) | wp.uint64(1))


@wp.func
def _find(cells: wp.array2d(dtype=wp.int64), key: wp.int64) -> int:
    """Return the row of a cell, -1 where there is none."""
    mask = cells.shape[0] - 1
    row = int(wp.uint64(key) >> wp.uint64(20)) & mask
    found = int(-1)
    for _ in range(_PROBES):
        there = cells[row, _KEY]
        if there == key:
            found = row
        if there == key or there == wp.int64(0):
            break
        row = (row + 1) & mask
    return found


@wp.func
def _find_or_make(cells: wp.array2d(dtype=wp.int64), key: wp.int64, out_used: wp.array(dtype=int)) -> int:
    """Return the row of a cell, a new one if need be; -1 where there is no room."""
    mask = cells.shape[0] - 1
    row = int(wp.uint64(key) >> wp.uint64(20)) & mask
    found = int(-1)
    for _ in range(_PROBES):
        there = wp.atomic_cas(cells, row, _KEY, wp.int64(0), key)
        if there == wp.int64(0):
            wp.atomic_add(out_used, 0, 1)
        if there == wp.int64(0) or there == key:
            found = row
            break
        row = (row + 1) & mask
    return found


@wp.func
def _sums(cells: wp.array2d(dtype=wp.int64), row: int) -> wp.vec3:
    return wp.vec3(float(cells[row, _SUM]), float(cells[row, _SUM + 1]), float(cells[row, _SUM + 2]))


@wp.func
def look_up(
    cells: wp.array2d(dtype=wp.int64), last_update: int, position: wp.vec3, normal: wp.vec3, footprint_m: float
) -> Kept:
    """Return what is known of the light on a surface, from cells as wide as a pixel there and coarser ones.

    What was known before is what it was before ``last_update``.
    """
    kept = Kept()
    side_m = _side_m(footprint_m)
    face = _face(normal)
    left = float(1.0)
    left_before = float(1.0)
    for _ in range(_LEVELS):
        at = position / side_m - wp.vec3(0.5, 0.5, 0.5)
        corner = wp.vec3(wp.floor(at[0]), wp.floor(at[1]), wp.floor(at[2]))
        part = at - corner
        grid = _grid(side_m, face)
        light = wp.vec3(0.0, 0.0, 0.0)
        count = float(0.0)
        before = float(0.0)
        count_before = float(0.0)
        for i in range(8):
            dx = float(i & 1)
            dy = float((i >> 1) & 1)
            dz = float(i >> 2)
            weight = (1.0 - wp.abs(dx - part[0])) * (1.0 - wp.abs(dy - part[1])) * (1.0 - wp.abs(dz - part[2]))
            if weight > 1.0e-4:
                row = _find(cells, _key_of(grid, corner[0] + dx, corner[1] + dy, corner[2] + dz))
                if row >= 0:
                    sums = _sums(cells, row)
                    paths = cells[row, _COUNT]
                    light += sums * (weight / _UNIT)
                    count += weight * float(paths)
                    sum_before = luminance(sums)
                    if cells[row, _UPDATE] == wp.int64(last_update):
                        sum_before = float(cells[row, _SUM_BEFORE])
                        paths = cells[row, _COUNT_BEFORE]
                    before += sum_before * (weight / _UNIT)
                    count_before += weight * float(paths)
        if count > 0.0:
            share = left * count / (count + _WANTED)
            kept.light += light * (share / count)
            left = left - share
        if count_before > 0.0:
            share = left_before * count_before / (count_before + _WANTED)
            kept.before += before * (share / count_before)
            left_before = left_before - share
        if left_before < _ENOUGH:
            break
        side_m = side_m * 2.0
    kept.known = 1.0 - left
    if kept.known > 0.0:
        kept.light = kept.light / kept.known
    kept.known_before = left_before < 1.0
    if kept.known_before:
        kept.before = kept.before / (1.0 - left_before)
    return kept


@wp.kernel(enable_backward=False)
def open_cells(
    positions: wp.array2d(dtype=wp.vec4),
    normals: wp.array2d(dtype=wp.vec3),
    update: int,
    cells: wp.array2d(dtype=wp.int64),
    out_rows: wp.array3d(dtype=int),
    out_used: wp.array(dtype=int),
):
    """Find or make the cells of each path, and keep what they knew so far.

    A thread is a pixel. ``positions`` ``[paths, H·W]`` has the width of a pixel there [m] last, 0 where no path was.
    """
    pixel = wp.tid()
    for i in range(positions.shape[0]):
        p = positions[i, pixel]
        if p[3] > 0.0:
            side_m = _side_m(p[3])
            face = _face(normals[i, pixel])
            for level in range(_LEVELS):
                grid = _grid(side_m, face)
                key = _key_of(grid, wp.floor(p[0] / side_m), wp.floor(p[1] / side_m), wp.floor(p[2] / side_m))
                row = _find_or_make(cells, key, out_used)
                out_rows[i, level, pixel] = row
                if row >= 0:
                    if cells[row, _UPDATE] != wp.int64(update):
                        # Whoever comes first or at the same time writes the same.
                        cells[row, _SUM_BEFORE] = wp.int64(luminance(_sums(cells, row)))
                        cells[row, _COUNT_BEFORE] = cells[row, _COUNT]
                        cells[row, _UPDATE] = wp.int64(update)
                side_m = side_m * 2.0


@wp.kernel(enable_backward=False)
def add_to_cells(
    positions: wp.array2d(dtype=wp.vec4),
    lights: wp.array2d(dtype=wp.vec3),
    rows: wp.array3d(dtype=int),
    cells: wp.array2d(dtype=wp.int64),
):
    """Add each path's irradiance to its cells; a thread is a pixel."""
    pixel = wp.tid()
    for i in range(positions.shape[0]):
        if positions[i, pixel][3] > 0.0:
            light = lights[i, pixel]
            for level in range(_LEVELS):
                row = rows[i, level, pixel]
                if row >= 0:
                    for channel in range(3):
                        value = wp.clamp(light[channel], 0.0, _LARGEST)
                        wp.atomic_add(cells, row, _SUM + channel, wp.int64(value * _UNIT))
                    wp.atomic_add(cells, row, _COUNT, wp.int64(1))


@wp.kernel(enable_backward=False)
def move_cells(
    source: wp.array2d(dtype=wp.int64),
    oldest: int,
    cells: wp.array2d(dtype=wp.int64),
    out_used: wp.array(dtype=int),
):
    """Copy the cells that were added to since the update ``oldest``; a thread is a row of ``source``."""
    row = wp.tid()
    if source[row, _KEY] != wp.int64(0) and source[row, _UPDATE] >= wp.int64(oldest):
        to = _find_or_make(cells, source[row, _KEY], out_used)
        if to >= 0:
            for field in range(1, 8):
                cells[to, field] = source[row, field]
