# ruff: noqa: RUF046, UP018
"""Environment maps: their radiance and how directions to them are drawn.

The image is interpolated bilinearly between the centres of its texels, around the vertical without a seam. The cells
between centres, one row more than the image has, are drawn by their mean luminance times their solid angle: within a
cell radiance exceeds its mean four times at most, so that weights are bounded. Blocks of 8×8 cells are drawn by
inverting the cumulative distribution of rows and then that of the row's columns (Pharr, Jakob, Humphreys, Physically
Based Rendering, 4th ed., §12.5), and then a cell by its share of the block. What is read for a draw is small, for it
comes from far away in memory: shares are bytes, rounded up, so that a block's are one line of the processor's cache;
and where to begin in a cumulative distribution is guessed by a table, as good as the search and shorter.
"""

from typing import Literal

import warp as wp

from clsim.render.native import native_code
from clsim.render.sampling.sampling import angle_of, around

STEPS = 1 << 24
"""Cumulative tables hold multiples of 1 / STEPS, as random numbers do, so that probabilities are exact."""
STEP = wp.constant(1.0 / STEPS)
SIDE = wp.constant(8)
"""Cells along the side of a block; a row of them is a word of bytes."""
_Parts = wp.types.vector(length=8, dtype=wp.int32)
_EVERY_OTHER_BYTE = wp.constant(wp.uint64(0x00FF00FF00FF00FF))
_SUM_OF_PAIRS = wp.constant(wp.uint64(0x0001000100010001))


@wp.struct
class EnvironmentImage:
    """Radiance by row and column, and how directions are drawn, as ``environment_build`` has it."""

    radiance: wp.array[wp.vec3, Literal[2]]
    rows: wp.array[float]
    columns: wp.array[float]
    row_guide: wp.array[wp.uint16]
    column_guide: wp.array[wp.uint16]
    shares: wp.array[wp.uint64]
    unit: wp.array[float]
    to_world: wp.mat33


@wp.struct
class EnvironmentSample:
    """What comes from a direction, and the density per steradian with which that direction is drawn."""

    direction: wp.vec3
    radiance: wp.vec3
    pdf: float


@wp.func
def _radiance(image: EnvironmentImage, u: float, v: float) -> wp.vec3:
    height = image.radiance.shape[0]
    width = image.radiance.shape[1]
    x = u * float(width) - 0.5
    y = v * float(height) - 0.5
    right = x - wp.floor(x)
    down = y - wp.floor(y)
    x0 = (wp.int32(wp.floor(x)) + width) % width
    x1 = (x0 + 1) % width
    y0 = wp.clamp(wp.int32(wp.floor(y)), 0, height - 1)
    y1 = wp.clamp(wp.int32(wp.floor(y)) + 1, 0, height - 1)
    top = image.radiance[y0, x0] * (1.0 - right) + image.radiance[y0, x1] * right
    bottom = image.radiance[y1, x0] * (1.0 - right) + image.radiance[y1, x1] * right
    return top * (1.0 - down) + bottom * down


@wp.func
def _find(
    cumulative: wp.array[float], first: int, guide: wp.array[wp.uint16], guesses: int, count: int, u: float
) -> int:
    """Return the entry of ``u`` in the table that starts at ``first``, whose ``count`` guesses start at ``guesses``."""
    index = first + int(guide[guesses + int(u * float(count))])
    # A step up, so that the first entry above ``u`` is found.
    while cumulative[index] < u + STEP:
        index += 1
    return index


@wp.func
def _inside(cumulative: wp.array[float], first: int, index: int, u: float) -> float:
    """Return where in its entry ``u`` lies, 0 to 1; half a step up, so that it is right in the mean."""
    before = float(0.0)
    if index > first:
        before = cumulative[index - 1]
    return (u - before + 0.5 * STEP) / (cumulative[index] - before)


@wp.func
def _byte(word: wp.uint64, k: int) -> int:
    return int((word >> wp.uint64(8 * k)) & wp.uint64(255))


@wp.func
def _sum_of_bytes(word: wp.uint64) -> int:
    pairs = (word & _EVERY_OTHER_BYTE) + ((word >> wp.uint64(8)) & _EVERY_OTHER_BYTE)
    return int((pairs * _SUM_OF_PAIRS) >> wp.uint64(48))


