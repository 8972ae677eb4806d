# ruff: noqa: UP018, RUF046
"""The radiance cache: means of what paths found, in the cells of a hashed grid on surfaces.

Where nothing but the camera moves, the irradiance of a surface does not change; so all paths that ever started there
may be averaged. A cell holds the sum of irradiances found in a cube a few pixels wide, of surfaces that face one of six
ways; each path counts in such a cube and in larger ones, `LEVELS` in all. For a first hit, the cells around it are
interpolated, and where a level knows few paths the next coarser one takes part (after Binder, Fricke and Keller,
"Massively Parallel Path Space Filtering", 2021, without its jitter).

The mean becomes better with every frame, and so it changes; that must fire no events. Hence a cell also holds its mean
before the last frame's paths, and `look_up` gives both: their ratio is a gain of knowledge, not of light.

The error of a cell's light is the standard error of its paths.

Where something else than the camera moves, or light changes, cells lie on what moves, and some paths are stored in
them and traced again (`stored_paths.py`). The ratio of what these find now to what they found at first tells how the
light has changed: `Followed` has that, and the mean is of the light as it was at first.
"""

import warp as wp

from clsim.render.cache.light_grid import (
    BLOCK,
    PROBES,
    along_face,
    face_of,
    first_row,
    grid_of,
    in_cells,
    key_of,
    size_of,
)
from clsim.render.device.compiler import kernel_options
from clsim.render.sampling import sampling

wp.set_module_options(kernel_options())

LEVELS = 4
_LEVELS = wp.constant(LEVELS)
_BLOCK = wp.constant(BLOCK)
_ALIGNED = wp.constant(0.9999)
"""Where a surface faces along an axis so nearly, it lies within one layer of cells."""
_SURE = wp.constant(1.0)
"""Square of the standard errors by which cells of two sizes differ before the finer ones are trusted."""
_LEAST_TILTED = wp.constant(0.25)
"""Part of a cell's light that is left at its edge, at least: beyond, a plane through few paths tells nothing."""
_LEAST_FACTOR = wp.constant(0.05)
"""Where light has become less than this part of what it was, it tells nothing of that."""


@wp.struct
class Cell:
    """A cell of the cache, as shading reads it.

    Attributes:
        key: what tells it from others; 0 where the row is free.
        light: mean irradiance over π, in units of `Asked.unit`, as are all others of light.
        tilt: what it is times that across the cell is 1, u and v times these, of the place in it from 0 to 1.
        count: number of paths.
        update: number of the last update that added to it.
        before: the light before that.
        tilt_before: its tilt.
        count_before: number of paths before that.
        error: standard error of the brightness of the light.
        error_before: that of the light before.
    """

    key: wp.int64
    light: wp.vec3
    tilt: wp.vec3
    count: float
    update: int
    before: wp.vec3
    tilt_before: wp.vec3
    count_before: float
    error: float
    error_before: float


@wp.struct
class Followed:
    """The change of a cell's light, by its stored paths: it is ``factor`` times what was averaged, and ``more``.

    Attributes:
        factor: by which the light has changed.
        more: light that came where next to none was, in units of `Asked.unit`.
        count: number of stored paths; 0 tells of no change.
        error: standard error of the factor, in brightness.
        step: by how much the factor has changed in the step to the frame ``stepped``, from what it was ``last``.
        stepped: number of a frame.
    """

    factor: wp.vec3
    more: wp.vec3
    count: float
    error: float
    step: wp.vec3
    last: wp.vec3
    stepped: int


@wp.struct
class CachedLight:
    """The light at a point, interpolated from the cells around it.

    Attributes:
        light: irradiance over π, as the cells know it.
        known: number of paths that were near, in cells of all sizes.
        before: the same, as they knew it before the last update.
        known_before: whether any path was near before the last update.
        in_finest: number of paths in the finest cells alone.
        off: relative error of the light: that of each cell, and that of its change, is its standard error with a random
            sign, which stays the same. Where nobody asked, 0.
        off_before: the same of the light before.
        factor, more: of `Followed`, 1 and 0 where no path is stored.
    """

    light: wp.vec3
    known: float
    before: wp.vec3
    known_before: bool
    in_finest: float
    off: float
    off_before: float
    factor: wp.vec3
    more: wp.vec3


@wp.struct
class Asked:
    """Settings of a look-up: which cells are read, and what counts as before.

    Attributes:
        finest: the first level that is asked; 0 has the finest cells.
        finest_before: the same, for the light as it was known before.
        finest_if_smooth: no level below is looked up where light is smooth, as the cache holds no direct light there.
        last_update: what was known before is what cells knew before that update, …
        between: … or before a later one: between frames light is shown as in the frame that ends the step, whose paths
            are in the cells by then.
        tells_error: whether it is told how far the light might be off.
        follows: whether stored paths tell how the light has changed.
        enough_stored: stored paths with which a level counts as much as all coarser ones, where they tell that.
        frame: number of the last frame, …
        to_go: … and the share of the step to it that is left: in it, light changes along a line.
        unit: what a light of 1 in a cell is: a power of two near what paths find, for sums of whole numbers.
    """

    finest: int
    finest_before: int
    finest_if_smooth: int
    last_update: int
    between: bool
    tells_error: bool
    follows: bool
    enough_stored: float
    frame: int
    to_go: float
    unit: float


