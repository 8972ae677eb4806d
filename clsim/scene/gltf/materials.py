"""glTF materials and textures (glTF 2.0, section 3.9, and the material extensions of Khronos)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from clsim.errors import InputError
from clsim.scene.gltf import material_schema as schema
from clsim.scene.gltf.accessors import EXTENSIONS, GltfFile
from clsim.scene.gltf.layers import reflected_by_film, roughness_between
from clsim.scene.gltf.light import LightTracks
from clsim.scene.meshes.geometry import flipped_v
from clsim.scene.pictures.images import U8, PixelBudget, decode_rgba, decode_srgb
from clsim.scene.world import ImageTexture, Material, Texture, Vec3, Wrap, scaled

WRAPS: dict[int, Wrap] = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
NEAREST = 9728
DEFAULT = schema.Material()
MIRROR_IOR = 1000.0
"""What stands for an index of 0, with which all is reflected as the specular colour says (KHR_materials_ior)."""
LEAST_ALPHA, LEAST_IOR = 0.001, 1.001
"""Disney's glass is never quite smooth, and denser than air."""


class MaterialReader:
    """Reads materials and the textures that they use, each image and each texture once.

    Attributes:
        materials: what was read so far, in order of first use.
        textures: likewise.
    """

    def __init__(self, file: GltfFile, light: LightTracks, warn: Callable[[str], None]) -> None:
        """Read from a file; ``light`` knows what changes, and ``warn`` takes what World cannot hold."""
        self.materials: list[Material] = []
        self.textures: list[Texture] = []
        self._file, self._light, self._warn = file, light, warn
        self._indices: dict[int | None, int] = {}
        self._texture_indices: dict[tuple[object, ...], int] = {}
        self._images: dict[int, U8] = {}
        self._budget = PixelBudget()

    def index(self, material: int | None) -> int:
        """Return the index into ``materials`` of one of the file's (None: the default)."""
        if material not in self._indices:
            self._indices[material] = len(self.materials)
            self.materials.append(self._read(material, self._source(material)))
        return self._indices[material]

    def texcoord(self, material: int | None) -> int:
        """Return which set of texture coordinates a material uses, its base colour's first."""
        for info in _textures(self._source(material)):
            return _set(info)
        return 0

    def is_textured(self, material: int | None) -> bool:
        """Tell whether a material has textures."""
        return bool(_textures(self._source(material)))

    def is_unlit(self, material: int | None) -> bool:
        """Tell whether a material shows its own colour, whatever the light."""
        return self._source(material).extensions.KHR_materials_unlit is not None

    def _source(self, material: int | None) -> schema.Material:
        return DEFAULT if material is None else self._file.item("materials", self._file.json.materials, material)

    def _read(self, index: int | None, source: schema.Material) -> Material:
        extra, core = source.extensions, source.pbrMetallicRoughness
        name = source.name or "a material"
        for extension in sorted(set(extra.model_extra or {}) - set(EXTENSIONS)):
            self._warn(f"the extension {extension} of materials is left out")
        for feature, info in (
            ("thickness", extra.KHR_materials_volume.thicknessTexture),
            ("clearcoat normal", extra.KHR_materials_clearcoat.clearcoatNormalTexture),
        ):
            if info is not None:
                self._warn(f"{feature} textures are left out (the first is that of {name})")
        if len({_set(info) for info in _textures(source)}) > 1:
            self._warn(f"all textures of a material use the texture coordinates of the first ({name} has several)")
        base_factor, base_info = core.baseColorFactor, core.baseColorTexture
        metallic, roughness = core.metallicFactor, core.roughnessFactor
        glossy = extra.KHR_materials_pbrSpecularGlossiness
        if glossy is not None:
            self._warn("materials of specular and glossiness are read as metallic-roughness with no metal")
            base_factor, base_info = glossy.diffuseFactor, glossy.diffuseTexture
            metallic = 0.0
        base = self._texture(base_info, srgb=True)
        blends = source.alphaMode != "OPAQUE"
        emissive = self._texture(source.emissiveTexture, srgb=True)
        strength = extra.KHR_materials_emissive_strength.emissiveStrength
        emission, modulation = self._light.surface(-1 if index is None else index, source.emissiveFactor, strength)
        color: Vec3 = base_factor[:3]
        if extra.KHR_materials_unlit is not None:  # its colour is what is seen, whatever the light
            emission, emissive, color, base_texture = color, base, (0.0, 0.0, 0.0), -1
            modulation = None
            metallic, roughness = 0.0, 1.0
        else:
            base_texture = base
        specular, coat = extra.KHR_materials_specular, extra.KHR_materials_clearcoat
        coated = self._mean("clearcoat", coat.clearcoatTexture, name)[0]
        coat_roughness = self._mean("clearcoat roughness", coat.clearcoatRoughnessTexture, name)[1]
        passed = extra.KHR_materials_transmission
        strength_of_lobe = specular.specularFactor * self._mean("specular", specular.specularTexture, name)[3]
        tint = self._mean("specular colour", specular.specularColorTexture, name, srgb=True)
        r, g, b = (factor * mean for factor, mean in zip(specular.specularColorFactor, tint, strict=False))
        lobe = scaled((r, g, b), strength_of_lobe)
        if extra.KHR_materials_unlit is not None:
            lobe = (0.0, 0.0, 0.0)
        ior = extra.KHR_materials_ior.ior
        material = Material(
            kind="principled",
            color=color,
            texture=base_texture,
            emission=emission,
            emission_texture=emissive,
            modulation=modulation,
            emits_behind=source.doubleSided,
            back="same" if source.doubleSided else "culled",
            alpha=roughness**2,
            roughness_texture=self._texture(core.metallicRoughnessTexture, srgb=False),
            metallic=metallic,
            ior=MIRROR_IOR if ior == 0.0 else ior if ior >= 1.0 else 1.5,
            specular_color=lobe,
            transmission=passed.transmissionFactor * self._mean("transmission", passed.transmissionTexture, name)[0],
            clearcoat=coat.clearcoatFactor * coated,
            clearcoat_alpha=(coat.clearcoatRoughnessFactor * coat_roughness) ** 2,
            normal_texture=self._texture(source.normalTexture, srgb=False),
            normal_scale=1.0 if source.normalTexture is None else source.normalTexture.scale,
            alpha_mode={"OPAQUE": "opaque", "MASK": "mask", "BLEND": "blend"}[source.alphaMode],  # type: ignore[arg-type]
            alpha_cutoff=source.alphaCutoff,
            opacity=base_factor[3] if blends else 1.0,
            opacity_texture=base if blends else -1,
            name=source.name,
        )
        if glossy is not None and extra.KHR_materials_unlit is None:
            material = self._glossy(material, glossy, name)
        return _solid(self._under_layers(material, extra, name), extra.KHR_materials_volume)

    def _glossy(self, material: Material, glossy: schema.SpecularGlossiness, name: str) -> Material:
        """Return a material that reflects straight on what the specular colour says, as metals of such files do."""
        texture = glossy.specularGlossinessTexture
        *tint, gloss = self._mean("specular and glossiness", texture, name, srgb=True)
        r, g, b = (factor * mean for factor, mean in zip(glossy.specularFactor, tint, strict=True))
        alpha = (1.0 - glossy.glossinessFactor * gloss) ** 2
        return replace(material, alpha=alpha, ior=MIRROR_IOR, specular_color=(r, g, b))

    def _under_layers(self, material: Material, extra: schema.MaterialExtensions, name: str) -> Material:
        """Return a material as it looks under layers that clsim has not, told once."""
        brushed, film = extra.KHR_materials_anisotropy, extra.KHR_materials_iridescence
        if brushed is not None and brushed.anisotropyStrength > 0:
            self._warn(f"the mean of roughness along and across stands in for anisotropy (the first is that of {name})")
            strength = brushed.anisotropyStrength * self._mean("anisotropy", brushed.anisotropyTexture, name)[2]
            material = replace(material, alpha=roughness_between(material.alpha, strength))
        if film is None or film.iridescenceFactor == 0:
            return material
        self._warn(f"films have the colour that they have seen from above (the first is that of {name})")
        share = film.iridescenceFactor * self._mean("iridescence", film.iridescenceTexture, name)[0]
        thin, thick = film.iridescenceThicknessMinimum, film.iridescenceThicknessMaximum
        filled = self._mean("iridescence thickness", film.iridescenceThicknessTexture, name)[1]
        seen = share, film.iridescenceIor, thin + (thick - thin) * filled
        bare = ((material.ior - 1.0) / (material.ior + 1.0)) ** 2
        r, g, b = reflected_by_film((bare, bare, bare), *seen)
        # What passes light keeps its index of refraction, whatever it reflects.
        highest = bare if material.transmission > 0 else min(max(r, g, b, 1e-6), 0.9)
        x, y, z = material.specular_color
        root = math.sqrt(highest)
        return replace(
            material,
            color=_mixed(material.color, reflected_by_film(material.color, *seen), material.metallic),
            ior=(1.0 + root) / (1.0 - root),
            specular_color=(x * min(r / highest, 1.0), y * min(g / highest, 1.0), z * min(b / highest, 1.0)),
        )

    def _mean(
        self, feature: str, info: schema.TextureInfo | None, name: str, *, srgb: bool = False
    ) -> tuple[float, float, float, float]:
        """Return the mean of a texture that stands in for it, R, G, B, A from 0 to 1; 1 where there is none."""
        source = None if info is None else self._image_of(info)
        if source is None:
            return (1.0, 1.0, 1.0, 1.0)
        self._warn(f"the mean of {feature} textures stands in for them (the first is that of {name})")
        values = self._image(source).reshape(-1, 4) / 255.0
        if srgb:
            values[:, :3] = decode_srgb(values[:, :3])
        red, green, blue, alpha = values.mean(axis=0).tolist()
        return red, green, blue, alpha

    def _image_of(self, info: schema.TextureInfo) -> int | None:
        """Return the number of a texture's image; None, with a warning, where clsim cannot read it."""
        texture = self._file.item("textures", self._file.json.textures, info.index)
        webp = texture.extensions.EXT_texture_webp
        source = texture.source if webp is None else webp.source
        if source is None:
            self._warn(f"textures[{info.index}] has no image that clsim reads and is left out")
        return source

    def _texture(self, info: schema.TextureInfo | None, *, srgb: bool) -> int:
        """Return the index into ``textures``, -1 for none."""
        if info is None:
            return -1
        json = self._file.json
        source = self._image_of(info)
        if source is None:
            return -1
        texture = self._file.item("textures", json.textures, info.index)
        sampler = schema.Sampler()
        if texture.sampler is not None:
            sampler = self._file.item("samplers", json.samplers, texture.sampler)
        transform = info.extensions.KHR_texture_transform
        key = (source, srgb, sampler, transform)
        if key not in self._texture_indices:
            pixels = self._image(source)
            self._texture_indices[key] = len(self.textures)
            self.textures.append(
                ImageTexture(
                    pixels,
                    srgb=srgb,
                    wrap_u=WRAPS[sampler.wrapS],
                    wrap_v=WRAPS[sampler.wrapT],
                    nearest=sampler.magFilter == NEAREST,
                    uv_matrix=_uv_matrix(transform),
                )
            )
        return self._texture_indices[key]

    def _image(self, index: int) -> U8:
        if index not in self._images:
            image = self._file.item("images", self._file.json.images, index)
            source = f"{self._file.path}: images[{index}]"
            if image.uri is not None:
                data = self._file.uri_bytes(f"images[{index}]", image.uri)
            elif image.bufferView is not None:
                data = bytes(self._file.view(image.bufferView))
            else:
                raise InputError(f"{source} has neither uri nor bufferView")
            self._images[index] = decode_rgba(source, data, self._budget)
        return self._images[index]