@wp.func
def _density(image: EnvironmentImage, row: int, column: int, sin_theta: float) -> float:
    """Return the density per steradian in a cell; its rows are cut in half at the poles."""
    height = image.radiance.shape[0]
    width = image.radiance.shape[1]
    block = (row // SIDE) * ((width + SIDE - 1) // SIDE) + column // SIDE
    cells = float(width * height)
    if row == 0 or row == height:
        cells = 2.0 * cells
    probability = image.unit[block] * float(_byte(image.shares[block * SIDE + row % SIDE], column % SIDE))
    return probability * cells / (2.0 * wp.pi * wp.pi * wp.max(sin_theta, 1.0e-7))


@wp.func
def environment_towards(image: EnvironmentImage, direction: wp.vec3) -> EnvironmentSample:
    """Return what comes from a unit direction."""
    local = wp.transpose(image.to_world) * direction
    sin_theta = wp.sqrt(local[0] * local[0] + local[2] * local[2])
    u = angle_of(wp.abs(local[0]), -local[2]) / (2.0 * wp.pi)
    u = wp.where(local[0] < 0.0, 1.0 - u, u)
    v = angle_of(sin_theta, local[1]) / wp.pi
    height = image.radiance.shape[0]
    width = image.radiance.shape[1]
    column = (wp.int32(wp.floor(u * float(width) - 0.5)) + width) % width
    row = wp.clamp(wp.int32(wp.floor(v * float(height) + 0.5)), 0, height)
    return EnvironmentSample(direction, _radiance(image, u, v), _density(image, row, column, sin_theta))  # type: ignore[call-arg]


@wp.func
def _within(parts: _Parts, left: float) -> wp.vec2:
    """Return which of eight is drawn by ``left``, 0 to 1, and where in it that lies."""
    whole = int(0)
    for k in range(SIDE):
        whole += parts[k]
    place = left * float(whole)
    # Without branches: one division, of what was found last.
    drawn = int(0)
    first = int(0)
    part = int(0)
    before = int(0)
    for k in range(SIDE):
        found = parts[k] > 0 and place >= float(before)
        drawn = wp.where(found, k, drawn)
        first = wp.where(found, before, first)
        part = wp.where(found, parts[k], part)
        before += parts[k]
    inside = wp.where(part > 0, wp.min((place - float(first)) / float(wp.max(part, 1)), 1.0), 0.5)
    return wp.vec2(float(drawn), inside)


@wp.func_native(native_code("prefetch.h"))
def _ask_for_columns(array: wp.array[float], index: int) -> None: ...


@wp.func_native(native_code("prefetch.h"))
def _ask_for_shares(array: wp.array[wp.uint64], index: int) -> None: ...


@wp.func
def foresee_environment(image: EnvironmentImage, random: wp.vec2) -> None:
    """Say that a direction will be drawn soon: what that reads comes from far away in memory.

    The block is the one that is guessed, which is right more often than not.
    """
    block_row = _find(image.rows, 0, image.row_guide, 0, image.row_guide.shape[0], random[1])
    guesses = image.column_guide.shape[0] // image.rows.shape[0]
    guess = int(image.column_guide[block_row * guesses + int(random[0] * float(guesses))])
    block = block_row * ((image.radiance.shape[1] + SIDE - 1) // SIDE) + guess
    _ask_for_columns(image.columns, block)
    _ask_for_shares(image.shares, block * SIDE)


@wp.func
def sample_environment(image: EnvironmentImage, random: wp.vec2) -> wp.vec3:
    """Draw a direction."""
    height = image.radiance.shape[0]
    width = image.radiance.shape[1]
    blocks = (width + SIDE - 1) // SIDE
    block_row = _find(image.rows, 0, image.row_guide, 0, image.row_guide.shape[0], random[1])
    first = block_row * blocks
    guesses = image.column_guide.shape[0] // image.rows.shape[0]
    block = _find(image.columns, first, image.column_guide, block_row * guesses, guesses, random[0])
    rows = _Parts()
    for k in range(SIDE):
        rows[k] = _sum_of_bytes(image.shares[block * SIDE + k])
    down = _within(rows, _inside(image.rows, 0, block_row, random[1]))
    word = image.shares[block * SIDE + int(down[0])]
    columns = _Parts()
    for k in range(SIDE):
        columns[k] = _byte(word, k)
    across = _within(columns, _inside(image.columns, first, block, random[0]))
    u = (float((block - first) * SIDE) + across[0] + across[1] + 0.5) / float(width)
    row = float(block_row * SIDE) + down[0]
    top = wp.max(row - 0.5, 0.0)
    bottom = wp.min(row + 0.5, float(height))
    v = (top + (bottom - top) * down[1]) / float(height)
    polar = around(0.5 * v)
    azimuth = around(u)
    # Its length is 1 to 1e-6 already.
    return image.to_world * wp.vec3(polar[1] * azimuth[1], polar[0], -polar[1] * azimuth[0])
