"""Mitsuba's textures, and colours that may be given by one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.scene.meshes.geometry import flipped_v
from clsim.scene.mitsuba.values import Color, file_of, shown
from clsim.scene.mitsuba.xml import Plugin
from clsim.scene.motion import Matrix
from clsim.scene.pictures.images import (
    U8,
    PixelBudget,
    decode_srgb,
    encode_srgb8,
    is_linear,
    read_light,
    read_texture,
    roughness_pixels,
)
from clsim.scene.world import F32, CheckerTexture, ImageTexture, Texture, Vec3, Wrap

WRAPS: dict[str, Wrap] = {"repeat": "repeat", "clamp": "clamp", "mirror": "mirror", "black": "clamp", "zero": "clamp"}
WHITE: Vec3 = (1.0, 1.0, 1.0)
LUMINANCE = (0.2126, 0.7152, 0.0722)


class TextureReader:
    """Reads each texture and each image once.

    Attributes:
        textures: what was read so far.
    """

    def __init__(self, legacy: bool, folder: Any, warn: Callable[[str], None]) -> None:
        """Read images from a scene's folder; ``legacy`` is a version before 2; ``warn`` takes what is lost."""
        self._legacy = legacy
        self.textures: list[Texture] = []
        self._folder, self._warn = folder, warn
        self._indices: dict[tuple[object, ...], int] = {}
        self._pixels: dict[tuple[object, bool], U8] = {}
        self._lights: dict[object, tuple[U8, float]] = {}
        self._budget = PixelBudget()

    def color(
        self, plugin: Plugin, name: str, default: float, *, plain: bool = False, number: bool = False
    ) -> tuple[Vec3, int]:
        """Return a colour parameter, and its texture or -1; ``plain`` has no room for one, and takes its mean.

        ``number`` as in `index`.
        """
        texture = plugin.child(name)
        if texture is not None:
            if plain:
                self._warn(f"the mean of a texture stands in where it gives {name}")
                return self.mean(self.index(texture)), -1
            return WHITE, self.index(texture, number=number)
        value = plugin.values.get(name, default)
        if isinstance(value, float):
            return (value, value, value), -1
        if not isinstance(value, Color):
            raise InputError(f"{plugin.place}: {plugin.type}.{name} is {shown(value)}, expected a colour")
        return value.rgb, -1

    def light(self, plugin: Plugin) -> tuple[Vec3, int]:
        """Return what a texture of light is to be multiplied by, for textures end at 1, and its index."""
        most = 1.0
        if plugin.type == "checkerboard":
            colors = [
                self.color(plugin, name, value, plain=True)[0] for name, value in (("color0", 0.4), ("color1", 0.2))
            ]
            most = max(1.0, *colors[0], *colors[1])
        elif plugin.type == "bitmap":
            path = file_of(plugin.place, plugin.get("filename", ""), self._folder)
            if is_linear(path):
                if path not in self._lights:
                    self._lights[path] = read_light(path, self._budget)
                most = self._lights[path][1]
        return (most, most, most), self.index(plugin, most=most)

    def mean(self, index: int) -> Vec3:
        """Return the mean colour of a texture."""
        texture = self.textures[index]
        if isinstance(texture, CheckerTexture):
            return vec3((np.array(texture.color_a) + np.array(texture.color_b)) / 2)
        return vec3(_linear(texture).mean(axis=(0, 1)))

    def roughness(self, index: int, *, perceptual: bool = False) -> int:
        """Return the texture for `Material.roughness_texture` of one whose luminance is α, or its root."""
        texture = self.textures[index]
        if isinstance(texture, CheckerTexture):  # which is grey, and stands for one that is left out
            alpha = np.full((1, 1), luminance(texture.color_a))
            wrap = ImageTexture(roughness_pixels(alpha), srgb=False)
        else:
            alpha, wrap = _linear(texture) @ LUMINANCE, texture
        pixels = roughness_pixels(alpha**2 if perceptual else alpha)
        return self._add(("roughness", index, perceptual), lambda: replace(wrap, pixels=pixels, srgb=False))

    def index(
        self,
        plugin: Plugin,
        *,
        raw: bool = False,
        as_opacity: bool = False,
        number: bool = False,
        most: float = 1.0,
    ) -> int:
        """Return the index of a texture: of colours, of ``raw`` numbers, or with its luminance as alpha.

        ``number`` says that its luminance alone is asked for, as opacity's always is; ``most`` is what becomes 1.
        """
        matrix = flipped_v(self._to_uv(plugin))
        if plugin.type == "checkerboard":
            return self._checkerboard(plugin, matrix, most, as_opacity=as_opacity, number=number or as_opacity)
        if plugin.type != "bitmap":
            plugin.pass_over()
            nested = plugin.of_kind("texture")
            if nested:
                self._warn(f"the texture {plugin.type} is left out; the one inside it stands in")
                return self.index(nested[0], raw=raw, as_opacity=as_opacity, number=number)
            self._warn(f"the texture {plugin.type} is left out; grey stands in")
            return self._add(("grey",), lambda: CheckerTexture((0.5, 0.5, 0.5), (0.5, 0.5, 0.5)))
        path = file_of(plugin.place, plugin.get("filename", ""), self._folder)
        told = plugin.get("raw", False), plugin.get("gamma", 0.0) == 1.0
        linear = raw or any(told)
        wrap = plugin.get("wrap_mode", "repeat")
        wraps = [plugin.get(name, wrap).lower() for name in ("wrap_mode_u", "wrap_mode_v")]
        if any(name not in WRAPS for name in wraps):
            raise InputError(f"{plugin.place}: wrap_mode is {wrap!r}, expected one of {', '.join(WRAPS)}")
        nearest = plugin.get("filter_type", "bilinear").lower() == "nearest"
        linear = linear and most == 1.0
        key = (path, linear, as_opacity, *wraps, nearest, matrix, most)
        return self._add(
            key,
            lambda: ImageTexture(
                self._image(path, most, linear=linear, as_opacity=as_opacity),
                srgb=not linear,
                wrap_u=WRAPS[wraps[0]],
                wrap_v=WRAPS[wraps[1]],
                nearest=nearest,
                uv_matrix=matrix,
            ),
        )

    def _add(self, key: tuple[object, ...], make: Callable[[], Texture]) -> int:
        if key not in self._indices:
            texture = make()
            self._indices[key] = len(self.textures)
            self.textures.append(texture)
        return self._indices[key]

    def _image(self, path: Any, most: float, *, linear: bool, as_opacity: bool) -> U8:
        """Return an image, read once; as opacity, its luminance stands in the alpha channel."""
        if most != 1.0:
            return self._lights[path][0]
        if (path, linear) not in self._pixels:
            self._pixels[path, linear] = read_texture(path, self._budget, srgb=not linear)
        pixels = self._pixels[path, linear]
        if not as_opacity:
            return pixels
        table = np.arange(256) / 255.0 if linear else decode_srgb(np.arange(256) / 255.0)
        luminance = table[pixels[..., :3]] @ LUMINANCE
        masked: U8 = pixels.copy()
        masked[..., 3] = np.clip(luminance * 255.0 + 0.5, 0, 255).astype(np.uint8)
        return masked

    def _to_uv(self, plugin: Plugin) -> Matrix:
        matrix = plugin.get("to_uv", np.eye(4))[:, :]
        affine = np.eye(3)
        affine[:2, :2], affine[:2, 2] = matrix[:2, :2], matrix[:2, 3]
        if any(name in plugin.values for name in ("uscale", "vscale", "uoffset", "voffset", "uvscale")):
            both = plugin.get("uvscale", 1.0)
            scale = np.diag((plugin.get("uscale", both), plugin.get("vscale", both), 1.0))
            scale[:2, 2] = plugin.get("uoffset", 0.0), plugin.get("voffset", 0.0)
            affine = affine @ scale
        return affine

    def _squares(self, plugin: Plugin) -> list[Vec3]:
        """Return the colours of a checkerboard."""
        return [self.color(plugin, name, value, plain=True)[0] for name, value in (("color0", 0.4), ("color1", 0.2))]

    def _checkerboard(
        self, plugin: Plugin, matrix: tuple[Vec3, Vec3], most: float, *, as_opacity: bool, number: bool
    ) -> int:
        """Return a checkerboard as an image of four texels, which takes any transform; a texture inside is grey."""
        colors = self._squares(plugin)
        if number and not self._legacy:
            # In Mitsuba 3, numbers of a checkerboard (``eval_1``) stand in the squares of the other colour (``eval``).
            colors.reverse()
        encoded = [encode_srgb8(np.divide(color, most)) for color in colors]
        alphas = [round(255 * min(luminance(color), 1.0)) if as_opacity else 255 for color in colors]
        first, second = ((*color.tolist(), alpha) for color, alpha in zip(encoded, alphas, strict=True))
        pixels = np.array([[first, second], [second, first]], np.uint8)
        key = ("checkerboard", first, second, matrix)
        return self._add(key, lambda: ImageTexture(pixels, nearest=True, uv_matrix=matrix))


def _linear(texture: ImageTexture) -> F32:
    """Return the colours of an image [h, w, 3], 0 … 1."""
    plain = np.arange(256) / 255.0
    table = np.asarray(decode_srgb(plain) if texture.srgb else plain, np.float32)
    return np.asarray(table[texture.pixels[..., :3]])


def luminance(color: Vec3) -> float:
    """Return the luminance of a colour."""
    return float(np.dot(color, LUMINANCE))


def vec3(values: Any) -> Vec3:
    """Return three numbers as a colour."""
    return float(values[0]), float(values[1]), float(values[2])
