"""Host side of light_tree.py: what bounds each light, and the tree over them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.device.arrays import array, table, write
from clsim.render.emitters.light_tree import LightGroup, LightTree

_F64 = npt.NDArray[np.float64]
_I64 = npt.NDArray[np.int64]
_Rows = npt.NDArray[Any]

BOUNDS = np.dtype(
    [("low", "f8", 3), ("high", "f8", 3), ("intensity", "f8"), ("axis", "f8", 3), ("facing", "f8"), ("reach", "f8"),
     ("both", "?")]
)  # fmt: skip
"""What becomes a node of a `LightGroup`: the box around the lights, and its other fields."""
_SLACK = 1e-6
"""Cosines are rounded to 32 bits on the device, and bounds must hold there too."""
_BRIGHTEST = 1e36
"""A light is drawn as if it were no brighter, so that sums of such numbers are finite in 32 bits."""


def around(low: _F64, high: _F64, intensity: _F64) -> _Rows:
    """Return the bounds of lights that shine all around: boxes ``[n, 3]`` [m] and intensities ``[n]`` [W·sr⁻¹]."""
    bounds: _Rows = np.zeros(len(intensity), BOUNDS)
    bounds["low"], bounds["high"], bounds["intensity"] = low, high, intensity
    bounds["axis"], bounds["facing"], bounds["reach"] = (0.0, 0.0, 1.0), -1.0, -1.0
    return bounds


def of_triangles(corners: _F64, radiance: _F64, both: npt.NDArray[np.bool_]) -> _Rows:
    """Return the bounds of triangles ``[n, 3, 3]`` [m] with luminances ``[n]``; ``both``: from both sides."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    bounds = around(corners.min(axis=1), corners.max(axis=1), 0.5 * length * radiance)
    bounds["axis"] = cross / np.maximum(length, 1e-300)[:, None]
    bounds["facing"], bounds["reach"], bounds["both"] = 1.0, 0.0, both
    return bounds


def of_spot(position: _F64, axis: _F64, outer_deg: float, intensity: float) -> _Rows:
    """Return the bounds of a spot, of half angle ``outer_deg``."""
    bounds = around(position[None], position[None], np.array([intensity]))
    bounds["axis"], bounds["facing"], bounds["reach"] = axis, 1.0, math.cos(math.radians(outer_deg))
    return bounds


class TreeOfLights:
    """A tree over lights, which keeps its form where these move.

    Attributes:
        tree: the ``LightTree`` that kernels take.
    """

    def __init__(self, bounds: _Rows, lights: _I64, count: int, probability: float, device: Any) -> None:
        """Arrange lights with those bounds.

        Args:
            bounds: of each, `BOUNDS`.
            lights: their numbers.
            count: of all lights, whether or not in the tree.
            probability: with which the tree is asked for a light.
            device: Warp's device.
        """
        self.tree = tree = LightTree()
        self._bounds = bounds.copy()
        if not len(lights):  # all are dark or far: the tree is never asked for one, but for whether it has one
            tree.slots = array(np.full(count, -1), wp.int32, device)
            return
        self._order = _arrange(0.5 * (bounds["low"] + bounds["high"]))
        here = self._order >= 0
        slots = np.full(count, -1)
        slots[lights[self._order[here]]] = np.flatnonzero(here)
        tree.nodes = array(_groups(self._bounds, self._order), LightGroup, device)
        tree.lights = array(np.where(here, lights[self._order], -1), wp.int32, device)
        tree.slots = array(slots, wp.int32, device)
        tree.leaves = len(self._order)
        tree.parts = (8, 2, 4)[(tree.leaves.bit_length() - 1) % 3]
        tree.probability = probability

    def refit(self, rows: _I64, bounds: _Rows) -> None:
        """Give some of the lights, by their places in the bounds, other bounds, in the kernels' array too."""
        self._bounds[rows] = bounds
        write(self.tree.nodes, _groups(self._bounds, self._order))


