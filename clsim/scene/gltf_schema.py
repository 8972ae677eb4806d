"""What a glTF file's JSON may hold, in the specification's own spelling (glTF 2.0, section 5).

Only what clsim reads stands here; anything else in the file is ignored. Wrong types, NaN and infinities are errors.
"""

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
Color = tuple[NonNegative, NonNegative, NonNegative]
Vector = tuple[float, float, float]
MAX_NODES = 100_000


class Part(BaseModel):
    """An object of the file."""

    model_config = ConfigDict(extra="ignore", strict=True, frozen=True, allow_inf_nan=False)


class Buffer(Part):
    """Raw bytes: the binary chunk where there is no uri."""

    byteLength: Index
    uri: str | None = None


class BufferView(Part):
    """A range of a buffer."""

    buffer: Index
    byteOffset: Index = 0
    byteLength: Index
    byteStride: Annotated[int, Field(ge=4, le=252)] | None = None


class SparseIndices(Part):
    """Which elements of an accessor are replaced."""

    bufferView: Index
    byteOffset: Index = 0
    componentType: Literal[5121, 5123, 5125]


class SparseValues(Part):
    """What they are replaced with."""

    bufferView: Index
    byteOffset: Index = 0


class Sparse(Part):
    """Replaced elements of an accessor."""

    count: Index
    indices: SparseIndices
    values: SparseValues


class Accessor(Part):
    """An array in a buffer view; zeros where there is none."""

    bufferView: Index | None = None
    byteOffset: Index = 0
    componentType: Literal[5120, 5121, 5122, 5123, 5125, 5126]
    normalized: bool = False
    count: Index
    type: Literal["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"]
    sparse: Sparse | None = None


class Draco(Part):
    """KHR_draco_mesh_compression: the compressed bytes, and which of their attributes is which."""

    bufferView: Index
    attributes: dict[str, Index]


class PrimitiveExtensions(Part):
    """Extensions of a primitive."""

    KHR_draco_mesh_compression: Draco | None = None


class Primitive(Part):
    """Triangles (or points and lines) of one material."""

    attributes: dict[str, Index]
    indices: Index | None = None
    material: Index | None = None
    mode: Annotated[int, Field(ge=0, le=6)] = 4
    targets: list[dict[str, Index]] = []
    extensions: PrimitiveExtensions = PrimitiveExtensions()


class Mesh(Part):
    """Primitives that stand together."""

    name: str = ""
    primitives: Annotated[list[Primitive], Field(min_length=1)]
    weights: list[float] = []


class LightReference(Part):
    """Which light stands at a node."""

    light: Index


class NodeExtensions(Part):
    """Extensions of a node."""

    KHR_lights_punctual: LightReference | None = None


class Node(Part):
    """A place in the tree."""

    name: str = ""
    children: list[Index] = []
    mesh: Index | None = None
    skin: Index | None = None
    camera: Index | None = None
    matrix: Annotated[list[float], Field(min_length=16, max_length=16)] | None = None
    translation: Vector | None = None
    rotation: tuple[float, float, float, float] | None = None
    scale: Vector | None = None
    weights: list[float] = []
    extensions: NodeExtensions = NodeExtensions()


class Scene(Part):
    """Which nodes are roots."""

    nodes: list[Index] = []


class Skin(Part):
    """Joints that pull vertices along."""

    joints: Annotated[list[Index], Field(min_length=1)]
    inverseBindMatrices: Index | None = None


class Target(Part):
    """What a channel moves."""

    node: Index | None = None
    path: str


class Channel(Part):
    """A sampler joined to a node."""

    sampler: Index
    target: Target


class AnimationSampler(Part):
    """Keyframes: accessors of times and values."""

    input: Index
    output: Index
    interpolation: Literal["LINEAR", "STEP", "CUBICSPLINE"] = "LINEAR"


class Animation(Part):
    """Channels that play together."""

    name: str = ""
    channels: list[Channel]
    samplers: list[AnimationSampler]


class Perspective(Part):
    """A perspective camera's numbers."""

    yfov: Annotated[float, Field(gt=0, lt=3.1415)]
    aspectRatio: Annotated[float, Field(gt=0)] | None = None


class Camera(Part):
    """A camera."""

    type: str
    perspective: Perspective | None = None


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
    glossinessFactor: Share = 1.0


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


class Unlit(Part):
    """KHR_materials_unlit."""


class MaterialExtensions(Part):
    """Extensions of a material; those that clsim lacks are kept to be named."""

    model_config = ConfigDict(extra="allow")

    KHR_materials_emissive_strength: EmissiveStrength = EmissiveStrength()
    KHR_materials_ior: Ior = Ior()
    KHR_materials_transmission: Transmission = Transmission()
    KHR_materials_clearcoat: Clearcoat = Clearcoat()
    KHR_materials_specular: Specular = Specular()
    KHR_materials_pbrSpecularGlossiness: SpecularGlossiness | None = None
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


class Spot(Part):
    """A spot's cone."""

    innerConeAngle: NonNegative = 0.0
    outerConeAngle: Annotated[float, Field(gt=0, le=1.5708)] = 0.7853981633974483


class Light(Part):
    """KHR_lights_punctual: candela for points and spots, lux for directional lights."""

    name: str = ""
    type: Literal["point", "spot", "directional"]
    color: Color = (1.0, 1.0, 1.0)
    intensity: NonNegative = 1.0
    spot: Spot = Spot()


class Lights(Part):
    """All lights of a file."""

    lights: list[Light] = []


class FileExtensions(Part):
    """Extensions of the file as a whole."""

    KHR_lights_punctual: Lights = Lights()


class Gltf(Part):
    """A whole file."""

    scene: Index | None = None
    scenes: list[Scene] = []
    nodes: Annotated[list[Node], Field(max_length=MAX_NODES)] = []
    meshes: list[Mesh] = []
    skins: list[Skin] = []
    animations: list[Animation] = []
    cameras: list[Camera] = []
    materials: list[Material] = []
    textures: list[Texture] = []
    samplers: list[Sampler] = []
    images: list[Image] = []
    accessors: list[Accessor] = []
    bufferViews: list[BufferView] = []
    buffers: list[Buffer] = []
    extensions: FileExtensions = FileExtensions()
    extensionsUsed: list[str] = []
    extensionsRequired: list[str] = []
