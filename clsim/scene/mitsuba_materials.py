"""Mitsuba's bsdfs and textures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.scene.geometry import flipped_v
from clsim.scene.images import U8, PixelBudget, decode_srgb, encode_srgb8, read_texture, roughness_pixels
from clsim.scene.mitsuba_values import Color, file_of
from clsim.scene.mitsuba_xml import Plugin
from clsim.scene.motion import Matrix
from clsim.scene.spectra import GLASSES, METALS
from clsim.scene.world import CheckerTexture, ImageTexture, Material, Texture, Vec3, Wrap

WRAPS: dict[str, Wrap] = {"repeat": "repeat", "clamp": "clamp", "mirror": "mirror", "black": "clamp", "zero": "clamp"}
BLACK: Vec3 = (0.0, 0.0, 0.0)
GREY: Vec3 = (0.5, 0.5, 0.5)
WHITE: Vec3 = (1.0, 1.0, 1.0)
LUMINANCE = (0.2126, 0.7152, 0.0722)


class MaterialReader:
    """Reads bsdfs, and each texture once.

    Attributes:
        materials: what was read so far.
        textures: likewise.
    """

    def __init__(self, legacy: bool, folder: Any, warn: Callable[[str], None]) -> None:
        """Read from a scene's folder; ``legacy`` is a version before 2; ``warn`` takes what World cannot hold."""
        self.materials: list[Material] = []
        self.textures: list[Texture] = []
        self._legacy, self._folder, self._warn = legacy, folder, warn
        self._material_indices: dict[Material, int] = {}
        self._textures: dict[tuple[object, ...], int] = {}
        self._pixels: dict[object, U8] = {}
        self._budget = PixelBudget()

    def index(self, bsdf: Plugin | None, emission: Vec3 = (0.0, 0.0, 0.0), emission_texture: int = -1) -> int:
        """Return the index into ``materials`` of a bsdf on a surface that also emits."""
        if bsdf is None:  # Mitsuba's default is grey, and black for what emits
            color = BLACK if any(emission) else GREY
            material = Material(color=color, back="black")
        else:
            material = self._read(bsdf)
        if any(emission):
            # Mitsuba's area lights shine from the front alone, on whichever sides the bsdf scatters.
            material = replace(material, emission=emission, emission_texture=emission_texture, emits_behind=False)
        return self._added(material)

    def _added(self, material: Material) -> int:
        if material not in self._material_indices:
            self._material_indices[material] = len(self.materials)
            self.materials.append(material)
        return self._material_indices[material]

    def _read(self, bsdf: Plugin) -> Material:
        reader = getattr(self, f"_read_{bsdf.type.lower().replace('-', '_')}", None)
        if reader is not None and bsdf.kind == "bsdf":
            material: Material = reader(bsdf)
            return material
        nested = bsdf.of_kind("bsdf")
        if nested:
            self._warn(f"the bsdf {bsdf.type} is left out; the first bsdf inside it stands in")
            return self._read(nested[0])
        self._warn(f"the bsdf {bsdf.type} is rendered as diffuse")
        for name in ("reflectance", "diffuse_reflectance", "base_color", "albedo"):
            if name in bsdf.values or bsdf.child(name) is not None:
                return self._diffuse(bsdf, name)
        return Material(back="black")

    def _diffuse(self, bsdf: Plugin, name: str, default: float = 0.5) -> Material:
        color, texture = self._color(bsdf, name, default)
        return Material(color=_reflectance(color), texture=texture, back="black")

    def _read_diffuse(self, bsdf: Plugin) -> Material:
        return self._diffuse(bsdf, "reflectance")

    def _read_roughdiffuse(self, bsdf: Plugin) -> Material:
        self._warn("the bsdf roughdiffuse is rendered as diffuse")
        return self._diffuse(bsdf, "reflectance")

    def _read_plastic(self, bsdf: Plugin) -> Material:
        specular, _ = self._color(bsdf, "specular_reflectance", 1.0, plain=True)
        return replace(
            self._diffuse(bsdf, "diffuse_reflectance"),
            kind="plastic",
            ior=self._ior(bsdf, "polypropylene"),
            nonlinear=bsdf.get("nonlinear", False),
            specular_color=specular,
        )

    def _read_roughplastic(self, bsdf: Plugin) -> Material:
        return self._roughened(self._read_plastic(bsdf), bsdf)

    def _read_conductor(self, bsdf: Plugin) -> Material:
        specular, _ = self._color(bsdf, "specular_reflectance", 1.0, plain=True)
        outside = self._index(bsdf, "ext_eta", 1.0) if "ext_eta" in bsdf.values else 1.0
        metal = Material(kind="conductor", color=WHITE, back="black", specular_color=specular)
        name = bsdf.get("material", "Cu" if self._legacy else "none")
        if "eta" in bsdf.values or "k" in bsdf.values:
            eta, _ = self._color(bsdf, "eta", 0.0, plain=True)
            k, _ = self._color(bsdf, "k", 1.0, plain=True)
        elif name.lower() == "none":
            return metal
        elif name in METALS:
            eta, k = METALS[name]
        else:
            self._warn(f"the metal {name} is not known; aluminium stands in")
            eta, k = METALS["Al"]
        if min(*eta, *k) < 0:
            self._warn("a metal has a negative index; 0 stands in")
            eta, k = ((max(c[0], 0.0), max(c[1], 0.0), max(c[2], 0.0)) for c in (eta, k))
        return replace(metal, eta=_scaled(eta, 1 / outside), k=_scaled(k, 1 / outside))

    def _read_roughconductor(self, bsdf: Plugin) -> Material:
        return self._roughened(self._read_conductor(bsdf), bsdf)

    def _read_dielectric(self, bsdf: Plugin) -> Material:
        specular, _ = self._color(bsdf, "specular_reflectance", 1.0, plain=True)
        through, _ = self._color(bsdf, "specular_transmittance", 1.0, plain=True)
        passed = _reflectance(through)
        return Material(kind="dielectric", color=passed, ior=self._ior(bsdf, "bk7"), specular_color=specular)

    def _read_roughdielectric(self, bsdf: Plugin) -> Material:
        return self._roughened(self._read_dielectric(bsdf), bsdf)

    def _read_thindielectric(self, bsdf: Plugin) -> Material:
        return replace(self._read_dielectric(bsdf), kind="thin-dielectric")

    def _read_principled(self, bsdf: Plugin) -> Material:
        self._warn("the bsdf principled is rendered as glTF's metallic-roughness")
        coat = bsdf.get("clearcoat", 0.0)
        gloss = bsdf.get("clearcoat_gloss", 0.0)
        return replace(
            self._diffuse(bsdf, "base_color"),
            kind="principled",
            alpha=bsdf.get("roughness", 0.5) ** 2,
            metallic=bsdf.get("metallic", 0.0),
            ior=bsdf.get("eta", 1.5),
            transmission=bsdf.get("spec_trans", 0.0),
            clearcoat=coat,
            clearcoat_alpha=0.1 + (0.001 - 0.1) * gloss if coat else 0.0,
        )

    def _read_twosided(self, bsdf: Plugin) -> Material:
        nested = self._nested(bsdf)
        if len(bsdf.of_kind("bsdf")) > 1:
            self._warn("a twosided bsdf with two sides of its own shows its first on both")
        return self._twosided(self._read(nested))

    def _twosided(self, material: Material) -> Material:
        """Return a material that scatters behind as it does in front, and so does what it is a blend with."""
        if material.blend_with >= 0:
            other = self._twosided(self.materials[material.blend_with])
            material = replace(material, blend_with=self._added(other))
        return replace(material, back="same")

    def _read_mask(self, bsdf: Plugin) -> Material:
        """Opacity is the luminance of its texture's colours, as in Mitsuba, also where the image has an alpha."""
        material = self._read(self._nested(bsdf))
        texture = bsdf.child("opacity")
        if texture is None:
            opacity, _ = self._color(bsdf, "opacity", 0.5, plain=True)
            return replace(material, alpha_mode="blend", opacity=min(_luminance(opacity), 1.0))
        return replace(material, alpha_mode="blend", opacity_texture=self._texture(texture, as_opacity=True))

    def _read_normalmap(self, bsdf: Plugin) -> Material:
        material = self._read(self._nested(bsdf))
        texture = bsdf.child("normalmap") or next(iter(bsdf.of_kind("texture")), None)
        if texture is None:
            raise InputError(f"{bsdf.place}: the bsdf normalmap has no texture")
        return replace(material, normal_texture=self._texture(texture, raw=True))

    def _read_bumpmap(self, bsdf: Plugin) -> Material:
        material = self._read(self._nested(bsdf))
        texture = next(iter(bsdf.of_kind("texture")), None)
        if texture is None:
            raise InputError(f"{bsdf.place}: the bsdf bumpmap has no texture")
        if material.blend_with >= 0:
            self._warn("bump maps of blends bend the first material alone")
        return replace(material, bump_texture=self._texture(texture), bump_scale=bsdf.get("scale", 1.0))

    def _read_blendbsdf(self, bsdf: Plugin) -> Material:
        """The weight is that of the second."""
        nested = bsdf.of_kind("bsdf")
        if len(nested) != 2:
            raise InputError(f"{bsdf.place}: the bsdf blendbsdf has {len(nested)} bsdfs inside, expected 2")
        first, second = map(self._read, nested)
        weight, texture = self._color(bsdf, "weight", 0.5)
        share = min(max(_luminance(weight), 0.0), 1.0)
        if first.blend_with >= 0:
            if second.blend_with >= 0 or texture >= 0:
                self._warn("of a blend within a blend, the first material stands in")
                first = replace(first, blend_with=-1)
            else:
                first, second, share = second, first, 1.0 - share
        return replace(first, blend_with=self._added(second), blend_share=share, blend_texture=texture)

    def _read_null(self, bsdf: Plugin) -> Material:
        return Material(alpha_mode="blend", opacity=0.0)

    def _nested(self, bsdf: Plugin) -> Plugin:
        nested = bsdf.of_kind("bsdf")
        if not nested:
            raise InputError(f"{bsdf.place}: the bsdf {bsdf.type} has no bsdf inside")
        return nested[0]

    def _roughened(self, material: Material, bsdf: Plugin) -> Material:
        """Return the material with the bsdf's roughness, a number or a texture."""
        if bsdf.get("distribution", "beckmann").lower() != "ggx":
            self._warn("rough surfaces of the Beckmann distribution are rendered with GGX's")
        texture = bsdf.child("alpha")
        if texture is not None:
            return replace(material, alpha=1.0, roughness_texture=self._roughness(self._texture(texture)))
        if "alpha_u" in bsdf.values or "alpha_v" in bsdf.values:
            self._warn("anisotropic roughness is averaged")
            return replace(material, alpha=float(np.sqrt(bsdf.get("alpha_u", 0.1) * bsdf.get("alpha_v", 0.1))))
        return replace(material, alpha=bsdf.get("alpha", 0.1))

    def _roughness(self, index: int) -> int:
        """Return the texture of α that stands for the luminance of another."""
        texture = self.textures[index]
        if not isinstance(texture, ImageTexture):
            return self._add(("roughness", index), lambda: ImageTexture(roughness_pixels([[0.5]]), srgb=False))
        table = decode_srgb(np.arange(256) / 255.0) if texture.srgb else np.arange(256) / 255.0
        alpha = table[texture.pixels[..., :3]] @ LUMINANCE
        return self._add(("roughness", index), lambda: replace(texture, pixels=roughness_pixels(alpha), srgb=False))

    def _ior(self, bsdf: Plugin, inside: str) -> float:
        return self._index(bsdf, "int_ior", GLASSES[inside]) / self._index(bsdf, "ext_ior", GLASSES["air"])

    def _index(self, bsdf: Plugin, name: str, default: float) -> float:
        value = bsdf.values.get(name, default)
        if isinstance(value, str):
            if value.lower() not in GLASSES:
                raise InputError(f"{bsdf.place}: {name} is {value!r}, expected a number or one of {', '.join(GLASSES)}")
            return GLASSES[value.lower()]
        if isinstance(value, Color):
            value = value.rgb[1]
        if not isinstance(value, float) or not value > 0:
            raise InputError(f"{bsdf.place}: {name} is {value!r}, expected a positive number")
        return value

    def _color(self, plugin: Plugin, name: str, default: float, *, plain: bool = False) -> tuple[Vec3, int]:
        """Return a colour parameter, and its texture or -1; ``plain`` has no room for a texture."""
        texture = plugin.child(name)
        if texture is not None:
            if plain:
                self._warn(f"textures of {name} are left out")
                return (default, default, default), -1
            return WHITE, self._texture(texture)
        value = plugin.values.get(name, default)
        if isinstance(value, float):
            return (value, value, value), -1
        if not isinstance(value, Color):
            raise InputError(f"{plugin.place}: {plugin.type}.{name} is {value!r}, expected a colour")
        return value.rgb, -1

    def texture(self, plugin: Plugin) -> int:
        """Return the index of a texture of colours."""
        return self._texture(plugin)

    def _texture(self, plugin: Plugin, *, raw: bool = False, as_opacity: bool = False) -> int:
        matrix = flipped_v(self._to_uv(plugin))
        if plugin.type == "checkerboard":
            return self._checkerboard(plugin, matrix, as_opacity=as_opacity)
        if plugin.type != "bitmap":
            nested = plugin.of_kind("texture")
            if nested:
                self._warn(f"the texture {plugin.type} is left out; the one inside it stands in")
                return self._texture(nested[0], raw=raw, as_opacity=as_opacity)
            self._warn(f"the texture {plugin.type} is left out; grey stands in")
            return self._add(("grey",), lambda: CheckerTexture((0.5, 0.5, 0.5), (0.5, 0.5, 0.5)))
        path = file_of(plugin.place, plugin.get("filename", ""), self._folder)
        linear = raw or plugin.get("raw", False) or plugin.get("gamma", 0.0) == 1.0
        wrap = plugin.get("wrap_mode", "repeat")
        wraps = [plugin.get(name, wrap).lower() for name in ("wrap_mode_u", "wrap_mode_v")]
        if any(name not in WRAPS for name in wraps):
            raise InputError(f"{plugin.place}: wrap_mode is {wrap!r}, expected one of {', '.join(WRAPS)}")
        nearest = plugin.get("filter_type", "bilinear").lower() == "nearest"
        key = (path, linear, as_opacity, *wraps, nearest, matrix)
        return self._add(
            key,
            lambda: ImageTexture(
                self._image(path, linear=linear, as_opacity=as_opacity),
                srgb=not linear,
                wrap_u=WRAPS[wraps[0]],
                wrap_v=WRAPS[wraps[1]],
                nearest=nearest,
                uv_matrix=matrix,
            ),
        )

    def _add(self, key: tuple[object, ...], make: Callable[[], Texture]) -> int:
        if key not in self._textures:
            texture = make()
            self._textures[key] = len(self.textures)
            self.textures.append(texture)
        return self._textures[key]

    def _image(self, path: Any, *, linear: bool, as_opacity: bool) -> U8:
        """Return an image, read once; as opacity, its luminance stands in the alpha channel."""
        if path not in self._pixels:
            self._pixels[path] = read_texture(path, self._budget)
        pixels = self._pixels[path]
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

    def _checkerboard(self, plugin: Plugin, matrix: tuple[Vec3, Vec3], *, as_opacity: bool) -> int:
        """Return a checkerboard as an image of four texels, which takes any transform; a texture inside is grey."""
        colors = [self._color(plugin, name, value, plain=True)[0] for name, value in (("color0", 0.4), ("color1", 0.2))]
        encoded = [encode_srgb8(color) for color in colors]
        alphas = [round(255 * min(_luminance(color), 1.0)) if as_opacity else 255 for color in colors]
        first, second = ((*color.tolist(), alpha) for color, alpha in zip(encoded, alphas, strict=True))
        pixels = np.array([[first, second], [second, first]], np.uint8)
        key = ("checkerboard", first, second, matrix)
        return self._add(key, lambda: ImageTexture(pixels, nearest=True, uv_matrix=matrix))


def _reflectance(color: Vec3) -> Vec3:
    return min(max(color[0], 0.0), 1.0), min(max(color[1], 0.0), 1.0), min(max(color[2], 0.0), 1.0)


def _scaled(color: Vec3, factor: float) -> Vec3:
    return color[0] * factor, color[1] * factor, color[2] * factor


def _luminance(color: Vec3) -> float:
    return float(np.dot(color, LUMINANCE))