def _groups(bounds: _Rows, order: _I64) -> _Rows:
    """Return the nodes, as a `LightGroup` for eight of them, over lights with those bounds in that order."""
    here = order >= 0
    rows: list[_Rows] = [np.zeros(len(order), BOUNDS)]
    rows[0]["low"], rows[0]["high"] = np.inf, -np.inf
    rows[0][here] = bounds[order[here]]
    while len(rows[-1]) > 1:
        rows.append(_join(rows[-1][0::2], rows[-1][1::2]))
    unused: _Rows = np.zeros(max(8 - 2 * len(order), 0), BOUNDS)
    merged: _Rows = np.concatenate([np.zeros(1, BOUNDS), *rows[::-1], unused]).reshape(-1, 8)
    groups: _Rows = table(LightGroup, len(merged))
    some = merged["intensity"] > 0
    low, high = (np.where(some[..., None], merged[name], 0.0) for name in ("low", "high"))
    half = 0.5 * (high - low)
    groups["middle"] = (low + half).swapaxes(1, 2)
    groups["axis"] = merged["axis"].swapaxes(1, 2)
    groups["radius_m"] = np.linalg.norm(half, axis=2) * (1 + _SLACK)
    groups["facing"], groups["reach"] = merged["facing"] - _SLACK, merged["reach"] - _SLACK
    groups["facing_sine"] = np.sqrt(np.maximum(1.0 - merged["facing"] ** 2, 0.0))
    groups["intensity"], groups["both"] = np.minimum(merged["intensity"], _BRIGHTEST), merged["both"]
    return groups


def _arrange(places: _F64) -> _I64:
    """Return which light stands where in the last row, −1 for none: halves of a group are split along its widest axis.

    All groups of a row are split at once; each half gets half of the lights, so that all ways down are as long.
    """
    count = len(places)
    size = 1 << max(0, (count - 1).bit_length())
    order = np.full(size, -1)
    order[:count] = np.arange(count)
    while size > 1:
        groups = order.reshape(-1, size)
        here = groups >= 0
        own = places[groups]
        low = np.where(here[..., None], own, np.inf).min(axis=1)
        high = np.where(here[..., None], own, -np.inf).max(axis=1)
        axis = np.argmax(high - low, axis=1)
        along = np.where(here, np.take_along_axis(own, axis[:, None, None], axis=2)[..., 0], np.inf)
        groups = np.take_along_axis(groups, np.argsort(along, axis=1, kind="stable"), axis=1)
        rank, number = np.arange(size)[None, :], here.sum(axis=1)[:, None]
        first = (number + 1) // 2
        slot = np.where(rank < first, rank, size // 2 + rank - first)
        order = np.full(groups.shape, -1)
        row, column = np.nonzero(rank < number)
        order[row, slot[row, column]] = groups[row, column]
        order = order.ravel()
        size //= 2
    return order


def _join(a: _Rows, b: _Rows) -> _Rows:
    """Return the bounds of pairs of nodes."""
    joined: _Rows = np.zeros(len(a), BOUNDS)
    joined["low"], joined["high"] = np.minimum(a["low"], b["low"]), np.maximum(a["high"], b["high"])
    joined["intensity"] = a["intensity"] + b["intensity"]
    joined["reach"] = np.minimum(a["reach"], b["reach"])
    joined["both"] = a["both"] | b["both"]
    joined["axis"], joined["facing"] = _cone(a, b)
    for one, other in ((a, b), (b, a)):
        alone = other["intensity"] == 0
        joined[alone] = one[alone]
    return joined


def _cone(a: _Rows, b: _Rows) -> tuple[_F64, _F64]:
    """Return axes and cosines of the narrowest cones about those of pairs."""
    angle_a, angle_b = (np.arccos(np.clip(each["facing"], -1, 1)) for each in (a, b))
    cosine = np.clip(np.sum(a["axis"] * b["axis"], axis=1), -1, 1)
    between = np.arccos(cosine)
    half = 0.5 * (angle_a + between + angle_b)
    turn = half - angle_a
    across = b["axis"] - cosine[:, None] * a["axis"]
    length = np.linalg.norm(across, axis=1)
    across = across / np.maximum(length, 1e-300)[:, None]
    axis = a["axis"] * np.cos(turn)[:, None] + across * np.sin(turn)[:, None]
    facing = np.where((half >= math.pi) | (length < 1e-9) & (cosine < 0), -1.0, np.cos(np.minimum(half, math.pi)))
    for one, own, other in ((a, angle_a, angle_b), (b, angle_b, angle_a)):
        inside = np.minimum(between + other, math.pi) <= own + 1e-12
        axis[inside], facing[inside] = one["axis"][inside], one["facing"][inside]
    return axis, facing
