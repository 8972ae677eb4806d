"""A glTF file's JSON, read and checked before anything is loaded from it.

The checks keep a hostile file from the network, from other folders, and from claiming far more memory than it has
bytes. Names and sizes are those of the glTF 2.0 specification, sections 3 and 4.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from clsim.errors import InputError
from clsim.scene.files import inside_folder

COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MAX_NODES = 100_000
MAX_INSTANCES = 100_000
"""Most primitives, and most primitives times the nodes that show them: few bytes could ask for billions."""
KNOWN_EXTENSIONS = ("KHR_lights_punctual", "KHR_texture_transform")
"""Extensions that a file may require: those that only change what is told to the user as a warning."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True)


class _Buffer(_Part):
    byteLength: int = Field(ge=0)  # noqa: N815 (the specification's spelling, here and below)
    uri: str | None = None


class _View(_Part):
    buffer: int = Field(ge=0)
    byteOffset: int = Field(0, ge=0)  # noqa: N815
    byteLength: int = Field(ge=0)  # noqa: N815
    byteStride: int | None = Field(None, ge=4, le=252)  # noqa: N815


class _Accessor(_Part):
    bufferView: int | None = Field(None, ge=0)  # noqa: N815
    byteOffset: int = Field(0, ge=0)  # noqa: N815
    componentType: int  # noqa: N815
    count: int = Field(ge=0)
    type: str
    sparse: dict[str, Any] | None = None

    def bytes_each(self) -> int:
        return COMPONENT_BYTES.get(self.componentType, 4) * COMPONENTS.get(self.type, 16)


class _Primitive(_Part):
    attributes: dict[str, int]
    indices: int | None = Field(None, ge=0)


class _Mesh(_Part):
    primitives: list[_Primitive]


class _Node(_Part):
    children: list[int] = []
    mesh: int | None = Field(None, ge=0)


class _Image(_Part):
    uri: str | None = None


class _Header(_Part):
    buffers: list[_Buffer] = []
    bufferViews: list[_View] = []  # noqa: N815
    accessors: list[_Accessor] = []
    meshes: list[_Mesh] = []
    nodes: list[_Node] = Field([], max_length=MAX_NODES)
    images: list[_Image] = []
    extensionsRequired: list[str] = []  # noqa: N815


def check_gltf(path: Path, data: bytes) -> list[str]:
    """Check the contents of a ``.gltf`` or ``.glb`` and return what it asks for that clsim lacks, one sentence each.

    Raises:
        InputError: if it is damaged, points elsewhere, or claims more memory than its size justifies.
    """
    header, chunk = _json(path, data)
    try:
        parts = _Header.model_validate(header)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"]) or "its JSON"
        raise InputError(f"{path}: {place}: {first['msg']}, got {repr(first['input'])[:60]}") from None
    missing = [name for name in parts.extensionsRequired if not _known(name)]
    if missing:
        raise InputError(f"{path}: requires the glTF extension {', '.join(missing)}, which clsim does not support")
    total = len(data)
    for i, buffer in enumerate(parts.buffers):
        size = chunk if buffer.uri is None else _uri_bytes(path, f"buffers[{i}]", buffer.uri, needed=True)
        if size < buffer.byteLength:
            raise InputError(
                f"{path}: buffers[{i}] has {size} bytes, expected {buffer.byteLength}: the file is truncated"
            )
        total += size if buffer.uri is not None else 0
    for i, image in enumerate(parts.images):
        if image.uri is not None:
            total += _uri_bytes(path, f"images[{i}]", image.uri, needed=False)
    _check_sizes(path, parts, limit=16 * total + (64 << 20))
    _check_tree(path, parts)
    return _lacking(path, header)


