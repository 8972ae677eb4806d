"""Host side of environment.py: the tables by which directions to an environment map are drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.device.arrays import array
from clsim.render.emitters.environment import SIDE, STEPS, EnvironmentImage
from clsim.scene import EnvironmentMap

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
_ROWS_AT_ONCE = 8 * SIDE


@dataclass(frozen=True)
class EnvironmentTables:
    """A map ready for the device.

    Attributes:
        radiance: float32 ``[h, w, 3]``, the constant environment included.
        rows: cumulative probabilities of the rows of blocks, float32 ``[ceil((h + 1) / SIDE)]``.
        columns: those of the columns of each row, float32 ``[…, ceil(w / SIDE)]``.
        shares: weights of the cells of each block, uint8 ``[…, …, SIDE, SIDE]``; 0 where it is black and beyond the
            image.
        unit: the probability of a weight of 1 in each block, float32 ``[…, …]``.
        mean: luminance averaged over the sphere.
    """

    radiance: F32
    rows: F32
    columns: F32
    shares: npt.NDArray[np.uint8]
    unit: F32
    mean: float


def upload_environment(tables: EnvironmentTables, to_world: F64, device: Any) -> Any:
    """Return the ``EnvironmentImage`` on a device."""
    image = EnvironmentImage()
    image.radiance = array(tables.radiance, wp.vec3, device)
    image.rows = array(tables.rows, wp.float32, device)
    image.columns = array(tables.columns.ravel(), wp.float32, device)
    image.row_guide = array(guide(tables.rows), wp.uint16, device)
    image.column_guide = array(guide(tables.columns).ravel(), wp.uint16, device)
    image.shares = array(tables.shares.ravel().view("<u8"), wp.uint64, device)
    image.unit = array(tables.unit.ravel(), wp.float32, device)
    image.to_world = wp.mat33(*np.asarray(to_world, np.float64).ravel())
    return image


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
    shares = np.empty((down, across, SIDE, SIDE), np.uint8)
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
        weights[at] = blocks.sum(axis=(2, 3))
        most = blocks.max(axis=(2, 3), keepdims=True)
        # Rounded up, so that none is drawn much too seldom: weights stay bounded.
        parts = np.divide(blocks, most, out=np.zeros_like(blocks), where=most > 0)
        shares[at] = np.ceil(255 * parts)
    columns = steps(np.cumsum(weights, axis=1))
    rows_of_blocks = steps(np.cumsum(weights.sum(axis=1)))
    drawn = _probabilities(rows_of_blocks)[:, None] * _probabilities(columns)
    whole = shares.sum(axis=(2, 3))
    unit = np.divide(drawn, whole, out=np.zeros_like(drawn), where=whole > 0).astype(np.float32)
    return EnvironmentTables(radiance, rows_of_blocks, columns, shares, unit, float(weights.sum() / (4 * width * 2)))


def guide(cumulative: F32) -> npt.NDArray[np.uint16]:
    """Return, for each of as many equal parts of 0 to 1, the entry with which the search for a number there begins.

    There is a power of two of parts: a number times their count is exact, so that no guess is too far. Tables are along
    the last axis.
    """
    *tables, entries = cumulative.shape
    count = 1 << (entries - 1).bit_length()
    parts = np.arange(count) / count + 1 / STEPS
    guesses = np.empty((*tables, count), np.uint16)
    for table in np.ndindex(*tables):
        # In a table of zeros all is beyond the last entry, and never searched.
        guesses[table] = np.minimum(np.searchsorted(cumulative[table], parts), min(entries - 1, 0xFFFF))
    return guesses


def _probabilities(cumulative: F32) -> F64:
    """Return those of the entries of tables along the last axis."""
    return np.diff(cumulative.astype(np.float64), prepend=0, axis=-1)


def steps(cumulative: F64) -> F32:
    """Return running sums along the last axis as probabilities, multiples of 1 / STEPS; sums of 0 stay 0."""
    total = cumulative[..., -1:]
    share = cumulative * np.divide(STEPS, total, out=np.zeros_like(total), where=total > 0)
    # Whole numbers up to 2²⁴ are exact in float32, and so is their division by it.
    multiples: F32 = np.rint(share, out=share).astype(np.float32) * np.float32(1 / STEPS)
    return multiples
