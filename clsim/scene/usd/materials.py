"""Materials of USD: UsdPreviewSurface (its specification, version 2.6), what is read as one, and colours of meshes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from pxr import UsdGeom, UsdShade

from clsim.scene.usd.light_tracks import brightest
from clsim.scene.usd.stage import Stage
from clsim.scene.usd.surfaces import LUMENS_PER_WATT, SurfaceModel, material_of, surface_of
from clsim.scene.usd.textures import TextureReader, Told, same_size
from clsim.scene.world import ImageTexture, Material, Texture, Vec3, scaled

Color = tuple[float, float, float]
BLACK: Vec3 = (0.0, 0.0, 0.0)
_AS_THE_THRESHOLD_SAYS, _OPAQUE, _CUT, _BLENDED = -1.0, 0.0, 1.0, 2.0
"""What becomes of opacity; but for the first, the numbers of glTF's ``alpha_mode`` in MaterialX."""


class MaterialReader:
    """Reads materials and the textures that they use, each once.

    Attributes:
        materials: what was read so far, in order of first use.
    """

    def __init__(self, stage: Stage, warn: Callable[[str], None], *, repeat: bool) -> None:
        """Read from a stage; ``warn`` takes what is left out; with ``repeat`` light that changes starts anew."""
        self.materials: list[Material] = []
        self._stage, self._warn, self._repeat = stage, warn, repeat
        self._reader = TextureReader(stage, warn)
        self._indices: dict[Any, int] = {}

    @property
    def textures(self) -> list[Texture]:
        """What the materials use."""
        return self._reader.textures

    def index(self, prim: Any, color: Color | None) -> int:
        """Return the index of the material of a prim; of one without a material that of a colour, None for grey."""
        bound = material_of(prim)
        opacity = 1.0 if bound else self._opacity(prim)
        key: Any = self.path(prim) or (color, opacity)
        if key not in self._indices:
            plain = Material(color=color or (0.5, 0.5, 0.5), name="" if color is None else prim.GetName())
            if opacity < 1.0:
                plain = replace(plain, alpha_mode="blend", opacity=opacity)
            if bound:
                with self._stage.naming(bound):
                    plain = self._read(bound)
            self._indices[key] = self.add(plain)
        return self._indices[key]

    def _opacity(self, prim: Any) -> float:
        """Return the opacity that a prim without a material tells; where it differs from face to face, its mean."""
        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayOpacity")
        values = np.array((self._stage.still(primvar.GetAttr()) if primvar else None) or [], np.float64).ravel()
        if not len(values) or not np.isfinite(values).all():
            return 1.0
        if (values != values[0]).any():
            self._warn(f"opacity that differs over a mesh is its mean (first {prim.GetName()})")
        return _share(float(values.mean()))

    def path(self, prim: Any) -> str:
        """Return the path of the material that a prim has; nothing where it has none."""
        bound = material_of(prim)
        return str(bound.GetPath()) if bound else ""

    def add(self, material: Material) -> int:
        """Add a material, and return its index."""
        self.materials.append(material)
        return len(self.materials) - 1

    def uv_name(self, prim: Any) -> str:
        """Return which primvar the first picture on a mesh takes for coordinates; a warning tells if it lacks it."""
        subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
        names: dict[str, None] = {}
        for each in (prim, *(subset.GetPrim() for subset in subsets)):
            bound = material_of(each)
            found = surface_of(bound) if bound else None
            names |= dict.fromkeys(self._reader.uv_names(found[0]) if found else ())
        if len(names) > 1:
            self._warn(f"all textures of a mesh use the first of its texture coordinates (first {prim.GetName()})")
        first = next(iter(names), "st")
        if names and not UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(first).HasValue():
            self._warn(f"{first} that a texture asks for is missing: it shows one colour (first {prim.GetName()})")
        return first

    def color_name(self, prim: Any) -> str | None:
        """Return which primvar gives a mesh its colours: that of its material's, or USD's own where it has none."""
        subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
        materials = [material_of(each) for each in (prim, *(subset.GetPrim() for subset in subsets))]
        for found in (surface_of(bound) for bound in materials if bound):
            if found and (name := self._reader.primvar_name(found[0], found[1].names["diffuseColor"])):
                return name
        if materials[0]:
            return None
        # Faces with a material of their own have no colours that differ from point to point; one for all is told apart.
        one = UsdGeom.Gprim(prim).GetDisplayColorPrimvar().GetInterpolation() == UsdGeom.Tokens.constant
        return None if any(materials) and not one else "displayColor"

    def _read(self, bound: Any) -> Material:
        name, found = bound.GetPrim().GetName(), surface_of(bound)
        if found is None:
            kinds = "UsdPreviewSurface nor MaterialX's standard surface, OpenPBR or glTF's"
            self._warn(f"materials that are neither {kinds} are grey (first {name})")
            return Material(name=name)
        surface, model = found
        told = {
            key: self._told(surface, model, key)
            for key in ("diffuseColor", "emissiveColor", "specularColor", "metallic", "roughness", "opacity", "normal")
        }
        numbers = {
            key: self._mean(self._told(surface, model, key), model.names.get(key, key), default, name)
            for key, default in (
                ("useSpecularWorkflow", 0.0),
                ("ior", model.ior),
                ("clearcoat", 0.0),
                ("clearcoatRoughness", model.clearcoat_roughness),
                ("opacityThreshold", model.cutoff),
                ("alphaMode", _OPAQUE if "alphaMode" in model.names else _AS_THE_THRESHOLD_SAYS),
                ("transmission", 0.0),
                ("baseWeight", 1.0),
                ("specularWeight", 1.0),
            )
        }
        if model.names.get("opacity") == "opacity" and told["opacity"].image is None:
            # MaterialX's standard surface has a colour for it.
            told["opacity"] = replace(told["opacity"], value=float(np.mean(told["opacity"].color((1.0, 1.0, 1.0)))))
        for extra in model.unread:
            unread = self._reader.told(surface, extra)
            if unread.image is not None or max(unread.color(BLACK)) > 0:
                self._warn(f"{extra} of materials is left out (first that of {name})")
        told["diffuseColor"], tint = self._below_coat(
            told["diffuseColor"], self._told(surface, model, "coatColor"), _share(numbers["clearcoat"]), name
        )
        texture, factor = self._reader.colors(told["diffuseColor"], most=1.0)
        color = told["diffuseColor"].color(model.color) if texture < 0 else factor
        r, g, b = (channel * shade for channel, shade in zip(scaled(color, numbers["baseWeight"]), tint, strict=True))
        if numbers["transmission"] > 0 and "transmissionColor" in model.names:
            r, g, b, texture = self._passing(surface, model, numbers["transmission"], (r, g, b, texture), name)
        color = _shares((r, g, b))
        material = Material(
            kind="principled",
            color=color,
            texture=texture,
            ior=min(max(numbers["ior"], 1.0), 10.0),
            clearcoat=_share(numbers["clearcoat"]),
            clearcoat_alpha=_share(numbers["clearcoatRoughness"]) ** 2,
            normal_texture=self._reader.normals(told["normal"]),
            specular_color=_shares(
                scaled(self._plain(surface, model, "specularTint", name), numbers["specularWeight"])
            ),
            transmission=_share(numbers["transmission"]),
            name=name,
        )
        if numbers["useSpecularWorkflow"]:
            material = self._specular(material, told["specularColor"])
            told["metallic"] = Told(0.0)
        glowing = self._glowing(material, told["emissiveColor"], surface, model)
        return self._opaque(self._rough(glowing, told, model), told, numbers)

    def _told(self, surface: Any, model: SurfaceModel, key: str) -> Told:
        name = model.names.get(key)
        told = Told() if name is None else self._reader.told(surface, name, followed=key == "emissiveColor")
        if told.primvar and key != "diffuseColor":
            self._warn(f"what a mesh gives to {name} of materials is left out (first {surface.GetPath()})")
            return Told()
        return told

    def _plain(self, surface: Any, model: SurfaceModel, key: str, name: str) -> Vec3:
        """Return a colour that is white where nothing is told, and may be no picture."""
        told = self._told(surface, model, key)
        if told.image is not None:
            self._warn(f"textures of {model.names[key]} are left out (first that of {name})")
        return told.color((1.0, 1.0, 1.0))

    def _passing(
        self, surface: Any, model: SurfaceModel, share: float, base: tuple[float, float, float, int], name: str
    ) -> tuple[float, float, float, int]:
        """Return colour and texture of what lets a share of light pass, which has a colour of its own."""
        if not self._told(surface, model, "thinWalled").value:
            self._warn(f"what passes light is a thin wall and does not refract (first {name})")
        color = self._plain(surface, model, "transmissionColor", name)
        if share >= 1.0:
            return (*color, -1)
        if min(color) < 1.0:
            self._warn(f"light that passes in part has the surface's own colour (first that of {name})")
        return base

    def _mean(self, told: Told, key: str, default: float, name: str) -> float:
        """Return a number, or the mean of the picture that tells it."""
        if told.image is None:
            return told.number(default)
        self._warn(f"the mean of {key} textures stands in for them (first that of {name})")
        return float(told.plain(told.channel).mean())

    def _below_coat(self, base: Told, coat: Told, share: float, name: str) -> tuple[Told, Vec3]:
        """Return what tells the colour below a coat, and by what the coat's own colour multiplies it."""
        white = (1.0, 1.0, 1.0)
        if coat.image is None or share == 0.0:
            r, g, b = (1.0 + share * (channel - 1.0) for channel in coat.color(white))
            return base, (r, g, b)
        if base.image is not None:
            self._warn(f"textures of coats over others are left out (first that of {name})")
            return base, white
        # One picture stands for both, as if the coat covered all.
        return coat, base.color(white)

    def _specular(self, material: Material, told: Told) -> Material:
        """Return it with that reflectance at right angles, and white at grazing ones."""
        if told.image is not None:
            self._warn(f"textures of specularColor are left out (first that of {material.name})")
        color = _shares(told.color(BLACK))
        highest = min(max(color), 0.9)
        if highest <= 0:
            return replace(material, specular_color=BLACK)
        root = math.sqrt(highest)
        r, g, b = (channel / highest for channel in color)
        return replace(material, ior=(1 + root) / (1 - root), specular_color=(min(r, 1.0), min(g, 1.0), min(b, 1.0)))

    def _glowing(self, material: Material, told: Told, surface: Any, model: SurfaceModel) -> Material:
        told_weight = self._told(surface, model, "emissionWeight")
        weight = self._mean(told_weight, model.names.get("emissionWeight", ""), model.emission, material.name)
        weight = max(weight, 0.0) / (LUMENS_PER_WATT if model.nits else 1.0)
        if told.image is not None:
            index, factor = self._reader.lights(told)
            return replace(material, emission=scaled(factor, weight), emission_texture=index if weight else -1)
        colors = [(told.attribute, lambda value: scaled(replace(told, value=value).color(model.emissive), weight))]
        emission, change = brightest(self._stage, colors, repeat=self._repeat)
        return replace(material, emission=emission, modulation=change)

    def _rough(self, material: Material, told: dict[str, Told], model: SurfaceModel) -> Material:
        """Return it with roughness and metalness, of which either may be a picture: both share one of ours."""
        rough, metal = told["roughness"], told["metallic"]
        roughness, metallic = _share(rough.number(model.roughness)), _share(metal.number(model.metallic))
        source = rough if rough.image is not None else metal
        if source.image is None:
            return replace(material, alpha=roughness**2, metallic=metallic)
        image = source.image

        def both() -> ImageTexture:
            green = rough.plain(rough.channel) if rough.image is not None else np.ones((1, 1))
            blue = metal.plain(metal.channel) if metal.image is not None else np.ones((1, 1))
            green, blue = same_size(green, blue)
            pixels = np.stack([green, green, blue, np.ones_like(green)], axis=-1) * 255.0 + 0.5
            return replace(image, pixels=pixels.astype(np.uint8), srgb=False)

        key = ("roughness", *((each.key, each.channel, each.scale, each.bias) for each in (rough, metal)))
        return replace(
            material,
            alpha=1.0 if rough.image is not None else roughness**2,
            metallic=1.0 if metal.image is not None else metallic,
            roughness_texture=self._reader.add(key, both),
        )

    def _opaque(self, material: Material, told: dict[str, Told], numbers: dict[str, float]) -> Material:
        opacity, threshold = told["opacity"], numbers["opacityThreshold"]
        way = numbers["alphaMode"]
        if way == _OPAQUE or (way == _CUT and threshold <= 0):
            return material
        threshold = 0.0 if way == _BLENDED else threshold
        share, texture = _share(opacity.number(1.0)), -1
        if opacity.image is not None:
            image = opacity.image

            def cut() -> ImageTexture:
                alpha = (opacity.plain(opacity.channel) * 255.0 + 0.5).astype(np.uint8)
                pixels = np.concatenate([image.pixels[..., :3], alpha[..., None]], axis=2)
                return replace(image, pixels=np.ascontiguousarray(pixels))

            texture = self._reader.add((*opacity.key, "opacity", opacity.channel, opacity.scale, opacity.bias), cut)
            share = 1.0
        elif share == 1.0:
            return material
        mode: dict[str, Any] = {"alpha_mode": "mask" if threshold > 0 else "blend"}
        return replace(material, opacity=share, opacity_texture=texture, alpha_cutoff=max(threshold, 0.0), **mode)


def _share(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def _shares(color: Vec3) -> Vec3:
    return _share(color[0]), _share(color[1]), _share(color[2])
