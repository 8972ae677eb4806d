"""How brightly textured surfaces emit, triangle by triangle, so that a screen's bright parts are drawn more often."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.render.emitters.environment_build import LUMINANCE
from clsim.render.surfaces.upload_materials import decoding
from clsim.scene import CheckerTexture, ImageTexture, Mesh, World
from clsim.scene.world import Wrap

_F64 = npt.NDArray[np.float64]

_PARTS = 11
"""Parts of a triangle's side: it is cut into as many squared, and sampled in the middle of each. Odd, for what
repeats on a texture often does so by powers of 2."""
_LEAST = 0.02
"""Share of the untextured light that counts at least: between these places there may be a bright spot."""


def mean_emission(world: World, mesh: Mesh) -> _F64:
    """Return the luminance that the front of each triangle emits on average, ``[m]``; 0 where it does not emit."""
    emission = np.array([material.emission for material in world.materials]).reshape(-1, 3)
    if not len(emission):
        return np.zeros(len(mesh.triangles))
    luminance: _F64 = (emission @ LUMINANCE)[mesh.material_ids]
    for index, material in enumerate(world.materials):
        if material.emission_texture < 0 or mesh.uvs is None or max(material.emission) == 0:
            continue
        if getattr(world.textures[material.emission_texture], "film", None) is not None:
            continue  # any place may be bright at some time
        triangles = np.flatnonzero(mesh.material_ids == index)
        if len(triangles):
            colors = _mean(world.textures[material.emission_texture], mesh.uvs[mesh.triangles[triangles]])
            textured = colors * np.array(material.emission) @ LUMINANCE
            luminance[triangles] = np.maximum(textured, _LEAST * luminance[triangles])
    return luminance


def _mean(texture: CheckerTexture | ImageTexture, corners: npt.NDArray[np.float32]) -> _F64:
    """Return the mean colours of triangles of those uv ``[m, 3, 2]``, from places spread over each."""
    i, j = np.indices((_PARTS, _PARTS)).reshape(2, -1)
    places = np.concatenate([np.stack([i, j]) + 1 / 3, np.stack([i, j]) + 2 / 3], axis=1) / _PARTS
    places = places[:, places.sum(axis=0) < 1]
    total = np.zeros((len(corners), 3))
    for a, b in places.T:
        total += _colors(texture, corners[:, 0] * (1 - a - b) + corners[:, 1] * a + corners[:, 2] * b)
    mean: _F64 = total / places.shape[1]
    return mean


def _colors(texture: CheckerTexture | ImageTexture, uv: _F64) -> _F64:
    """Return the colours at uv ``[m, 2]``, of an image those of the nearest texels."""
    if isinstance(texture, CheckerTexture):
        squares = np.floor(_finite(uv, np.eye(2) * texture.scale, np.zeros(2))).sum(axis=1) % 2
        return np.where(squares[:, None] == 0, texture.color_a, texture.color_b)
    height, width = texture.pixels.shape[:2]
    matrix = np.array(texture.uv_matrix)
    s, t = _finite(uv, matrix[:, :2], matrix[:, 2]).T
    x = np.minimum(_fold(s, texture.wrap_u) * width, width - 1).astype(int)
    y = np.minimum((1.0 - _fold(t, texture.wrap_v)) * height, height - 1).astype(int)
    colors: _F64 = decoding().reshape(2, 256)[int(texture.srgb), texture.pixels[y, x, :3]]
    return colors


def _finite(uv: _F64, matrix: _F64, offset: _F64) -> _F64:
    """Return places on a texture; what is too far away for a number is at 0."""
    with np.errstate(over="ignore", invalid="ignore"):
        places: _F64 = np.nan_to_num(uv @ matrix.T + offset, nan=0.0, posinf=0.0, neginf=0.0)
    return places


def _fold(x: _F64, wrap: Wrap) -> _F64:
    """Return the place in 0 … 1 that a coordinate stands for, as `textures.fold` does."""
    if wrap == "repeat":
        return x - np.floor(x)
    if wrap == "mirror":
        return 1.0 - np.abs(np.mod(x, 2.0) - 1.0)
    return np.clip(x, 0.0, 1.0)
