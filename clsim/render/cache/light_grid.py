# ruff: noqa: UP018, RUF046
"""The hashed grid of the radiance cache: cells are cubes, and a table's rows hold them."""

import warp as wp

from clsim.render.device.compiler import kernel_options
from clsim.render.native import native_code
from clsim.render.sampling import sampling

wp.set_module_options(kernel_options())

_SHIFT = wp.constant(0.37)
"""By so many cells the grid is shifted, for walls and floors often lie at whole numbers, between two cells."""
PROBES = wp.constant(64)
BLOCK = 16
"""Cells side by side on a surface that have neighbouring rows."""
_BLOCK = wp.constant(BLOCK)


@wp.func
def size_of(width_m: float) -> int:
    """Return the logarithm to base 2 of the side of the finest cells where they may be so wide; so few sides occur."""
    return int(wp.floor(wp.log2(wp.max(width_m, 1.0e-9))))


@wp.func
def face_of(normal: wp.vec3) -> int:
    """Return which of six ways a surface faces."""
    axis = int(0)
    along = float(normal[0])
    for k in range(1, 3):
        if wp.abs(normal[k]) > wp.abs(along):
            axis = k
            along = normal[k]
    return 2 * axis + wp.where(along > 0.0, 1, 0)


@wp.func
def grid_of(size: int, face: int, layer: int) -> wp.uint64:
    """Return what tells the cells of this size, face and layer from others, for `key_of`."""
    return sampling.absorb(wp.uint64(face + 6 * layer), size)


@wp.func
def layer_of(in_coat: bool, with_lamps: bool, instance: int) -> int:
    """Return the number of the cells on that instance, −1 for the whole world.

    Those that coats reflect are others, and so are those that hold the lamps' light where most do not.
    """
    return wp.where(in_coat, 1, wp.where(with_lamps, 2, 0)) + 3 * (instance + 1)


@wp.func
def in_cells(position: wp.vec3, side_m: float) -> wp.vec3:
    """Return a position in units of a cell's side."""
    return position / side_m + wp.vec3(_SHIFT, _SHIFT, _SHIFT)


@wp.func
def key_of(grid: wp.uint64, axis: int, x: float, y: float, z: float) -> wp.int64:
    """Return the key of the cell with these whole coordinates, never 0, in the grid of a face across that axis.

    Its low bits tell where the cell lies in a block of 4×4 along the surface, the rest is the block's hash.
    """
    u = wp.int64(wp.where(axis == 0, y, x))
    v = wp.int64(wp.where(axis == 2, y, z))
    across = wp.int64(wp.where(axis == 0, x, wp.where(axis == 1, y, z)))
    mixed = wp.uint64(u >> wp.int64(2)) * wp.uint64(0x9E3779B97F4A7C15)
    mixed = mixed + wp.uint64(v >> wp.int64(2)) * wp.uint64(0xD1342543DE82EF95)
    mixed = mixed + wp.uint64(across) * wp.uint64(0x94D049BB133111EB)
    inside = ((u & wp.int64(3)) << wp.int64(2)) | (v & wp.int64(3))
    block = (sampling.mix64(grid + mixed) | wp.uint64(1)) << wp.uint64(4)
    return wp.int64(block) | inside


@wp.func
def along_face(axis: int, at: wp.vec3) -> wp.vec2:
    """Return the two coordinates along the surface of cells that lie across that axis."""
    return wp.vec2(wp.where(axis == 0, at[1], at[0]), wp.where(axis == 2, at[1], at[2]))


@wp.func
def first_row(key: wp.int64, mask: int) -> int:
    """Return the row in which to look first: those of a block lie together, for neighbours are looked up together."""
    return (int(wp.uint64(key) >> wp.uint64(20)) & mask & ~(_BLOCK - 1)) | int(key & wp.int64(_BLOCK - 1))


@wp.func_native(native_code("add_shared.h"))
def add_shared(sums: wp.array2d[wp.int64], row: int, field: int, value: wp.int64) -> None:
    """Add to a cell's sums, also where several threads of a CPU do."""
    ...


@wp.func
def find_or_make(keys: wp.array[wp.int64], key: wp.int64, out_used: wp.array[int]) -> int:
    """Return the row of a cell, a new one if need be; -1 where there is no room.

    ``out_used`` counts rows taken, and cells that found no room. On a CPU, one thread alone may do so: which cells find
    room hangs on who comes first.
    """
    mask = keys.shape[0] - 1
    row = first_row(key, mask)
    found = int(-1)
    for _ in range(PROBES):
        there = wp.atomic_cas(keys, row, wp.int64(0), key)
        if there == wp.int64(0):
            wp.atomic_add(out_used, 0, 1)
        if there == wp.int64(0) or there == key:
            found = row
            break
        row = (row + _BLOCK) & mask
    if found < 0:
        wp.atomic_add(out_used, 1, 1)
    return found
