"""From a world's materials and textures to the arrays that the kernels read."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.device.arrays import array
from clsim.render.features.bsdf_kinds import NUMBERS
from clsim.render.features.scene_features import has_roughness, passes_light, used_textures
from clsim.render.surfaces.materials import BLEND, MASK, OPAQUE, MaterialRow, Materials
from clsim.render.surfaces.plastic_tables import coat, coats
from clsim.render.surfaces.reflection_table import reflections
from clsim.render.textures.texture_data import CLAMP, MIRROR, REPEAT, TextureRow, Textures, mat23
from clsim.scene import CheckerTexture, Material, World

_WRAPS = {"repeat": REPEAT, "clamp": CLAMP, "mirror": MIRROR}
_ALPHA_MODES = {"opaque": OPAQUE, "mask": MASK, "blend": BLEND}


def upload_materials(world: World, device: Any) -> Any:
    """Return the ``Materials`` of a world on a device."""
    materials = Materials()
    tables: list[npt.NDArray[np.float64]] = []
    rows = [_row(material, tables) for material in world.materials] or [MaterialRow()]
    materials.rows = _structs(rows, MaterialRow, device)
    materials.transmittance = array(np.concatenate(tables) if tables else [], wp.float32, device)
    coated = any(material.kind in ("plastic", "principled") for material in world.materials)
    materials.reflections = array(reflections().ravel() if coated else [], wp.float32, device)
    materials.textures = _textures(world, device)
    return materials


def _row(material: Material, tables: list[npt.NDArray[np.float64]]) -> Any:
    row = MaterialRow()
    row.kind = NUMBERS[material.kind]
    row.color = wp.vec3(*material.color)
    row.emission = wp.vec3(*material.emission)
    row.specular = wp.vec3(*material.specular_color)
    row.complex_index = int(material.eta is not None)
    row.eta = wp.vec3(*(material.eta or (1.0, 1.0, 1.0)))
    row.k = wp.vec3(*(material.k or (0.0, 0.0, 0.0)))
    for name in ("alpha", "ior", "metallic", "transmission", "clearcoat", "clearcoat_alpha", "alpha_cutoff"):
        setattr(row, name, getattr(material, name))
    for name in ("specular_tint", "sheen", "sheen_tint", "flatness", "stretch"):
        setattr(row, name, getattr(material, name))
    row.beckmann = int(material.distribution == "beckmann")
    row.absorption = wp.vec3(*material.absorption)
    row.blend_behind = int(material.blend_behind)
    row.nonlinear = int(material.nonlinear)
    if material.kind == "plastic":
        row.table = sum(map(len, tables))
        if material.roughness_texture >= 0:
            passing, inner = coats(material.alpha, material.ior, material.distribution)
            tables += [passing.ravel(), inner]
        else:
            table, row.inner = coat(material.alpha, material.ior, material.distribution)
            tables.append(table)
    row.emits_behind = int(material.emits_behind)
    # Light that crosses a surface must be able to come back.
    row.dark_back = int(material.back == "black" and not passes_light(material))
    row.culled = int(material.back == "culled")
    row.alpha_mode = _ALPHA_MODES[material.alpha_mode]
    row.opacity = material.opacity
    for name in ("normal_scale", "bump_scale", "bump_texture", "blend_with", "blend_share", "blend_texture"):
        setattr(row, name, getattr(material, name))
    row.texture = material.texture
    row.emission_texture = material.emission_texture
    row.roughness_texture = material.roughness_texture if has_roughness(material) else -1
    row.normal_texture = material.normal_texture
    row.opacity_texture = material.opacity_texture
    return row


def _textures(world: World, device: Any) -> Any:
    """Pack the images that are used, each once; the table keeps the world's numbers."""
    used = set(used_textures(world))
    rows, images = [], []
    firsts: dict[int, int] = {}
    size = 0
    for index, texture in enumerate(world.textures):
        row = TextureRow()
        row.first = -1
        if isinstance(texture, CheckerTexture):
            row.color_a, row.color_b = wp.vec3(*texture.color_a), wp.vec3(*texture.color_b)
            row.scale = texture.scale
        elif index in used:
            if id(texture.pixels) not in firsts:
                firsts[id(texture.pixels)] = size
                images.append(np.ascontiguousarray(texture.pixels).view("<u4").ravel())
                size += len(images[-1])
            row.first = firsts[id(texture.pixels)]
            row.height, row.width = texture.pixels.shape[:2]
            row.wrap_u, row.wrap_v = _WRAPS[texture.wrap_u], _WRAPS[texture.wrap_v]
            row.nearest = int(texture.nearest)
            row.decoding = 256 * int(texture.srgb)
            row.uv_matrix = mat23(*np.ravel(texture.uv_matrix))
        rows.append(row)
    textures = Textures()
    textures.rows = _structs(rows or [TextureRow()], TextureRow, device)
    textures.texels = array(np.concatenate(images) if images else [], wp.uint32, device)
    textures.coarse = array([], wp.uint32, device)
    textures.decoding = array(decoding(), wp.float32, device)
    return textures


def decoding() -> npt.NDArray[np.float64]:
    """Return what a byte means as a plain number [256], then as sRGB (IEC 61966-2-1) [256]."""
    plain = np.arange(256) / 255.0
    curved = np.where(plain <= 0.04045, plain / 12.92, ((plain + 0.055) / 1.055) ** 2.4)
    return np.concatenate([plain, curved])


def _structs(rows: list[Any], dtype: Any, device: Any) -> Any:
    return wp.array(rows, dtype=dtype, device=device)
