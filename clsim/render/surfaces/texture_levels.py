"""Coarser levels of image textures: what the mean over a pixel reads where a pixel shows many texels.

Reading hundreds of texels from all over a large image, each comes from far away in memory. A level of half as many rows
and columns has their means (Williams, Pyramidal Parametrics, SIGGRAPH 1983).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.device.arrays import array
from clsim.render.surfaces.upload_materials import decoding
from clsim.render.textures.texture_data import TextureRow
from clsim.scene import ImageTexture, World

_STEPS = 1 << 16
"""Steps of linear light by which its byte is looked up: a tenth of the smallest between two bytes of sRGB."""
_STRIP = 64
"""Rows that are averaged at a time; even."""


def add_levels(world: World, textures: Any) -> None:
    """Give the images of colours among a world's ``Textures`` coarser levels, but for those that change with time."""
    rows = textures.rows.numpy()
    device = textures.rows.device
    levels: list[npt.NDArray[np.uint32]] = []
    begins: dict[tuple[int, bool], tuple[int, int]] = {}
    size = 0
    # No mean is taken of the others.
    colours = {material.texture for material in world.materials}
    for number, (row, texture) in enumerate(zip(rows, world.textures, strict=False)):
        if number not in colours or row["first"] < 0 or not isinstance(texture, ImageTexture):
            continue
        if texture.film or texture.nearest:
            continue
        key = id(texture.pixels), texture.srgb
        if key not in begins:
            new = coarser(texture.pixels, texture.srgb)
            begins[key] = size, len(new)
            levels += new
            size += sum(map(len, new))
        row["coarse"], row["levels"] = begins[key]
    textures.coarse = array(np.concatenate(levels) if levels else [], wp.uint32, device)
    textures.rows.assign(wp.array(rows, dtype=TextureRow, device=device))


def coarser(pixels: npt.NDArray[np.uint8], srgb: bool) -> list[npt.NDArray[np.uint32]]:
    """Return the levels of an image, uint8 ``[h, w, 4]``, as texels in raster order, down to one row or column.

    Means are of linear light, alpha is 1.
    """
    table = decoding()[256:] if srgb else decoding()[:256]
    between = 0.5 * (table[1:] + table[:-1])
    encoding = np.searchsorted(between, (np.arange(_STEPS) + 0.5) / _STEPS).astype(np.uint8)
    single = table.astype(np.float32)
    levels: list[npt.NDArray[np.uint32]] = []
    if min(pixels.shape[:2]) < 2:
        return levels
    # Strips stay in the processor's caches, where pairs of rows are whole.
    height = len(pixels)
    strip = height if height % 2 else _STRIP
    linear = np.concatenate([_quartered(single[pixels[i : i + strip, :, :3]]) for i in range(0, height, strip)])
    while True:
        texels = np.full((*linear.shape[:2], 4), 255, np.uint8)
        texels[..., :3] = encoding[np.minimum((linear * _STEPS).astype(np.int32), _STEPS - 1)]
        levels.append(texels.view("<u4").ravel())
        if min(linear.shape[:2]) < 2:
            return levels
        linear = _quartered(linear)


def _quartered(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return means over half as many rows and columns, rounded down."""
    return _halved(_halved(values, 0), 1)


def _halved(values: npt.NDArray[np.float32], axis: int) -> npt.NDArray[np.float32]:
    """Return means over half as many rows, or columns, rounded down; each covers as much as any other."""
    count = values.shape[axis]
    half = count // 2
    each: Any = np.moveaxis(values, axis, 0)
    if count % 2 == 0:
        means = 0.5 * (each[0::2] + each[1::2])
    else:
        # Each covers two and a bit: of three, the outer two in part (NVIDIA, Non-Power-of-Two Mipmap Creation, 2005).
        i = np.arange(half, dtype=np.float32).reshape(-1, *[1] * (values.ndim - 1))
        means = ((half - i) * each[0:-1:2] + half * each[1::2] + (i + 1) * each[2::2]) / np.float32(count)
    return np.moveaxis(means, 0, axis)