@wp.func
def _tilted(light: wp.vec3, tilt: wp.vec3, place: wp.vec2) -> wp.vec3:
    """Return the light of a cell at a place in it, or beyond its edge."""
    return light * wp.clamp(tilt[0] + tilt[1] * place[0] + tilt[2] * place[1], _LEAST_TILTED, 1.0 / _LEAST_TILTED)


@wp.func
def _error_at(error: float, tilt: wp.vec3, place: wp.vec2) -> float:
    """Return the standard error of a cell's light at a place: of a plane it grows with the distance from the middle."""
    after = error
    if tilt[1] != 0.0 or tilt[2] != 0.0:
        away = place - wp.vec2(0.5, 0.5)
        # Places in a cell have a variance of a twelfth along each side.
        after = error * wp.sqrt(1.0 + 12.0 * wp.dot(away, away))
    return after


@wp.func
def _find(cells: wp.array[Cell], key: wp.int64) -> int:
    """Return the row of a cell, -1 where there is none."""
    mask = cells.shape[0] - 1
    row = first_row(key, mask)
    found = int(-1)
    for _ in range(PROBES):
        there = cells[row].key
        if there == key:
            found = row
        if there == key or there == wp.int64(0):
            break
        row = (row + _BLOCK) & mask
    return found


@wp.func
def bright_of(light: wp.vec3) -> float:
    """Return the mean over R, G and B."""
    return (light[0] + light[1] + light[2]) / 3.0


@wp.func
def _sign_of(key: wp.int64) -> float:
    """Return 1 or −1, by chance, but always the same for that cell."""
    odd = sampling.mix64(wp.uint64(key)) & wp.uint64(1)
    return wp.where(odd == wp.uint64(1), 1.0, -1.0)


@wp.struct
class Level:
    """The light at a point, by the cells of one size or of several.

    Attributes:
        light: irradiance over π.
        off: by how much its brightness might be off, in each cell up or down by chance.
        variance: of what one path finds, in brightness.
        paths: number of paths near the point.
    """

    light: wp.vec3
    off: float
    variance: float
    paths: float


@wp.func
def _finer(coarse: Level, sums: Level, asked: bool) -> Level:
    """Return what coarser cells know, and, if ``asked``, those of the next finer size, of which there are ``sums``.

    The finer ones blur less and know fewer paths. They are trusted by as much as they differ from the coarser ones
    beyond what chance explains: with b² what is left, and v the variance of their mean, they have the weight
    b² / (b² + v), as Wiener's filter has it.
    """
    after = coarse
    if asked and sums.paths > 0.0:
        each = 1.0 / sums.paths
        known = coarse.paths + sums.paths
        # Of few paths the variance is badly known: what is told by the more paths of coarser cells has more weight.
        variance = (coarse.variance * coarse.paths + sums.variance) / known
        light = sums.light * each
        differs = bright_of(light) - bright_of(coarse.light)
        chance = variance * each
        beyond = wp.max(differs * differs - _SURE * chance, 0.0)
        share = float(1.0)
        if coarse.paths > 0.0:
            share = beyond / wp.max(beyond + chance, 1.0e-30)
        after.light = coarse.light + (light - coarse.light) * share
        after.off = coarse.off + (sums.off * each - coarse.off) * share
        after.variance = variance
        after.paths = known
    return after


