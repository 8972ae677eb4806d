"""MuJoCo's materials, textures and lights as ours.

MuJoCo's colours are those of a screen, and its lights add ``diffuse`` times a surface's colour wherever they reach.
Here colours are decoded from sRGB, and lights get the power with which a white surface that faces them, at the model's
middle, is as bright as ``diffuse``: they fall off with distance, as real ones do.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.scene.builder import WorldBuilder
from clsim.scene.motion import Static
from clsim.scene.pictures.images import decode_srgb
from clsim.scene.world import ImageTexture, Material, Mesh, PunctualLight, Vec3

_DEFAULT = (0.5, 0.5, 0.5, 1.0)
"""The colour of a geom that has none of its own: then its material's holds."""
COLOR_ROLES = (1, 8)
"""Roles of a material's textures that give colours: RGB and RGBA."""


class Surfaces:
    """Materials of a model's geoms, each image once.

    Attributes:
        means: how many geoms have the mean colour of an image instead of the image.
    """

    def __init__(self, model: Any, builder: WorldBuilder) -> None:
        """Begin without images; textures go to ``builder``."""
        self._model, self._builder = model, builder
        self._images: dict[tuple[int, tuple[float, ...]], int] = {}
        self.means = 0

    def of(self, geom: int, mesh: Mesh) -> Material | None:
        """Return the material of a geom of that mesh; None where it is invisible.

        Images are shown where the mesh has texture coordinates; elsewhere the image's mean colour stands in.
        """
        model = self._model
        index = int(model.geom_matid[geom])
        rgba = model.geom_rgba[geom].tolist()
        if index >= 0 and tuple(rgba) == _DEFAULT:
            rgba = model.mat_rgba[index].tolist()
        # As in MuJoCo's own picture, no colour reflects more light than there is.
        rgba = np.clip(rgba, 0.0, 1.0).tolist()
        if rgba[3] <= 0:
            return None
        color = decode_srgb(rgba[:3])
        material = Material()
        if rgba[3] < 1:
            material = replace(material, alpha_mode="blend", opacity=rgba[3])
        if index < 0:
            return replace(material, color=_vec3(color))
        if model.mat_metallic[index] >= 0 or model.mat_roughness[index] >= 0:
            roughness = float(model.mat_roughness[index])
            metallic = max(float(model.mat_metallic[index]), 0.0)
            alpha = roughness**2 if roughness >= 0 else 1.0
            material = replace(material, kind="principled", metallic=metallic, alpha=alpha)
        texture = texture_of(model, geom)
        image = -1
        if texture >= 0 and (mesh.uvs is None or (is_cube(model, texture) and not _is_box(model, geom))):
            self.means += 1
            color = color * decode_srgb(self._pixels(texture) / 255.0).mean(axis=(0, 1))
        elif texture >= 0:
            image = self._image(texture, self._repeat(geom, index))
        material = replace(material, color=_vec3(color), texture=image)
        if model.mat_emission[index] > 0:
            material = replace(material, emission=_vec3(model.mat_emission[index] * color), emission_texture=image)
        return material

    def _repeat(self, geom: int, material: int) -> tuple[float, float, float, float]:
        """Return factors and offsets of u and v: a plane has metres from its middle, a side of a box parts of it."""
        import mujoco

        model = self._model
        u, v = model.mat_texrepeat[material].tolist()
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            return u, v, 0.0, 0.0
        x, y = model.geom_size[geom][:2].tolist()
        if model.mat_texuniform[material]:  # a repeat is two metres then, as MuJoCo draws it
            u, v = (repeat * side if side > 0 else repeat for repeat, side in ((u, x), (v, y)))
        if _is_box(model, geom):
            return (1.0, 1.0, 0.0, 0.0) if is_cube(model, texture_of(model, geom)) else (u, v, 0.0, 0.0)
        if min(x, y) <= 0:  # endless
            return u / (2 * x if x > 0 else 2), v / (2 * y if y > 0 else 2), 0.5, 0.5
        return u / (2 * x), v / (2 * y), 0.5 * u, 0.5 * v

    def _image(self, texture: int, repeat: tuple[float, float, float, float]) -> int:
        key = (texture, repeat)
        if key not in self._images:
            u, v, du, dv = repeat
            rgb = self._pixels(texture)
            alpha = np.full((*rgb.shape[:2], 1), 255, np.uint8)
            pixels = np.concatenate([rgb, alpha], axis=2)
            self._images[key] = self._builder.add_texture(ImageTexture(pixels, uv_matrix=((u, 0.0, du), (0.0, v, dv))))
        return self._images[key]

    def _pixels(self, texture: int) -> npt.NDArray[np.uint8]:
        model = self._model
        height, width, channels = (
            int(values[texture]) for values in (model.tex_height, model.tex_width, model.tex_nchannel)
        )
        first = int(model.tex_adr[texture])
        pixels = model.tex_data[first : first + height * width * channels].reshape(height, width, channels)
        return np.ascontiguousarray(pixels[..., :3] if channels >= 3 else np.repeat(pixels[..., :1], 3, axis=2))


def texture_of(model: Any, geom: int) -> int:
    """Return the number of the texture that gives a geom its colours; negative for none."""
    material = int(model.geom_matid[geom])
    return int(model.mat_texid[material, COLOR_ROLES].max()) if material >= 0 else -1


def is_cube(model: Any, texture: int) -> bool:
    """Tell whether a texture is that of a cube, six pictures below each other, or one for all sides."""
    import mujoco

    return texture >= 0 and bool(model.tex_type[texture] == mujoco.mjtTexture.mjTEXTURE_CUBE)


def _is_box(model: Any, geom: int) -> bool:
    import mujoco

    return bool(model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX)


def sky(model: Any) -> Vec3:
    """Return the radiance of a constant sky that is as bright as all ambient light of the model."""
    ambient = model.light_ambient[model.light_active.astype(bool)].sum(axis=0)
    if model.vis.headlight.active:
        ambient = ambient + model.vis.headlight.ambient
    return _vec3(ambient)


def light(model: Any, index: int, position: Any) -> PunctualLight:
    """Return a light that stands at ``position`` [m] at the start."""
    import mujoco

    diffuse = np.asarray(model.light_diffuse[index], np.float64)
    if model.light_type[index] == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL:
        return PunctualLight("directional", _vec3(math.pi * diffuse), Static(np.eye(4)))
    away2 = float(np.sum(np.square(np.asarray(position) - model.stat.center)))
    intensity = _vec3(math.pi * max(away2, 1e-6) * diffuse)
    if model.light_type[index] == mujoco.mjtLightType.mjLIGHT_SPOT and model.light_cutoff[index] < 90:
        outer = float(model.light_cutoff[index])
        return PunctualLight("spot", intensity, Static(np.eye(4)), 0.5 * outer, outer, "smooth")
    return PunctualLight("point", intensity, Static(np.eye(4)))


def headlight(model: Any) -> PunctualLight:
    """Return the light that goes with the camera."""
    return PunctualLight("directional", _vec3(math.pi * model.vis.headlight.diffuse), Static(np.eye(4)))


def _vec3(values: Any) -> Vec3:
    return float(values[0]), float(values[1]), float(values[2])
