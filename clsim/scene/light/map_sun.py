"""The sun in a picture of the sky, which becomes a lamp of its own.

A picture of a bright day holds the sun in a few pixels, and with it most of the light. As a sphere far away it casts
shadows whose edges are as sharp as they should be, and its direct light needs no luck to be found. What is seen of it
is a disk as wide as its pixels, with the same light.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene.defaults.framing import bounds
from clsim.scene.light.daylight import far_sphere
from clsim.scene.world import F32, Vec3, World

_WITHIN_DEG = 3.0
"""Angle from its middle within which a picture's sun lies; the ring around, as wide, tells the sky there."""
_STEPS = 4
"""Steps from the brightest place to the middle; each leads to the mean of the light around."""
_BRIGHTER = 4.0
"""How many times as bright as that ring its pixels are at least."""
_LEAST_SHARE = 0.1
"""Of a picture's light that is the sun's; shadows of less are faint."""
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
_F64 = npt.NDArray[np.float64]


def part_sun(world: World) -> World:
    """Return a world whose picture of the sky has no sun, but a sphere light instead; the same world if it has none.

    Skies that turn, or whose light changes, stay as they are.
    """
    above = world.environment_map
    if above is None or above.turn_deg_per_s != 0.0 or world.environment_modulation is not None:
        return world
    found = _find_sun(above.radiance)
    if found is None:
        return world
    try:
        middle_m, size_m = bounds(Path(world.name), world.meshes, world.instances)
    except InputError:  # there is nothing that it could light
        return world
    direction, radius_rad, radiance, rest = found
    to_sun = np.asarray(above.to_world, np.float64) @ direction
    sun = far_sphere(to_sun, radius_rad, radiance, middle_m, float(np.linalg.norm(size_m)) / 2)
    return replace(world, environment_map=replace(above, radiance=rest), sphere_lights=(*world.sphere_lights, sun))


def _find_sun(radiance: F32) -> tuple[_F64, float, Vec3, F32] | None:
    """Return the sun's direction in the picture's frame, its angular radius, its radiance, and the picture without it.

    Args:
        radiance: float32 ``[h, w, 3]``, as in `EnvironmentMap`.
    """
    height, width, _ = radiance.shape
    light = radiance @ _LUMINANCE.astype(np.float32)
    edges = np.cos(np.linspace(0.0, np.pi, height + 1))
    of_pixel = 2.0 * np.pi / width * (edges[:-1] - edges[1:])  # solid angle [sr], by row
    row, column = np.unravel_index(int(np.argmax(light)), light.shape)
    reach = math.ceil(3.0 * _WITHIN_DEG / 180.0 * height) + 1
    rows = np.arange(max(int(row) - reach, 0), min(int(row) + reach + 1, height))
    towards = _directions(rows, np.arange(width), height, width)
    middle = _directions(np.array([row]), np.array([column]), height, width)[0, 0]
    weights = np.broadcast_to(of_pixel[rows, None], towards.shape[:2])
    off_deg = _off_deg(towards, middle)
    for _ in range(_STEPS):  # many a picture is white all over its sun, and the first such place lies at the rim
        within = off_deg <= _WITHIN_DEG
        middle = (light[rows] * weights)[within] @ towards[within]
        off_deg = _off_deg(towards, middle / max(float(np.linalg.norm(middle)), 1e-300))
    near = radiance[rows].astype(np.float64)
    ring = (off_deg > _WITHIN_DEG) & (off_deg <= 2.0 * _WITHIN_DEG)
    if not ring.any():
        return None
    around = np.average(near[ring], axis=0, weights=weights[ring])
    bright = (off_deg <= _WITHIN_DEG) & (light[rows] > _BRIGHTER * float(around @ _LUMINANCE))
    more = (near[bright] - around) * weights[bright, None]
    total = float((light * of_pixel[:, None].astype(np.float32)).sum(dtype=np.float64))
    share = more @ _LUMINANCE
    if not bright.any() or share.sum() < _LEAST_SHARE * total:
        return None
    direction = share @ towards[bright]
    direction /= np.linalg.norm(direction)
    off = np.arccos(np.clip(towards[bright] @ direction, -1.0, 1.0))
    # A disk's mean square distance from its middle is half of its radius squared, and a square pixel's a sixth of its
    # side's.
    square = share @ off**2 + share @ weights[bright] / 6.0
    radius_rad = math.sqrt(2.0 * float(square) / float(share.sum()))
    r, g, b = np.maximum(more.sum(0), 0.0) / (2.0 * np.pi * (1.0 - math.cos(radius_rad)))
    rest = radiance.copy()
    part = rest[rows]
    part[bright] = around
    rest[rows] = part
    return direction, radius_rad, (float(r), float(g), float(b)), rest


def _off_deg(towards: _F64, middle: _F64) -> _F64:
    """Return the angles between unit directions."""
    return np.degrees(np.arccos(np.clip(towards @ middle, -1.0, 1.0)))


def _directions(rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64], height: int, width: int) -> _F64:
    """Return unit directions ``[rows, columns, 3]`` to the middles of pixels, in the picture's frame."""
    polar = np.pi * (rows + 0.5) / height
    turn = 2.0 * np.pi * (columns + 0.5) / width
    flat = np.sin(polar)[:, None]
    up = np.broadcast_to(np.cos(polar)[:, None], (rows.size, columns.size))
    return np.stack((flat * np.sin(turn), up, -flat * np.cos(turn)), -1)