def _json(path: Path, data: bytes) -> tuple[dict[str, Any], int]:
    """Return the JSON and the size of the binary chunk [bytes]."""
    chunk = 0
    text = data
    if path.suffix.lower() == ".glb":
        if len(data) < 20 or data[:4] != b"glTF":
            raise InputError(f"{path}: is not a binary glTF file (it does not start with a glTF header)")
        version, length, text_length, kind = struct.unpack_from("<4xIIII", data)
        if version != 2 or kind != 0x4E4F534A:
            raise InputError(f"{path}: is glTF version {version}, expected 2 with its JSON first")
        if length > len(data) or 20 + text_length > len(data):
            raise InputError(
                f"{path}: has {len(data)} bytes, expected {max(length, 20 + text_length)}: it is truncated"
            )
        text = data[20 : 20 + text_length]
        if len(data) >= 28 + text_length:
            chunk = struct.unpack_from("<I", data, 20 + text_length)[0]
            if 28 + text_length + chunk > len(data):
                raise InputError(f"{path}: its binary chunk claims {chunk} bytes, more than there are: it is truncated")
    try:
        header = json.loads(text.decode(), parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: its JSON cannot be read ({error})") from None
    if not isinstance(header, dict):
        raise InputError(f"{path}: its JSON is a {type(header).__name__}, expected an object")
    return header, chunk


def _refuse_constant(text: str) -> None:
    raise ValueError(f"{text} is not a number that glTF allows")


def _uri_bytes(path: Path, place: str, uri: str, *, needed: bool) -> int:
    """Return how many bytes an URI stands for; a missing image counts as none."""
    if uri.startswith("data:"):
        return len(uri) * 3 // 4
    try:
        file = path.parent / inside_folder(uri, path.parent)
    except InputError as error:
        raise InputError(f"{path}: {place}.uri: {error}") from None
    if not file.is_file():
        if needed:
            raise InputError(f"{path}: {place}.uri: the file {uri!r} is missing")
        return 0
    return file.stat().st_size


def _check_sizes(path: Path, parts: _Header, limit: int) -> None:
    for i, view in enumerate(parts.bufferViews):
        if view.buffer >= len(parts.buffers):
            raise InputError(f"{path}: bufferViews[{i}] uses buffer {view.buffer}, of {len(parts.buffers)}")
        if view.byteOffset + view.byteLength > parts.buffers[view.buffer].byteLength:
            raise InputError(f"{path}: bufferViews[{i}] ends after its buffer")
    for i, accessor in enumerate(parts.accessors):
        if accessor.componentType not in COMPONENT_BYTES or accessor.type not in COMPONENTS:
            raise InputError(f"{path}: accessors[{i}] has type {accessor.type} of {accessor.componentType}, unknown")
        if accessor.sparse is not None:
            raise InputError(f"{path}: accessors[{i}] is sparse, which clsim does not support")
        if accessor.bufferView is None:
            continue
        if accessor.bufferView >= len(parts.bufferViews):
            raise InputError(f"{path}: accessors[{i}] uses bufferView {accessor.bufferView}, which does not exist")
        view, each = parts.bufferViews[accessor.bufferView], accessor.bytes_each()
        stride = view.byteStride or each
        end = accessor.byteOffset + (accessor.count - 1) * stride + each
        if accessor.count and (stride < each or end > view.byteLength):
            raise InputError(f"{path}: accessors[{i}] ends at byte {end} of its bufferView's {view.byteLength}")
    shown = [mesh.primitives for mesh in parts.meshes]
    placed = sum(len(shown[n.mesh]) for n in parts.nodes if n.mesh is not None and n.mesh < len(shown))
    if max(placed, sum(map(len, shown))) > MAX_INSTANCES:
        raise InputError(f"{path}: its nodes show more than {MAX_INSTANCES} primitives, expected fewer")
    views = sum(view.byteLength for view in parts.bufferViews)
    accessors = sum(accessor.count * accessor.bytes_each() for accessor in parts.accessors)
    used = 0
    for m, mesh in enumerate(parts.meshes):
        for primitive in mesh.primitives:
            for index in [*primitive.attributes.values(), *([] if primitive.indices is None else [primitive.indices])]:
                if not 0 <= index < len(parts.accessors):
                    raise InputError(f"{path}: meshes[{m}] uses accessor {index}, which does not exist")
                used += parts.accessors[index].count * parts.accessors[index].bytes_each()
    if max(views, accessors, used) > limit:
        raise InputError(
            f"{path}: its meshes claim {max(views, accessors, used)} bytes, "
            f"more than {limit}, which is what a file of its size may claim"
        )


def _check_tree(path: Path, parts: _Header) -> None:
    """Check that nodes form trees: several parents could blow up to any number of instances."""
    parent: dict[int, int] = {}
    for i, node in enumerate(parts.nodes):
        for child in node.children:
            if not 0 <= child < len(parts.nodes) or child in parent:
                raise InputError(f"{path}: nodes[{i}] has child {child}, expected an existing node of no other parent")
            parent[child] = i
        if node.mesh is not None and node.mesh >= len(parts.meshes):
            raise InputError(f"{path}: nodes[{i}] uses mesh {node.mesh}, of {len(parts.meshes)}")
    for i in range(len(parts.nodes)):
        seen, node_index = 0, i
        while node_index in parent and seen <= 1000:
            node_index, seen = parent[node_index], seen + 1
        if seen > 1000:
            raise InputError(f"{path}: nodes[{i}] is its own ancestor or lies more than 1000 levels deep")


def _known(extension: str) -> bool:
    return extension in KNOWN_EXTENSIONS or extension.startswith("KHR_materials_")


def _lacking(path: Path, header: dict[str, Any]) -> list[str]:
    lacking = []
    for key, text in (
        ("animations", "its animations are not played"),
        ("skins", "its skins stay in the pose of rest"),
        ("cameras", "its cameras are not used; the camera orbits instead"),
    ):
        if header.get(key):
            lacking.append(f"{path.name}: {text}")
    used = header.get("extensionsUsed")
    if isinstance(used, list) and "KHR_lights_punctual" in used:
        lacking.append(f"{path.name}: its lights are not used; a default lamp stands in")
    return lacking
