"""What a glTF file's JSON may hold, in the specification's own spelling (glTF 2.0, section 5).

Only what clsim reads stands here; anything else in the file is ignored. Wrong types, NaN and infinities are errors.
"""

# ruff: noqa: N815, RUF012 (names are those of the file format; pydantic copies defaults)

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from clsim.scene.gltf.material_schema import (
    Color,
    Image,
    Index,
    Material,
    NonNegative,
    Part,
    Sampler,
    Texture,
    Vector,
)

MAX_NODES = 100_000


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


class Copies(Part):
    """EXT_mesh_gpu_instancing: accessors of where copies of a node's mesh stand."""

    attributes: dict[str, Index]


class Visibility(Part):
    """KHR_node_visibility: whether a node and all below it is seen."""

    visible: bool = True


class NodeExtensions(Part):
    """Extensions of a node."""

    KHR_node_visibility: Visibility = Visibility()
    EXT_mesh_gpu_instancing: Copies | None = None
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


class Pointer(Part):
    """KHR_animation_pointer: what of the file a channel changes."""

    pointer: str


class TargetExtensions(Part):
    """Extensions of a target."""

    KHR_animation_pointer: Pointer | None = None


class Target(Part):
    """What a channel moves."""

    node: Index | None = None
    path: str
    extensions: TargetExtensions = TargetExtensions()


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


class Orthographic(Part):
    """A camera without vanishing points: half of the width and of the height of what it sees."""

    xmag: float
    ymag: float


class Camera(Part):
    """A camera."""

    type: str
    perspective: Perspective | None = None
    orthographic: Orthographic | None = None


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
    range: float | None = None
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
