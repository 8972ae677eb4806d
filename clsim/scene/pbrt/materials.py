"""pbrt-v4's spectra, textures and materials."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.scene.light.spectra import (
    ILLUMINANTS,
    METALS,
    blackbody_rgb,
    chromaticity_rgb,
    rgb_of_light,
    rgb_of_reflectance,
)
from clsim.scene.mitsuba.blends import blended
from clsim.scene.pbrt.tokens import Parameters, file_of
from clsim.scene.pictures.images import F64, U8, PixelBudget, decode_srgb, encode_srgb8, read_texture, roughness_pixels
from clsim.scene.world import ImageTexture, Material, Texture, Vec3, Wrap

WRAPS: dict[str, Wrap] = {"repeat": "repeat", "clamp": "clamp", "black": "clamp", "octahedralsphere": "clamp"}
GLASSES = {
    "glass-BK7": 1.5168,
    "glass-BAF10": 1.67,
    "glass-FK51A": 1.4866,
    "glass-LASF9": 1.8503,
    "glass-F5": 1.6034,
    "glass-F10": 1.6235,
    "glass-F11": 1.6206,
    "glass-SF5": 1.6727,
    "glass-SF10": 1.7283,
    "glass-SF11": 1.7847,
}
"""Refractive indices at the yellow sodium line by the names of pbrt-v4."""
WHITE: Vec3 = (1.0, 1.0, 1.0)
LEAST_ALPHA = 0.001
KNOWN = ("mix", "diffuse", "coateddiffuse", "conductor", "coatedconductor", "dielectric", "thindielectric")
"""Materials that are read; of others a warning tells."""


@dataclass(frozen=True)
class NamedTexture:
    """A texture as written: a constant colour, or an index and a factor."""

    color: Vec3
    index: int = -1


class MaterialReader:
    """Reads materials and textures.

    Attributes:
        materials: what was read so far.
        textures: likewise.
        named: materials by their names in the file.
    """

    def __init__(self, folder: Path, warn: Callable[[str], None]) -> None:
        """Read files from a folder; ``warn`` takes what World cannot hold."""
        self.materials: list[Material] = []
        self.textures: list[Texture] = []
        self.named: dict[str, Material] = {}
        self._folder, self._warn = folder, warn
        self._named: dict[tuple[str, bool], NamedTexture] = {}
        self._indices: dict[Material, int] = {}
        self._images: dict[tuple[Path, bool], U8] = {}
        self._added: dict[tuple[object, ...], int] = {}
        self._budget = PixelBudget()

    def index(self, material: Material) -> int:
        """Return the index into ``materials``."""
        if material not in self._indices:
            self._indices[material] = len(self.materials)
            self.materials.append(material)
        return self._indices[material]

    def add_texture(self, name: str, kind: str, parameters: Parameters, *, number: bool) -> None:
        """Remember a named texture, of colours or of a ``number``: one name may be that of one of each."""
        key = name, number
        if kind == "constant":
            self._named[key] = NamedTexture(self.color(parameters, "value", 1.0))
        elif kind == "scale":
            inner = self.texture(parameters, "tex", 1.0, number=number)
            factor = self.texture(parameters, "scale", 1.0, number=True)
            if factor.index >= 0:
                if inner.index >= 0:
                    self._warn("a texture scaled by another keeps the first alone")
                    factor = NamedTexture(WHITE)
                inner, factor = (factor, inner) if inner.index < 0 else (inner, factor)
            a, b, c = (x * y for x, y in zip(inner.color, factor.color, strict=True))
            self._named[key] = NamedTexture((a, b, c), inner.index)
        elif kind == "imagemap":
            self._named[key] = self._imagemap(parameters, number)
        elif kind == "mix":
            self._named[key] = self._mixed(parameters, number)
        elif kind == "checkerboard":
            self._named[key] = NamedTexture(WHITE, self._checkerboard(parameters, number))
        else:
            self._warn(f"the texture {kind} is left out; grey stands in")
            self._named[key] = NamedTexture((0.5, 0.5, 0.5))
            return
        parameters.tell_unread(f"texture {kind}", self._warn)

    def texture(self, parameters: Parameters, name: str, default: float, *, number: bool = False) -> NamedTexture:
        """Return a parameter that may be a texture: of colours, or where there is none of them of a ``number``."""
        parameter = parameters.found.find(name)
        if parameter is None or parameter.type != "texture":
            return NamedTexture(self.color(parameters, name, default))
        wanted = parameters.word(name, "")
        found = self._named.get((wanted, number)) or self._named.get((wanted, not number))
        if found is None:
            raise InputError(f"{parameter.place}: there is no texture {wanted!r} before this")
        return found

    def color(self, parameters: Parameters, name: str, default: float, *, emits: bool = False) -> Vec3:
        """Return a colour parameter: rgb, a spectrum or a number; spectra of lights are taken as they are."""
        convert = _rgb_of_luminance_one if emits else rgb_of_reflectance
        parameter = parameters.found.find(name)
        if parameter is None:
            return default, default, default
        numbers = parameter.numbers.tolist()
        if parameter.type == "blackbody" and numbers:
            if not 100 <= numbers[0] <= 100_000:
                raise InputError(f"{parameter.place}: {name} is {numbers[0]:g} K, expected 100 to 100000")
            return blackbody_rgb(numbers[0])
        if parameter.words:
            return self._named_spectrum(parameter.place, parameter.words[0], convert)
        if parameter.type == "spectrum" and len(numbers) >= 2 and len(numbers) % 2 == 0:
            return convert(numbers[::2], numbers[1::2])
        if len(numbers) not in (1, 3):
            raise InputError(f"{parameter.place}: {name} has {len(numbers)} numbers, expected a colour")
        r, g, b = numbers if len(numbers) == 3 else numbers * 3
        return r, g, b

    def _named_spectrum(self, place: str, name: str, convert: Callable[[Any, Any], Vec3]) -> Vec3:
        parts = name.split("-")
        if len(parts) == 3 and parts[0] == "metal" and parts[1] in METALS and parts[2] in ("eta", "k"):
            return METALS[parts[1]][0 if parts[2] == "eta" else 1]
        if name in GLASSES:
            return (GLASSES[name],) * 3
        if name == "stdillum-D65":
            return WHITE
        if name in ILLUMINANTS:
            return chromaticity_rgb(*ILLUMINANTS[name])
        if name.endswith(".spd"):
            path = file_of(place, name, self._folder)
            try:
                table = np.loadtxt(path, comments="#", ndmin=2, dtype=np.float64)
            except ValueError as error:
                raise InputError(f"{path}: is no table of wavelengths and values ({error})") from None
            if table.shape[1] != 2 or not len(table) or not np.isfinite(table).all():
                raise InputError(f"{path}: is no table of wavelengths and values")
            return convert(table[:, 0], table[:, 1])
        self._warn(f"the spectrum {name} is not known; 1 stands in")
        return WHITE

    def _imagemap(self, parameters: Parameters, number: bool) -> NamedTexture:
        path = file_of(parameters.place, parameters.word("filename", ""), self._folder)
        wrapped = parameters.word("wrap", "repeat")
        if wrapped in ("black", "octahedralsphere"):
            self._warn(f"textures with wrap {wrapped} are clamped")
        wrap = WRAPS.get(wrapped, "repeat")
        encoding = parameters.word("encoding", "sRGB").split() or [""]
        linear = encoding[0] == "linear"
        if not linear and encoding[0].lower() != "srgb":
            self._warn(f"textures with encoding {' '.join(encoding)} are taken as sRGB")
        nearest = parameters.word("filter", "bilinear") == "point"
        factor = parameters.number("scale", 1.0)
        inverted = factor if parameters.flag("invert", False) else None
        matrix = self._mapping(parameters)
        key = (path, wrap, linear, nearest, inverted, matrix, number)
        if key not in self._added:
            pixels = self._image(path, srgb=not linear)
            if number and (pixels[..., 3] < 255).any():  # then pbrt takes the alpha, decoded as the colours are
                pixels = np.concatenate(
                    [np.repeat(pixels[..., 3:], 3, axis=2), np.full_like(pixels[..., 3:], 255)], axis=2
                )
            if inverted is not None:  # 1 less the light that it would be
                light = 1.0 - inverted * _light_of_codes(srgb=not linear)
                codes = np.clip(light * 255.0 + 0.5, 0, 255).astype(np.uint8) if linear else encode_srgb8(light)
                pixels = np.concatenate([codes[pixels[..., :3]], pixels[..., 3:]], axis=2)
            self._added[key] = self._append(
                ImageTexture(pixels, srgb=not linear, wrap_u=wrap, wrap_v=wrap, nearest=nearest, uv_matrix=matrix)
            )
        return NamedTexture(WHITE if inverted is not None else (factor,) * 3, self._added[key])

    def _mixed(self, parameters: Parameters, number: bool) -> NamedTexture:
        """Return a mix of two textures, of which one image at most is part."""
        names = (("tex1", 0.0, number), ("tex2", 1.0, number), ("amount", 0.5, True))
        parts = [self.texture(parameters, name, default, number=alone) for name, default, alone in names]
        indices = {part.index for part in parts if part.index >= 0}
        image = self.textures[max(indices)] if indices else None
        if len(indices) > 1 or not isinstance(image, ImageTexture | None):
            self._warn("a mix of several images is left out; grey stands in")
            return NamedTexture((0.5, 0.5, 0.5))
        shown = np.ones((1, 1, 3)) if image is None else _light_of_codes(srgb=image.srgb)[image.pixels[..., :3]]
        first, second, amount = (np.multiply(part.color, shown if part.index >= 0 else 1.0) for part in parts)
        share = amount.mean(axis=-1, keepdims=True)
        light = np.broadcast_to(first * (1.0 - share) + second * share, shown.shape)
        if image is None:
            r, g, b = light[0, 0].tolist()
            return NamedTexture((r, g, b))
        pixels = np.concatenate([encode_srgb8(light), image.pixels[..., 3:]], axis=2)
        return NamedTexture(WHITE, self._append(replace(image, pixels=pixels, srgb=True)))

    def _checkerboard(self, parameters: Parameters, number: bool) -> int:
        """Return a checkerboard as an image of four texels that spans two squares each way."""
        if parameters.number("dimension", 2) != 2:
            self._warn("checkerboards of three dimensions are mapped by u and v alone")
        first, second = (self.texture(parameters, f"tex{k}", 2.0 - k, number=number) for k in (1, 2))
        if first.index >= 0 or second.index >= 0:
            self._warn("textures inside a checkerboard are left out")
        a, b = ((*encode_srgb8(texture.color).tolist(), 255) for texture in (first, second))
        rows = self._mapping(parameters)
        matrix = ((rows[0][0] / 2, 0.0, rows[0][2] / 2), (0.0, rows[1][1] / 2, rows[1][2] / 2))
        return self._append(ImageTexture(np.array([[b, a], [a, b]], np.uint8), nearest=True, uv_matrix=matrix))

    def _append(self, texture: Texture) -> int:
        self.textures.append(texture)
        return len(self.textures) - 1

    def _mapping(self, parameters: Parameters) -> tuple[Vec3, Vec3]:
        if parameters.word("mapping", "uv") != "uv":
            self._warn("textures are mapped by u and v alone")
        return (
            (parameters.number("uscale", 1.0), 0.0, parameters.number("udelta", 0.0)),
            (0.0, parameters.number("vscale", 1.0), parameters.number("vdelta", 0.0)),
        )

    def _image(self, path: Path, *, srgb: bool) -> U8:
        if (path, srgb) not in self._images:
            self._images[path, srgb] = read_texture(path, self._budget, srgb=srgb)
        return self._images[path, srgb]

    def opacity(self, material: Material, parameters: Parameters) -> Material:
        """Return the material with the alpha that a shape gives it."""
        if "alpha" not in parameters.found:
            return material
        alpha = self.texture(parameters, "alpha", 1.0, number=True)
        if alpha.index < 0:
            return replace(material, alpha_mode="blend", opacity=min(max(alpha.color[0], 0.0), 1.0))
        image = self.textures[alpha.index]
        if not isinstance(image, ImageTexture):
            return material
        pixels = image.pixels.copy()
        share = (_light_of_codes(srgb=image.srgb)[pixels[..., :3]] * alpha.color).mean(axis=2)
        pixels[..., 3] = np.clip(share * 255.0 + 0.5, 0, 255).astype(np.uint8)
        return replace(material, alpha_mode="blend", opacity_texture=self._append(replace(image, pixels=pixels)))

    def read(self, kind: str, parameters: Parameters) -> Material:
        """Return a material."""
        if "displacement" in parameters.found:
            self._warn("displacements are left out")
        material = self._surface(kind, parameters)
        normals = parameters.word("normalmap", "")
        if normals:
            pixels = self._image(file_of(parameters.place, normals, self._folder), srgb=False)
            material = replace(material, normal_texture=self._append(ImageTexture(pixels, srgb=False)))
        if kind in KNOWN:
            parameters.tell_unread(f"material {kind}", self._warn)
        return material

    def _surface(self, kind: str, parameters: Parameters) -> Material:
        if kind in ("", "none", "interface"):
            return Material(alpha_mode="blend", opacity=0.0)
        if kind == "mix":
            return self._mix(parameters)
        if kind == "conductor":
            return self._conductor(parameters, "")
        if kind == "coatedconductor":
            self._warn("the coat of a coatedconductor is left out")
            return self._conductor(parameters, "conductor.")
        if kind in ("dielectric", "thindielectric"):
            eta = self.color(parameters, "eta", 1.5)[1]
            if not eta > 0:
                raise InputError(f"{parameters.place}: eta is {eta:g}, expected more than 0")
            if kind == "thindielectric":
                return Material(kind="thin-dielectric", color=WHITE, ior=eta)
            return self._roughened(Material(kind="dielectric", color=WHITE, ior=eta), parameters, "")
        base = self._diffuse(parameters)
        if kind == "coateddiffuse":
            eta = self.color(parameters, "eta", 1.5)[1]
            plastic = replace(base, kind="plastic", ior=max(eta, 1.0), nonlinear=True)
            return self._roughened(plastic, parameters, "")
        if kind != "diffuse":
            self._warn(f"the material {kind} is rendered as diffuse")
        return base

    def by_name(self, name: str, place: str) -> Material:
        """Return a material that has a name; raises InputError where there is none."""
        if name not in self.named:
            raise InputError(f"{place}: there is no material {name!r} before this")
        return self.named[name]

    def _mix(self, parameters: Parameters) -> Material:
        told = parameters.found.find("materials")
        if told is None or len(told.words) != 2:
            raise InputError(f"{parameters.place}: a mix has no two materials, expected their names")
        first, second = (self.by_name(name, told.place) for name in told.words)
        amount = self.texture(parameters, "amount", 0.5, number=True)
        share = min(max(amount.color[0], 0.0), 1.0)
        return blended(first, second, share, amount.index, self.index, self._warn)

    def _diffuse(self, parameters: Parameters) -> Material:
        reflectance = self.texture(parameters, "reflectance", 0.5)
        r, g, b = (min(max(channel, 0.0), 1.0) for channel in reflectance.color)
        return Material(color=(r, g, b), texture=reflectance.index)

    def _conductor(self, parameters: Parameters, prefix: str) -> Material:
        metal = self._roughened(Material(kind="conductor", color=WHITE), parameters, prefix)
        for name in ("reflectance", f"{prefix}reflectance"):
            if name in parameters.found:
                reflectance = self.texture(parameters, name, 1.0)
                r, g, b = (min(max(channel, 0.0), 1.0) for channel in reflectance.color)
                return replace(metal, color=(r, g, b), texture=reflectance.index)
        eta, k = METALS["Cu"]
        if f"{prefix}eta" in parameters.found:
            eta = self.color(parameters, f"{prefix}eta", 0.0)
        if f"{prefix}k" in parameters.found:
            k = self.color(parameters, f"{prefix}k", 0.0)
        return replace(metal, eta=eta, k=k)

    def _roughened(self, material: Material, parameters: Parameters, prefix: str) -> Material:
        """Return the material with its roughness, numbers or a texture."""
        names = [f"{prefix}{name}" for name in ("roughness", "uroughness", "vroughness")]
        remapped = parameters.flag("remaproughness", True)
        textured = [n for n in names if n in parameters.found and parameters.found[n].type == "texture"]
        if textured:
            if len(textured) > 1:
                self._warn("of two textures of roughness the first is used")
            return replace(
                material, **self._roughness(self.texture(parameters, textured[0], 0.0, number=True), remapped)
            )
        whole = parameters.number(names[0], 0.0)
        across = [max(parameters.number(name, whole), 0.0) for name in names[1:]]
        along_u, along_v = (min(math.sqrt(each) if remapped else each, 1.0) for each in across)
        if along_u == along_v:
            return replace(material, alpha=along_u)
        # A perfect mirror along one tangent alone has no name: it is nearly one.
        along_u, along_v = max(along_u, LEAST_ALPHA), max(along_v, LEAST_ALPHA)
        return replace(material, alpha=math.sqrt(along_u * along_v), stretch=math.sqrt(along_u / along_v))

    def _roughness(self, texture: NamedTexture, remapped: bool) -> dict[str, Any]:
        """Return α, and the texture of it where there is one, as fields of a material."""
        image = None if texture.index < 0 else self.textures[texture.index]
        values = np.full((1, 1, 3), 1.0)
        if isinstance(image, ImageTexture):
            values = _light_of_codes(srgb=image.srgb)[image.pixels[..., :3]]
        roughness = np.maximum((values * texture.color).mean(axis=2), 0.0)
        alpha = np.sqrt(roughness) if remapped else roughness
        if not isinstance(image, ImageTexture):
            return {"alpha": min(float(alpha[0, 0]), 1.0)}
        key = ("roughness", texture, remapped)
        if key not in self._added:
            self._added[key] = self._append(replace(image, pixels=roughness_pixels(alpha), srgb=False))
        return {"alpha": 1.0, "roughness_texture": self._added[key]}


def _rgb_of_luminance_one(wavelengths_nm: Any, values: Any) -> Vec3:
    """Return the colour of a light's spectrum, which pbrt-v4 scales to luminance 1."""
    r, g, b = rgb_of_light(wavelengths_nm, values)
    luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b
    return (r / luminance, g / luminance, b / luminance) if luminance > 0 else (0.0, 0.0, 0.0)


def _light_of_codes(*, srgb: bool) -> F64:
    """Return the light that the 256 codes of 8 bits stand for."""
    plain = np.arange(256) / 255.0
    return decode_srgb(plain) if srgb else plain
