"""Mitsuba's bsdfs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.scene.light.spectra import GLASSES, METALS
from clsim.scene.mitsuba.blends import blended
from clsim.scene.mitsuba.principled import LEAST_ALPHA, read_principled
from clsim.scene.mitsuba.textures import WHITE, TextureReader, luminance
from clsim.scene.mitsuba.values import Color, shown
from clsim.scene.mitsuba.xml import Plugin
from clsim.scene.world import Material, Vec3, scaled

BLACK: Vec3 = (0.0, 0.0, 0.0)
GREY: Vec3 = (0.5, 0.5, 0.5)
SIGMAS = ("sigma_a", "sigma_s")


class MaterialReader:
    """Reads bsdfs.

    Attributes:
        materials: what was read so far.
        textures: the reader of their textures.
    """

    def __init__(self, legacy: bool, folder: Any, warn: Callable[[str], None]) -> None:
        """Read from a scene's folder; ``legacy`` is a version before 2; ``warn`` takes what World cannot hold."""
        self.materials: list[Material] = []
        self.textures = TextureReader(legacy, folder, self._warn)
        self._legacy, self._tell = legacy, warn
        self._at = ""
        self._told: set[str] = set()
        self._indices: dict[Material, int] = {}

    def index(
        self,
        bsdf: Plugin | None,
        emission: Vec3 = (0.0, 0.0, 0.0),
        emission_texture: int = -1,
        inside: Plugin | None = None,
    ) -> int:
        """Return the index into ``materials`` of a bsdf on a surface that also emits, with a medium ``inside``."""
        if bsdf is None:  # Mitsuba's default is grey, and black for what emits
            color = BLACK if any(emission) else GREY
            material = Material(color=color, back="black")
        else:
            material = self._read(bsdf)
        if inside is not None:
            material = self._filled(material, inside)
        if any(emission):
            # Mitsuba's area lights shine from the front alone, on whichever sides the bsdf scatters.
            material = replace(material, emission=emission, emission_texture=emission_texture, emits_behind=False)
        return self._added(material)

    def _filled(self, material: Material, medium: Plugin) -> Material:
        """Return glass that absorbs as a medium does; of one that scatters, or is not in glass, a warning says so."""
        solid = material.kind == "dielectric" or (material.kind == "disney" and material.transmission > 0)
        name = f"the medium {medium.id or medium.type} ({Path(medium.place).name})"
        if medium.type != "homogeneous" or not solid:
            self._tell(f"{name} is left out: clsim knows only homogeneous media without scattering, in glass")
            return material
        if "sigma_a" in medium.values or "sigma_s" in medium.values:
            absorbed, scattered = (self.textures.color(medium, name, 0.0, plain=True)[0] for name in SIGMAS)
        else:
            absorbed = self.textures.color(medium, "sigma_t", 1.0, plain=True)[0]
            scattered = self.textures.color(medium, "albedo", 0.75, plain=True)[0]
        if any(scattered):
            self._tell(f"{name} is left out, for it scatters: what is milky within is clear")
            return material
        return replace(material, absorption=scaled(absorbed, max(medium.get("scale", 1.0), 0.0)))

    def _added(self, material: Material) -> int:
        if material not in self._indices:
            self._indices[material] = len(self.materials)
            self.materials.append(material)
        return self._indices[material]

    def _warn(self, sentence: str) -> None:
        """Tell each thing once, with the first material that it is about."""
        if sentence not in self._told:
            self._told.add(sentence)
            self._tell(f"{sentence} (first in {self._at})" if self._at else sentence)

    def _read(self, bsdf: Plugin) -> Material:
        self._at = f"{bsdf.id}, {Path(bsdf.place).name}" if bsdf.id else Path(bsdf.place).name
        reader = getattr(self, f"_read_{bsdf.type.lower().replace('-', '_')}", None)
        if reader is not None and bsdf.kind == "bsdf":
            material: Material = reader(bsdf)
            return material
        bsdf.pass_over()
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
        color, texture = self.textures.color(bsdf, name, default)
        return Material(color=_reflectance(color), texture=texture, back="black")

    def _read_diffuse(self, bsdf: Plugin) -> Material:
        return self._diffuse(bsdf, "reflectance")

    def _read_roughdiffuse(self, bsdf: Plugin) -> Material:
        self._warn("the bsdf roughdiffuse is rendered as diffuse")
        bsdf.pass_over()
        return self._diffuse(bsdf, "reflectance")

    def _read_plastic(self, bsdf: Plugin) -> Material:
        specular, _ = self.textures.color(bsdf, "specular_reflectance", 1.0, plain=True)
        return replace(
            self._diffuse(bsdf, "diffuse_reflectance"),
            kind="plastic",
            ior=self._ior(bsdf, "polypropylene"),
            nonlinear=bsdf.get("nonlinear", False),
            specular_color=specular,
        )

    def _read_roughplastic(self, bsdf: Plugin) -> Material:
        return self._roughened(self._read_plastic(bsdf), bsdf)

    def _read_pplastic(self, bsdf: Plugin) -> Material:
        """As rough plastic, but light that the coat reflects back onto the base is lost, as it is in Mitsuba."""
        self._warn("the bsdf pplastic is rendered without polarisation")
        material = self._read_roughplastic(bsdf)
        passing = 1.0 - mean_reflectance(material.ior)
        return replace(material, color=scaled(material.color, passing), nonlinear=False)

    def _read_phong(self, bsdf: Plugin) -> Material:
        """As a matt surface with a share of a rough mirror, whose half vectors are as narrow as the lobe."""
        base = self._diffuse(bsdf, "diffuse_reflectance")
        specular = _reflectance(self.textures.color(bsdf, "specular_reflectance", 0.2, plain=True)[0])
        exponent = max(bsdf.get("exponent", 30.0), 0.0)
        if bsdf.child("exponent") is not None:
            self._warn("the texture of the exponent of the bsdf phong is left out; 30 stands in")
        # By half vectors the angle is half as wide, and cosⁿ as narrow as exp(−tan² / α²) of α² = 2 / (4n + 2).
        alpha = max(math.sqrt(2.0 / (4.0 * exponent + 2.0)), LEAST_ALPHA)
        return self._with_lobe(bsdf, base, specular, Material(alpha=alpha))

    def _read_ward(self, bsdf: Plugin) -> Material:
        """Ward's lobe is Beckmann's distribution of half vectors, without masking."""
        specular = _reflectance(self.textures.color(bsdf, "specular_reflectance", 0.2, plain=True)[0])
        facets = self._roughened(Material(), bsdf)
        return self._with_lobe(bsdf, self._diffuse(bsdf, "diffuse_reflectance"), specular, facets)

    def _with_lobe(self, bsdf: Plugin, base: Material, specular: Vec3, facets: Material) -> Material:
        """Return a matt surface with a share of a mirror that is as rough as ``facets``."""
        whole = max(base.color) + max(specular)
        if max(specular) < 1e-9:
            return base
        if base.texture >= 0 or whole > 1.0:
            self._warn(f"the bsdf {bsdf.type} is rendered as diffuse")
            return base
        self._warn(f"the bsdf {bsdf.type} is rendered as diffuse with a lobe of Beckmann's microfacets")
        share = max(specular) / whole
        lobe = replace(
            facets,
            kind="conductor",
            color=WHITE,
            back="black",
            distribution="beckmann",
            eta=BLACK,
            k=WHITE,
            specular_color=scaled(specular, 1.0 / share),
        )
        matt = replace(base, color=_reflectance(scaled(base.color, 1.0 / max(1.0 - share, 1e-9))))
        return replace(matt, blend_with=self._added(lobe), blend_share=share)

    def _read_conductor(self, bsdf: Plugin) -> Material:
        specular, _ = self.textures.color(bsdf, "specular_reflectance", 1.0, plain=True)
        outside = self._index(bsdf, "ext_eta", 1.0) if "ext_eta" in bsdf.values else 1.0
        metal = Material(kind="conductor", color=WHITE, back="black", specular_color=specular)
        name = bsdf.get("material", "Cu" if self._legacy else "none")
        if any(each in bsdf.values or bsdf.child(each) is not None for each in ("eta", "k")):
            eta, _ = self.textures.color(bsdf, "eta", 0.0, plain=True)
            k, _ = self.textures.color(bsdf, "k", 1.0, plain=True)
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
        return replace(metal, eta=scaled(eta, 1 / outside), k=scaled(k, 1 / outside))

    def _read_roughconductor(self, bsdf: Plugin) -> Material:
        return self._roughened(self._read_conductor(bsdf), bsdf)

    def _read_dielectric(self, bsdf: Plugin) -> Material:
        specular, _ = self.textures.color(bsdf, "specular_reflectance", 1.0, plain=True)
        through, _ = self.textures.color(bsdf, "specular_transmittance", 1.0, plain=True)
        passed = _reflectance(through)
        return Material(kind="dielectric", color=passed, ior=self._ior(bsdf, "bk7"), specular_color=specular)

    def _read_roughdielectric(self, bsdf: Plugin) -> Material:
        return self._roughened(self._read_dielectric(bsdf), bsdf)

    def _read_thindielectric(self, bsdf: Plugin) -> Material:
        return replace(self._read_dielectric(bsdf), kind="thin-dielectric")

    def _read_principled(self, bsdf: Plugin) -> Material:
        return read_principled(bsdf, self.textures, self._warn)

    def _read_twosided(self, bsdf: Plugin) -> Material:
        self._nested(bsdf)
        front, *behind = (self._twosided(self._read(each)) for each in bsdf.of_kind("bsdf")[:2])
        if not behind or front == behind[0]:
            return front
        if front.blend_with >= 0:
            self._warn("a twosided bsdf whose front is a blend shows it on both sides")
            return front
        return replace(front, blend_with=self._added(behind[0]), blend_behind=True)

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
            opacity, _ = self.textures.color(bsdf, "opacity", 0.5, plain=True)
            left = material.opacity * min(max(luminance(opacity), 0.0), 1.0)
            return replace(material, alpha_mode="blend", opacity=left)
        if material.opacity_texture >= 0:
            self._warn("of a mask within a mask, the texture of the outer one counts alone")
        index = self.textures.index(texture, as_opacity=True)
        return replace(material, alpha_mode="blend", opacity_texture=index)

    def _read_normalmap(self, bsdf: Plugin) -> Material:
        material = self._read(self._nested(bsdf))
        texture = bsdf.child("normalmap") or next(iter(bsdf.of_kind("texture")), None)
        if texture is None:
            raise InputError(f"{bsdf.place}: the bsdf normalmap has no texture")
        return replace(material, normal_texture=self.textures.index(texture, raw=True))

    def _read_bumpmap(self, bsdf: Plugin) -> Material:
        material = self._read(self._nested(bsdf))
        texture = next(iter(bsdf.of_kind("texture")), None)
        if texture is None:
            raise InputError(f"{bsdf.place}: the bsdf bumpmap has no texture")
        if material.blend_with >= 0:
            self._warn("bump maps of blends bend the first material alone")
        return replace(material, bump_texture=self.textures.index(texture), bump_scale=bsdf.get("scale", 1.0))

    def _read_blendbsdf(self, bsdf: Plugin) -> Material:
        """The weight is that of the second."""
        nested = bsdf.of_kind("bsdf")
        if len(nested) != 2:
            raise InputError(f"{bsdf.place}: the bsdf blendbsdf has {len(nested)} bsdfs inside, expected 2")
        first, second = map(self._read, nested)
        weight, texture = self.textures.color(bsdf, "weight", 0.5, number=True)
        share = min(max(luminance(weight), 0.0), 1.0)
        return blended(first, second, share, texture, self._added, self._warn)

    def _read_null(self, bsdf: Plugin) -> Material:
        return Material(alpha_mode="blend", opacity=0.0)

    def _read_polarizer(self, bsdf: Plugin) -> Material:
        """Half of unpolarised light passes, and all does through what only turns its polarisation."""
        self._warn(f"the bsdf {bsdf.type} is rendered without polarisation")
        through, _ = self.textures.color(bsdf, "transmittance", 1.0, plain=True)
        passed = min(max(luminance(through), 0.0), 1.0) * (1.0 if bsdf.type == "retarder" else 0.5)
        return Material(color=BLACK, alpha_mode="blend", opacity=1.0 - passed)

    _read_circular = _read_retarder = _read_polarizer

    def _nested(self, bsdf: Plugin) -> Plugin:
        nested = bsdf.of_kind("bsdf")
        if not nested:
            raise InputError(f"{bsdf.place}: the bsdf {bsdf.type} has no bsdf inside")
        return nested[0]

    def _roughened(self, material: Material, bsdf: Plugin) -> Material:
        """Return the material with the bsdf's microfacets: their distribution, and roughness or its texture."""
        distribution = bsdf.get("distribution", "beckmann").lower()
        if distribution not in ("beckmann", "ggx"):
            self._warn(f"rough surfaces of the distribution {distribution} are rendered with Beckmann's")
        material = replace(material, distribution="ggx" if distribution == "ggx" else "beckmann")
        texture = bsdf.child("alpha")
        if texture is not None:
            rough = self.textures.roughness(self.textures.index(texture, number=True))
            return replace(material, alpha=1.0, roughness_texture=rough)
        both = [self.textures.color(bsdf, name, 0.1, plain=True)[0] for name in ("alpha_u", "alpha_v")]
        if any(name in bsdf.values or bsdf.child(name) is not None for name in ("alpha_u", "alpha_v")):
            along_u, along_v = (max(luminance(alpha), LEAST_ALPHA) for alpha in both)
            return replace(material, alpha=math.sqrt(along_u * along_v), stretch=math.sqrt(along_u / along_v))
        return replace(material, alpha=bsdf.get("alpha", 0.1))

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
            raise InputError(f"{bsdf.place}: {name} is {shown(value)}, expected a positive number")
        return value


def mean_reflectance(ior: float) -> float:
    """Return the share of diffuse light that a smooth surface reflects, of that index over the one around it."""
    x, w = np.polynomial.legendre.leggauss(64)
    cos_i = 0.5 * (x + 1.0)
    # No square of the index, which may be as large as numbers go.
    cos_t = np.sqrt(1.0 - np.minimum(np.sqrt(1.0 - cos_i**2) / ior, 1.0) ** 2)
    across = (cos_i - ior * cos_t) / (cos_i + ior * cos_t)
    along = (ior * cos_i - cos_t) / (ior * cos_i + cos_t)
    return float(np.sum(w * cos_i * 0.5 * (across**2 + along**2)))


def _reflectance(color: Vec3) -> Vec3:
    return min(max(color[0], 0.0), 1.0), min(max(color[1], 0.0), 1.0), min(max(color[2], 0.0), 1.0)