def _solid(material: Material, volume: schema.Volume) -> Material:
    """Return glass that has an inside, where its thickness says so: it refracts, and dims light on its way within.

    Its colour tints light once on the way in and out (KHR_materials_volume). Of a texture's the root is Disney's alone.
    """
    if volume.thicknessFactor == 0 or material.transmission == 0:
        return material
    r, g, b = (
        -math.log(min(max(channel, 1e-6), 1.0)) / volume.attenuationDistance if volume.attenuationDistance else 0.0
        for channel in volume.attenuationColor
    )
    solid = replace(material, absorption=(r, g, b))
    if material.transmission == 1 and material.metallic == 0 and material.texture < 0:
        x, y, z = (math.sqrt(channel) for channel in material.color)
        return replace(solid, kind="dielectric", color=(x, y, z))
    return replace(solid, kind="disney", alpha=max(material.alpha, LEAST_ALPHA), ior=max(material.ior, LEAST_IOR))


def _textures(source: schema.Material) -> list[schema.TextureInfo]:
    core, glossy = source.pbrMetallicRoughness, source.extensions.KHR_materials_pbrSpecularGlossiness
    infos = [
        core.baseColorTexture,
        None if glossy is None else glossy.diffuseTexture,
        core.metallicRoughnessTexture,
        source.normalTexture,
        source.emissiveTexture,
    ]
    return [info for info in infos if info is not None]


def _set(info: schema.TextureInfo) -> int:
    transform = info.extensions.KHR_texture_transform
    return info.texCoord if transform is None or transform.texCoord is None else transform.texCoord


def _mixed(color: Vec3, other: Vec3, share: float) -> Vec3:
    r, g, b = (one + (two - one) * share for one, two in zip(color, other, strict=True))
    return r, g, b


def _uv_matrix(transform: schema.TextureTransform | None) -> tuple[Vec3, Vec3]:
    """Return KHR_texture_transform for coordinates whose v points up; the file's points down."""
    if transform is None:
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    c, s = math.cos(transform.rotation), math.sin(transform.rotation)
    (sx, sy), (x, y) = transform.scale, transform.offset
    down = np.array([[c * sx, s * sy, x], [-s * sx, c * sy, y], [0.0, 0.0, 1.0]])
    return flipped_v(down)
