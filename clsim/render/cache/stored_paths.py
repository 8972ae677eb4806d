# ruff: noqa: UP018
"""Stored paths: in cells of the cache, traced again with the same random numbers when what they met has moved.

Each begins at a place on a surface, moves along with it, and has the same random numbers in every frame. So what the
paths of a cell find does not depend on the past: what moves and comes back gives the same bits. The ratio of what they
find now to what they would find if light had not changed since the first frame is the factor by which it has.

A path is traced again where a way of its trail (`trails.py`) leads through what has moved, where it begins on that, and
where lights have changed.

Sums are of whole numbers, so that their order is without effect.
"""

from typing import Any, NamedTuple

import warp as wp

from clsim.render.accel.geometry import make_placement, transform_vector
from clsim.render.cache.light_cache import (
    LEVELS,
    Asked,
    CachedLight,
    Cell,
    Followed,
    before_change,
    bright_of,
    look_up_at,
    tells_before,
)
from clsim.render.cache.light_grid import add_shared
from clsim.render.cache.path_limits import (
    NO_LIMIT,
    UNIT,
    add_beyond,
    beyond_limit,
    counted_of,
    left_out_of,
    limit_of,
    whole,
)
from clsim.render.cache.trails import Moved, trail_crosses
from clsim.render.device.compiler import kernel_options, one_at_a_time
from clsim.render.kernel_input import Scene, Settings
from clsim.render.primary.seen_surfaces import lit_albedo
from clsim.render.sampling import sampling
from clsim.render.sampling.sobol import make_sampler, reverse_bits

wp.set_module_options(kernel_options())

FOLLOWED_SUMS = 18
"""Of R, G and B, the number of paths, and R, G and B as they were before light changed; of the brightness of both, up
to each path's limit, the squares: that of now, the product, and that of before; what of R, G and B is beyond the limits
now, and how many paths that is, and these as they were before."""
_COUNT, _BASE, _SQUARES, _BEYOND, _BEYOND_BEFORE = (wp.constant(field) for field in (3, 4, 7, 10, 14))
_LEVELS = wp.constant(LEVELS)
_STORED_AT = wp.constant(2)
"""Level of the cells that tell how many paths are stored, of those that are asked."""
_PATHS = wp.constant(1)
"""Of what a pixel spent: primary rays, and these."""
OWN = wp.constant(1 << 16)
"""Number of a pixel's first path: beyond those of all primary rays."""
_LONGEST_AGE = wp.constant(64)
"""Frames after which what a path found says nothing of how fast that changes."""
_MOST_UNEVEN = wp.constant(4.0)
"""Times as many paths are stored at most where they find light that differs much."""
_MOST = wp.constant(8.0)
"""Largest factor by which light changes; what is more is added."""
_FOUND_THE_SAME = wp.constant(-1)
"""Of a path that was traced again: its cells are as they were."""
_OFF = wp.constant(3.0e-5)
"""How far before its place a path begins, as a part of the largest coordinate."""


@wp.struct
class Met:
    """Where a path of a pixel met the first surface that is no mirror; ``toward`` is in the instance's space."""

    instance: int
    triangle: int
    weights: wp.vec2
    front: bool
    toward: wp.vec3


@wp.struct
class StoredPath:
    """A path that is traced again.

    Attributes:
        met: where it begins.
        pixel, number: of the path whose random numbers it has.
        rows: of its cells, −1 for none.
        light: irradiance over π that it finds, as far as is known, in units of `Asked.unit`.
        found: the same when it was traced last, …
        age: … and how many frames ago that was.
        rate: by how much that changes in a frame.
        base: what it would find if light had not changed; before it is traced, 1 over the factor by which it has.
        limit: brightness up to which it counts, unless others of its cell find as much.
        places: of its trail.
    """

    met: Met
    pixel: int
    number: int
    rows: wp.vec4i
    light: wp.vec3
    found: wp.vec3
    age: int
    rate: wp.vec3
    base: wp.vec3
    limit: float
    places: int


@wp.func
def _unevenness(cell: Cell) -> float:
    """Return how many times as many paths know a cell's light as well as where they differ by as much as they find."""
    bright = (cell.light[0] + cell.light[1] + cell.light[2]) / 3.0
    variance = cell.error * cell.error * cell.count
    return wp.clamp(variance / wp.max(bright * bright, 1.0e-20), 1.0, _MOST_UNEVEN)


