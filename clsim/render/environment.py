# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018
"""Environment maps: their radiance and how directions to them are drawn.

The image is interpolated bilinearly between the centres of its texels, around the vertical without a seam. The cells
between centres, one row more than the image has, are drawn by their mean luminance times their solid angle: within a
cell radiance exceeds its mean four times at most, so that weights are bounded. Blocks of 4×4 cells are drawn by
inverting the cumulative distribution of rows and then that of the row's columns (Pharr, Jakob, Humphreys, Physically
Based Rendering, 4th ed., §12.5), and then a cell by its share of the block. The tables of blocks stay in the
processor's cache where the image does not, and a block's shares are one line of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.scene import EnvironmentMap

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
STEPS = 1 << 24
"""Cumulative tables hold multiples of 1 / STEPS, as random numbers do, so that probabilities are exact."""
STEP = wp.constant(1.0 / STEPS)
SIDE = wp.constant(4)
"""Cells along the side of a block."""
_ROWS_AT_ONCE = 8 * SIDE


@wp.struct
class EnvironmentImage:
    """Radiance by row and column, and how directions are drawn, as `EnvironmentTables` has it."""

    radiance: wp.array2d(dtype=wp.vec3)
    rows: wp.array(dtype=float)
    columns: wp.array(dtype=float)
    shares: wp.array(dtype=float)
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
def _share(cumulative: wp.array(dtype=float), first: int, index: int) -> float:
    """Return the probability of an entry of the table that starts at ``first``."""
    before = float(0.0)
    if index > first:
        before = cumulative[index - 1]
    return cumulative[index] - before


@wp.func
def _inside(cumulative: wp.array(dtype=float), first: int, index: int, u: float) -> float:
    """Return where in its entry ``u`` lies, 0 to 1; half a step up, so that it is right in the mean."""
    before = float(0.0)
    if index > first:
        before = cumulative[index - 1]
    return (u - before + 0.5 * STEP) / (cumulative[index] - before)


@wp.func
def _density(image: EnvironmentImage, row: int, column: int, sin_theta: float) -> float:
    """Return the density per steradian in a cell; its rows are cut in half at the poles."""
    height = image.radiance.shape[0]
    width = image.radiance.shape[1]
    block_row = row // SIDE
    first = block_row * ((width + SIDE - 1) // SIDE)
    block = first + column // SIDE
    cells = float(width * height)
    if row == 0 or row == height:
        cells = 2.0 * cells
    probability = _share(image.rows, 0, block_row) * _share(image.columns, first, block)
    probability = probability * image.shares[(block * SIDE + row % SIDE) * SIDE + column % SIDE]
    return probability * cells / (2.0 * wp.pi * wp.pi * wp.max(sin_theta, 1.0e-7))


@wp.func
def environment_towards(image: EnvironmentImage, direction: wp.vec3) -> EnvironmentSample:
    """Return what comes from a unit direction."""
    local = wp.transpose(image.to_world) * direction
    sin_theta = wp.sqrt(local[0] * local[0] + local[2] * local[2])
    u = wp.atan2(local[0], -local[2]) / (2.0 * wp.pi)
    if u < 0.0:
        u = u + 1.0
    v = wp.atan2(sin_theta, local[1]) / wp.pi
    height = image.radiance.shape[0]
    width = image.radiance.shape[1]
    column = (wp.int32(wp.floor(u * float(width) - 0.5)) + width) % width
    row = wp.clamp(wp.int32(wp.floor(v * float(height) + 0.5)), 0, height)
    return EnvironmentSample(direction, _radiance(image, u, v), _density(image, row, column, sin_theta))


@wp.func
def _within(shares: wp.vec4, left: float) -> wp.vec2:
    """Return which of four is drawn by ``left``, 0 to 1, and where in it that lies."""
    whole = shares[0] + shares[1] + shares[2] + shares[3]
    drawn = wp.vec2(0.0, 0.5)
    before = float(0.0)
    for k in range(SIDE):
        if shares[k] > 0.0 and left * whole >= before:
            drawn = wp.vec2(float(k), wp.min((left * whole - before) / shares[k], 1.0))
        before = before + shares[k]
    return drawn


@wp.func
def sample_environment(image: EnvironmentImage, random: wp.vec2) -> wp.vec3:
    """Draw a direction."""
    height = image.radiance.shape[0]
    width = image.radiance.shape[1]
    blocks = (width + SIDE - 1) // SIDE
    block_row = wp.lower_bound(image.rows, random[1] + STEP)
    first = block_row * blocks
    block = wp.lower_bound(image.columns, first, first + blocks, random[0] + STEP)
    rows = wp.vec4()
    start = block * SIDE * SIDE
    for k in range(SIDE):
        at = start + k * SIDE
        rows[k] = image.shares[at] + image.shares[at + 1] + image.shares[at + 2] + image.shares[at + 3]
    down = _within(rows, _inside(image.rows, 0, block_row, random[1]))
    at = start + int(down[0]) * SIDE
    shares = wp.vec4(image.shares[at], image.shares[at + 1], image.shares[at + 2], image.shares[at + 3])
    across = _within(shares, _inside(image.columns, first, block, random[0]))
    u = (float((block - first) * SIDE) + across[0] + across[1] + 0.5) / float(width)
    row = float(block_row * SIDE) + down[0]
    top = wp.max(row - 0.5, 0.0)
    bottom = wp.min(row + 0.5, float(height))
    v = (top + (bottom - top) * down[1]) / float(height)
    sin_theta = wp.sin(wp.pi * v)
    phi = 2.0 * wp.pi * u
    return wp.normalize(image.to_world * wp.vec3(sin_theta * wp.sin(phi), wp.cos(wp.pi * v), -sin_theta * wp.cos(phi)))


@dataclass(frozen=True)
class EnvironmentTables:
    """A map ready for the device.

    Attributes:
        radiance: float32 ``[h, w, 3]``, the constant environment included.
        rows: cumulative probabilities of the rows of blocks, float32 ``[ceil((h + 1) / SIDE)]``.
        columns: those of the columns of each row, float32 ``[…, ceil(w / SIDE)]``.
        shares: of each block's probability, those of its cells, float32 ``[…, …, SIDE, SIDE]``; 0 beyond the image.
        mean: luminance averaged over the sphere.
    """

    radiance: F32
    rows: F32
    columns: F32
    shares: F32
    mean: float


def tabulate(environment: EnvironmentMap, constant: tuple[float, float, float]) -> EnvironmentTables:
    """Return the tables of a map on top of a constant radiance."""
    radiance = np.ascontiguousarray(environment.radiance, np.float32)
    if any(constant):
        radiance = radiance + np.asarray(constant, np.float32)
    height, width, _ = radiance.shape
    luminance = radiance @ LUMINANCE.astype(np.float32)
    down, across = -(-(height + 1) // SIDE), -(-width // SIDE)
    angles = np.concatenate([[0.0], np.arange(0.5, height), [float(height)]]) * (math.pi / height)
    # The difference of cosines as a product, which does not cancel at the poles.
    bands = 2 * np.sin((angles[1:] + angles[:-1]) / 2) * np.sin((angles[1:] - angles[:-1]) / 2)
    weights = np.empty((down, across))
    shares = np.empty((down, across, SIDE, SIDE), np.float32)
    for first in range(0, height + 1, _ROWS_AT_ONCE):  # so that what is worked on stays in the processor's cache
        rows = np.arange(first, min(first + _ROWS_AT_ONCE, height + 1))
        # Four times the mean of a cell's corners; the polar cells have the outermost texels on both sides.
        edges = luminance[np.maximum(rows - 1, 0)] + luminance[np.minimum(rows, height - 1)]
        cells = np.zeros((-(-len(rows) // SIDE) * SIDE, across * SIDE))
        inside = cells[: len(rows), :width]
        inside[:] = edges
        inside[:, :-1] += edges[:, 1:]
        inside[:, -1] += edges[:, 0]
        inside *= bands[rows, None]
        blocks = cells.reshape(-1, SIDE, across, SIDE).swapaxes(1, 2)
        at = slice(first // SIDE, first // SIDE + len(blocks))
        weights[at] = sums = blocks.sum(axis=(2, 3))
        shares[at] = np.divide(
            blocks, sums[..., None, None], out=np.zeros_like(blocks), where=sums[..., None, None] > 0
        )
    columns = steps(np.cumsum(weights, axis=1))
    rows_of_blocks = steps(np.cumsum(weights.sum(axis=1)))
    return EnvironmentTables(radiance, rows_of_blocks, columns, shares, float(weights.sum() / (4 * width * 2)))


def steps(cumulative: F64) -> F32:
    """Return running sums along the last axis as probabilities, multiples of 1 / STEPS; sums of 0 stay 0."""
    total = cumulative[..., -1:]
    share = cumulative * np.divide(STEPS, total, out=np.zeros_like(total), where=total > 0)
    # Whole numbers up to 2²⁴ are exact in float32, and so is their division by it.
    return np.rint(share, out=share).astype(np.float32) * np.float32(1 / STEPS)
