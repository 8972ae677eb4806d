"""What a glTF file's JSON may hold of images, textures and materials (glTF 2.0, section 5, and Khronos' extensions)."""

# ruff: noqa: N815 (names are those of the file format)

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def _one(value: Any) -> Any:
    """Return 1 for what an exporter's rounding put just above it."""
    return 1.0 if isinstance(value, float) and 1.0 < value < 1.00001 else value


Index = Annotated[int, Field(ge=0)]
Share = Annotated[float, BeforeValidator(_one), Field(ge=0, le=1)]
NonNegative = Annotated[float, Field(ge=0)]
AtLeastOne = Annotated[float, Field(ge=1)]
Color = tuple[NonNegative, NonNegative, NonNegative]
Vector = tuple[float, float, float]


class Part(BaseModel):
    """An object of the file."""

    model_config = ConfigDict(extra="ignore", strict=True, frozen=True, allow_inf_nan=False)


class Image(Part):
    """A PNG or JPEG: a file, a data URI, or a buffer view."""

    uri: str | None = None
    bufferView: Index | None = None


class Sampler(Part):
    """How a texture is read."""

    magFilter: int | None = None
    wrapS: Literal[33071, 33648, 10497] = 10497
    wrapT: Literal[33071, 33648, 10497] = 10497


class WebpSource(Part):
    """A texture's image in WebP."""

    source: Index


class TextureExtensions(Part):
    """Extensions of a texture."""

    EXT_texture_webp: WebpSource | None = None


class Texture(Part):
    """An image and its sampler."""

    source: Index | None = None
    sampler: Index | None = None
    extensions: TextureExtensions = TextureExtensions()


class TextureTransform(Part):
    """KHR_texture_transform."""

    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)
    texCoord: Index | None = None


class TextureInfoExtensions(Part):
    """Extensions of a texture's use."""

    KHR_texture_transform: TextureTransform | None = None


class TextureInfo(Part):
    """A texture's use in a material."""

    index: Index
    texCoord: Index = 0
    scale: float = 1.0
    extensions: TextureInfoExtensions = TextureInfoExtensions()


class MetallicRoughness(Part):
    """The core material."""

    baseColorFactor: tuple[Share, Share, Share, Share] = (1.0, 1.0, 1.0, 1.0)
    baseColorTexture: TextureInfo | None = None
    metallicFactor: Share = 1.0
    roughnessFactor: Share = 1.0
    metallicRoughnessTexture: TextureInfo | None = None


class SpecularGlossiness(Part):
    """KHR_materials_pbrSpecularGlossiness: what materials had before metalness."""

    diffuseFactor: tuple[Share, Share, Share, Share] = (1.0, 1.0, 1.0, 1.0)
    diffuseTexture: TextureInfo | None = None
    specularFactor: tuple[Share, Share, Share] = (1.0, 1.0, 1.0)
    glossinessFactor: Share = 1.0
    specularGlossinessTexture: TextureInfo | None = None


class EmissiveStrength(Part):
    """KHR_materials_emissive_strength."""

    emissiveStrength: NonNegative = 1.0


class Ior(Part):
    """KHR_materials_ior."""

    ior: NonNegative = 1.5


class Transmission(Part):
    """KHR_materials_transmission."""

    transmissionFactor: Share = 0.0
    transmissionTexture: TextureInfo | None = None


class Volume(Part):
    """KHR_materials_volume."""

    thicknessFactor: NonNegative = 0.0
    thicknessTexture: TextureInfo | None = None
    attenuationDistance: NonNegative | None = None
    attenuationColor: Color = (1.0, 1.0, 1.0)


class Clearcoat(Part):
    """KHR_materials_clearcoat."""

    clearcoatFactor: Share = 0.0
    clearcoatTexture: TextureInfo | None = None
    clearcoatRoughnessFactor: Share = 0.0
    clearcoatRoughnessTexture: TextureInfo | None = None
    clearcoatNormalTexture: TextureInfo | None = None


class Specular(Part):
    """KHR_materials_specular."""

    specularFactor: Share = 1.0
    specularTexture: TextureInfo | None = None
    specularColorFactor: Color = (1.0, 1.0, 1.0)
    specularColorTexture: TextureInfo | None = None


class Anisotropy(Part):
    """KHR_materials_anisotropy."""

    anisotropyStrength: Share = 0.0
    anisotropyTexture: TextureInfo | None = None


class Iridescence(Part):
    """KHR_materials_iridescence."""

    iridescenceFactor: Share = 0.0
    iridescenceTexture: TextureInfo | None = None
    iridescenceIor: AtLeastOne = 1.3
    iridescenceThicknessMaximum: NonNegative = 400.0
    iridescenceThicknessTexture: TextureInfo | None = None
    iridescenceThicknessMinimum: NonNegative = 100.0


class Unlit(Part):
    """KHR_materials_unlit."""


class MaterialExtensions(Part):
    """Extensions of a material; those that clsim lacks are kept to be named."""

    model_config = ConfigDict(extra="allow")

    KHR_materials_emissive_strength: EmissiveStrength = EmissiveStrength()
    KHR_materials_ior: Ior = Ior()
    KHR_materials_transmission: Transmission = Transmission()
    KHR_materials_volume: Volume = Volume()
    KHR_materials_clearcoat: Clearcoat = Clearcoat()
    KHR_materials_specular: Specular = Specular()
    KHR_materials_pbrSpecularGlossiness: SpecularGlossiness | None = None
    KHR_materials_anisotropy: Anisotropy | None = None
    KHR_materials_iridescence: Iridescence | None = None
    KHR_materials_unlit: Unlit | None = None


class Material(Part):
    """A surface."""

    name: str = ""
    pbrMetallicRoughness: MetallicRoughness = MetallicRoughness()
    normalTexture: TextureInfo | None = None
    emissiveFactor: Color = (0.0, 0.0, 0.0)
    emissiveTexture: TextureInfo | None = None
    alphaMode: Literal["OPAQUE", "MASK", "BLEND"] = "OPAQUE"
    alphaCutoff: NonNegative = 0.5
    doubleSided: bool = False
    extensions: MaterialExtensions = MaterialExtensions()