def choose_paths(
    spent: wp.array2d[int],
    positions: wp.array2d[wp.vec4],
    normals: wp.array2d[wp.vec4],
    traced: wp.array[int],
    met: wp.array2d[Met],
    rows: wp.array3d[int],
    most: int,
    limited: bool,
    asked: Asked,
    cells: wp.array[Cell],
    followed: wp.array[Followed],
    sums: wp.array2d[wp.int64],
    paths: wp.array[StoredPath],
    out_count: wp.array[int],
) -> None:
    """Store paths of the last frame, chosen by chance, so that their cells hold some ``most``; a thread is a pixel.

    There are more where paths find light that differs more. If ``limited``, they have limits (`path_limits.py`).

    ``traced`` tells how many paths each pixel has traced, those of that frame included.
    """
    pixel = wp.tid()
    count = spent[_PATHS, pixel]
    for i in range(count):
        if positions[i, pixel][3] > 0.0 and met[i, pixel].instance >= 0:
            level = int(_STORED_AT)
            if rows[i, level, pixel] < 0:
                level = int(_LEVELS - 1)
            row = rows[i, level, pixel]
            if row >= 0:
                number = traced[pixel] - count + i
                wanted = float(most) * _unevenness(cells[row]) - float(sums[row, _COUNT])
                there = cells[row].count - cells[row].count_before
                chance = sampling.uniform_of(sampling.absorb(wp.uint64(pixel), number), 0)
                cached = CachedLight()
                cached.factor = wp.vec3(1.0, 1.0, 1.0)
                if asked.follows and chance * there < wanted:
                    cached = look_up_at(cells, followed, asked, positions[i, pixel], normals[i, pixel])
                if chance * there < wanted and tells_before(cached):
                    slot = wp.atomic_add(out_count, 0, 1)
                    if slot >= paths.shape[0]:
                        # They are counted, so that there is room when this is asked again.
                        continue
                    path = StoredPath()
                    path.met = met[i, pixel]
                    path.pixel = pixel
                    path.number = number
                    # By the factor alone: what was added to light would only round it.
                    cached.more = wp.vec3()
                    path.base = before_change(cached, wp.vec3(1.0, 1.0, 1.0))
                    path.rows = wp.vec4i(rows[i, 0, pixel], rows[i, 1, pixel], rows[i, 2, pixel], rows[i, 3, pixel])
                    path.limit = NO_LIMIT
                    if limited and rows[i, _LEVELS - 1, pixel] >= 0:
                        path.limit = limit_of(cells[rows[i, _LEVELS - 1, pixel]])
                    paths[slot] = path


@wp.func
def _advanced(path: StoredPath, found: wp.vec3, traced_again: bool, steady: bool) -> StoredPath:
    """Return a path after another frame: as it was found, or by the rate at which it changed before."""
    after = path
    if traced_again:
        after.rate = wp.vec3()
        if steady and path.age < _LONGEST_AGE:
            after.rate = (found - path.found) / float(path.age + 1)
        after.light = found
        after.found = found
        after.age = 0
    else:
        after.age = path.age + 1
        for c in range(3):
            after.light[c] = wp.max(path.light[c] + path.rate[c], 0.0)
    return after


@wp.func
def _add_path(
    path: StoredPath, before: wp.vec3, joining: bool, sums: wp.array2d[wp.int64], followed: wp.array[Followed]
) -> None:
    """Add what a path finds to its cells, where it is not ``joining`` instead of what it found ``before``."""
    for k in range(_LEVELS):
        row = path.rows[k]
        if row >= 0:
            for c in range(3):
                change = whole(path.light[c])
                if not joining:
                    change = change - whole(before[c])
                add_shared(sums, row, c, change)
                if joining:
                    add_shared(sums, row, _BASE + c, whole(path.base[c]))
            now = wp.min(bright_of(path.light), path.limit)
            base = wp.min(bright_of(path.base), path.limit)
            add_beyond(sums, row, _BEYOND, beyond_limit(path.light, path.limit), wp.int64(1))
            squares = whole(now * now)
            products = whole(now * base)
            if joining:
                add_beyond(sums, row, _BEYOND_BEFORE, beyond_limit(path.base, path.limit), wp.int64(1))
                add_shared(sums, row, _SQUARES + 2, whole(base * base))
                add_shared(sums, row, _COUNT, wp.int64(1))
            else:
                bright = wp.min(bright_of(before), path.limit)
                add_beyond(sums, row, _BEYOND, beyond_limit(before, path.limit), wp.int64(-1))
                squares = squares - whole(bright * bright)
                products = products - whole(bright * base)
            add_shared(sums, row, _SQUARES, squares)
            add_shared(sums, row, _SQUARES + 1, products)
            followed[row].last = followed[row].factor