@wp.func
def look_up(
    cells: wp.array[Cell],
    followed: wp.array[Followed],
    asked: Asked,
    position: wp.vec3,
    normal: wp.vec3,
    layer: int,
    smooth: bool,
    width_m: float,
) -> CachedLight:
    """Return what is known of the light on a surface, from cells no wider than ``width_m``, or coarser ones.

    The ``layer`` is one of `layer_of`. ``smooth`` is as in `Asked`.
    """
    cached = CachedLight()
    least = wp.where(smooth, asked.finest_if_smooth, 0)
    finest = wp.max(asked.finest, least)
    finest_before = wp.max(asked.finest_before, least)
    size = size_of(width_m)
    side_m = wp.pow(2.0, float(size + _LEVELS - 1))
    face = face_of(normal)
    axis = face // 2
    aligned = wp.max(wp.abs(normal[0]), wp.max(wp.abs(normal[1]), wp.abs(normal[2]))) > _ALIGNED
    whole = Level()
    whole_before = Level()
    factor = wp.vec3(1.0, 1.0, 1.0)
    more = wp.vec3()
    told = float(0.0)
    off_factor = float(0.0)
    # As a variable, so that the loop is compiled once and not eight times.
    corners = int(8)
    level = int(_LEVELS - 1)
    while level >= wp.min(finest, finest_before):
        at = in_cells(position, side_m) - wp.vec3(0.5, 0.5, 0.5)
        corner = wp.vec3()
        part = wp.vec3()
        for k in range(3):
            in_layer = aligned and k == axis
            corner[k] = wp.floor(at[k] + wp.where(in_layer, 0.5, 0.0))
            part[k] = wp.where(in_layer, 0.0, at[k] - corner[k])
        grid = grid_of(size + level, face, layer)
        sums = Level()
        sums_before = Level()
        factors = wp.vec3()
        extra = wp.vec3()
        off_there = float(0.0)
        paths = float(0.0)
        for i in range(corners):
            dx = float(i & 1)
            dy = float((i >> 1) & 1)
            dz = float(i >> 2)
            weight = (1.0 - wp.abs(dx - part[0])) * (1.0 - wp.abs(dy - part[1])) * (1.0 - wp.abs(dz - part[2]))
            if weight > 1.0e-4:
                row = _find(cells, key_of(grid, axis, corner[0] + dx, corner[1] + dy, corner[2] + dz))
                if row >= 0:
                    cell = cells[row]
                    place = along_face(axis, part - wp.vec3(dx, dy, dz)) + wp.vec2(0.5, 0.5)
                    light = _tilted(cell.light, cell.tilt, place)
                    error = _error_at(cell.error, cell.tilt, place)
                    off = float(0.0)
                    if asked.tells_error:
                        off = _sign_of(cell.key)
                    # In place: a struct that is assigned anew in a branch is copied each time.
                    count = weight * cell.count
                    sums.light += light * count
                    sums.paths += count
                    sums.variance += error * error * cell.count * count
                    sums.off += off * error * count
                    if cell.update == asked.last_update or (asked.between and cell.update > asked.last_update):
                        light = _tilted(cell.before, cell.tilt_before, place)
                        error = _error_at(cell.error_before, cell.tilt_before, place)
                        cell.count = cell.count_before
                    count = weight * cell.count
                    sums_before.light += light * count
                    sums_before.paths += count
                    sums_before.variance += error * error * cell.count * count
                    sums_before.off += off * error * count
                    if asked.follows:
                        by = followed[row]
                        if by.stepped == asked.frame:
                            by.factor -= by.step * asked.to_go
                        factors += by.factor * (weight * by.count)
                        extra += by.more * (weight * by.count)
                        if asked.tells_error:
                            # By chance too, whatever the sign of the cell's own error.
                            off_there += _sign_of(-cell.key) * by.error * (weight * by.count)
                        paths += weight * by.count
        # By the same rule in both, so that what was known before is what the last frame showed.
        whole = _finer(whole, sums, level >= finest)
        whole_before = _finer(whole_before, sums_before, level >= finest_before)
        if level >= finest:
            cached.in_finest = sums.paths
        if paths > 0.0:
            share = wp.where(told > 0.0, paths / (paths + asked.enough_stored), 1.0)
            factor += (factors / paths - factor) * share
            more += (extra / paths - more) * share
            off_factor += (off_there / paths - off_factor) * share
            told += paths
        side_m = side_m * 0.5
        level = level - 1
    cached.known = whole.paths
    cached.factor = factor
    cached.more = more * asked.unit
    cached.light = wp.cw_mul(whole.light, factor) * asked.unit + cached.more
    off_factor = off_factor / wp.max(bright_of(factor), _LEAST_FACTOR)
    cached.off = whole.off / wp.max(bright_of(whole.light), 1.0e-20) + off_factor
    cached.known_before = whole_before.paths > 0.0
    cached.before = wp.cw_mul(whole_before.light, factor) * asked.unit + cached.more
    cached.off_before = whole_before.off / wp.max(bright_of(whole_before.light), 1.0e-20) + off_factor
    return cached


@wp.func
def look_up_at(
    cells: wp.array[Cell], followed: wp.array[Followed], asked: Asked, position: wp.vec4, normal: wp.vec4
) -> CachedLight:
    """Return what is known where a path began: its position and normal are as `light_updates.open_cells` takes them."""
    place = wp.vec3(position[0], position[1], position[2])
    facing = wp.vec3(normal[0], normal[1], normal[2])
    kind = int(normal[3])
    return look_up(cells, followed, asked, place, facing, kind // 2, kind % 2 == 1, position[3])


@wp.func
def tells_before(cached: CachedLight) -> bool:
    """Whether light there tells what it was before it changed: what is dark now tells nothing."""
    return cached.factor[0] + cached.factor[1] + cached.factor[2] > _LEAST_FACTOR


@wp.func
def before_change(cached: CachedLight, light: wp.vec3) -> wp.vec3:
    """Return what that light was before it changed."""
    before = wp.vec3()
    for c in range(3):
        before[c] = wp.max(light[c] - cached.more[c], 0.0) / wp.max(cached.factor[c], _LEAST_FACTOR)
    return before