def add_paths(
    first: int,
    joining: bool,
    steady: bool,
    unit: float,
    paths: wp.array[StoredPath],
    found: wp.array[wp.vec3],
    traced_again: wp.array[int],
    sums: wp.array2d[wp.int64],
    followed: wp.array[Followed],
) -> None:
    """Add what paths found to their cells: all of it if they are ``joining``, else by how much it has changed.

    A thread is a path, from ``first`` on. Where lamps move and each frame follows a part of the paths, changes are
    ``steady``: paths that were not traced again change as they did before. Cells hold light in units of ``unit``.
    """
    i = first + wp.tid()
    if traced_again[i] > 0 or steady:
        path = _advanced(paths[i], found[i] / unit, traced_again[i] > 0, steady and not joining)
        if joining:
            path.base = wp.cw_mul(path.base, path.light)
        if joining or steady or not path.light == paths[i].light:  # noqa: SIM201 - Warp has no != of vectors
            _add_path(path, paths[i].light, joining, sums, followed)
        else:
            traced_again[i] = _FOUND_THE_SAME
        path.places = paths[i].places
        paths[i] = path


@wp.func
def _told(cell: Followed, sums: wp.array2d[wp.int64], row: int) -> Followed:
    """Return a cell as its stored paths tell."""
    after = cell
    after.count = float(sums[row, _COUNT])
    light = counted_of(sums, row, 0, _BEYOND, left_out_of(sums, row, after.count, 0, _BEYOND))
    left_out = left_out_of(sums, row, after.count, _BASE, _BEYOND_BEFORE)
    base = counted_of(sums, row, _BASE, _BEYOND_BEFORE, left_out)
    # The error of a ratio is that of what it leaves: the sum of (now − ratio · before)² over the same paths, here up to
    # their limits. What counts beyond has the same part of it.
    now = bright_of(counted_of(sums, row, 0, _BEYOND, 1.0))
    before = bright_of(counted_of(sums, row, _BASE, _BEYOND_BEFORE, 1.0))
    after.error = 0.0
    if before > 0.0:
        ratio = now / before
        left = float(sums[row, _SQUARES]) - 2.0 * ratio * float(sums[row, _SQUARES + 1])
        left = wp.max(left + ratio * ratio * float(sums[row, _SQUARES + 2]), 0.0)
        after.error = wp.min(wp.sqrt(left * UNIT) / before, 1.0)
        if ratio > 0.0:
            after.error *= (bright_of(light) / bright_of(base)) / ratio
    for c in range(3):
        after.factor[c] = 1.0
        if base[c] > 0.0:
            after.factor[c] = wp.min(light[c] / base[c], _MOST)
        after.more[c] = wp.max(light[c] - after.factor[c] * base[c], 0.0) / (UNIT * after.count)
    return after


def average_paths(
    first: int,
    joining: bool,
    steady: bool,
    frame: int,
    paths: wp.array[StoredPath],
    traced_again: wp.array[int],
    sums: wp.array2d[wp.int64],
    followed: wp.array[Followed],
) -> None:
    """Tell the cells of paths whose light may have changed what these find on average; all write the same.

    Changes are those of the step to a ``frame``, whose number is at least 1.
    """
    i = first + wp.tid()
    if traced_again[i] > 0 or steady:
        for k in range(_LEVELS):
            row = paths[i].rows[k]
            # Many paths of a cell are traced again at once: the first one of them tells it.
            if row >= 0 and (joining or followed[row].stepped != frame):
                cell = _told(followed[row], sums, row)
                if not joining:
                    cell.step = cell.factor - cell.last
                    cell.stepped = frame
                followed[row] = cell


def move_rows(paths: wp.array[StoredPath], rows: wp.array[int]) -> None:
    """Let paths know where their cells are now; a thread is a path."""
    i = wp.tid()
    for k in range(_LEVELS):
        row = paths[i].rows[k]
        if row >= 0:
            paths[i].rows[k] = rows[row]


def move_followed(
    rows: wp.array[int],
    source_sums: wp.array2d[wp.int64],
    source: wp.array[Followed],
    sums: wp.array2d[wp.int64],
    followed: wp.array[Followed],
) -> None:
    """Copy what is known of cells to where these are now; a thread is a row of ``source``."""
    row = wp.tid()
    to = rows[row]
    if to >= 0:
        followed[to] = source[row]
        for field in range(wp.static(FOLLOWED_SUMS)):
            sums[to, field] = source_sums[row, field]


class Storing(NamedTuple):
    """The kernels above."""

    choose_paths: Any
    add_paths: Any
    average_paths: Any
    move_rows: Any
    move_followed: Any


@one_at_a_time
def build_storing() -> Storing:
    """Return the kernels that store paths, which are the same for all scenes."""
    each = choose_paths, add_paths, average_paths, move_rows, move_followed
    return Storing(*map(wp.kernel(enable_backward=False), each))


def make_replay(features: Any, surface: Any, trace: Any, options: Any) -> Any:
    """Return the kernel that traces paths again; a thread is ``count`` paths.

    ``moved`` tells what has moved (``trails.py``), ``of_moved`` of each instance whether it has. Of all paths one in
    ``every`` is traced whatever it meets, none where that is 0; which ones goes by ``turn``. ``out_found`` is what each
    finds, where ``out_traced`` is 1.
    """
    uniform2 = make_sampler(features.sobol)
    to_world_at, _, _ = make_placement(features)

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def replay(
        scene: Scene,
        settings: Settings,
        first: int,
        count: int,
        every: int,
        turn: int,
        moved: Moved,
        of_moved: wp.array[int],
        paths: wp.array[StoredPath],
        out_found: wp.array[wp.vec3],
        out_traced: wp.array[int],
    ) -> None:
        begin = first + wp.tid() * count
        for i in range(begin, begin + count):
            path = paths[i]
            again = of_moved[path.met.instance] > 0
            if every > 0:
                # Not by its row: on a GPU, rows are taken in no order.
                again = again or (path.pixel + path.number + turn) % every == 0
            if not again:
                again = trail_crosses(scene.geometry.trails, i, path.places, moved)
            out_traced[i] = wp.where(again, 1, 0)
            if again:
                state = sampling.absorb(settings.stream, path.pixel)
                stream = sampling.Stream()
                if wp.static(features.sobol):
                    stream.scrambling = sampling.stream_key(sampling.absorb(state, -2))
                    stream.reversed_index = reverse_bits(wp.uint32(path.number))
                stream.key = sampling.stream_key(sampling.absorb(state, OWN + path.number))
                stream.row = i
                time = float(0.0)
                if wp.static(features.camera_blur or features.motion_blur):
                    time = settings.opens + settings.lasts * uniform2(stream, sampling.TIME)[0]
                met = path.met
                point = surface(scene.geometry, met.instance, met.triangle, met.weights[0], met.weights[1], time)
                toward = met.toward
                if wp.static(features.two_level and not features.motion_blur):
                    to_world = to_world_at(scene.geometry, met.instance, time)
                    toward = wp.normalize(transform_vector(to_world, met.toward))
                normal = wp.where(met.front, point.normal, -point.normal)
                facing = wp.dot(toward, normal)
                if facing > 0.0:
                    # What deforms may have turned away: it is seen from the same side.
                    toward = toward - 2.0 * facing * normal
                back = _OFF * (1.0 + point.reach_m) / wp.max(wp.abs(facing), 0.05)
                start = point.position - toward * back
                sample = trace(scene, start, toward, time, settings, stream, wp.vec2(), True)
                light = wp.vec3()
                if sample.hit and sampling.finite(sample.radiance) and sampling.finite(sample.normal):
                    light = wp.cw_div(sample.radiance - sample.emission, lit_albedo(sample))
                out_found[i] = light
                paths[i].places = sample.places

    return replay
