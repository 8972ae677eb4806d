"""A glTF file's bytes: the JSON checked, buffers found, accessors decoded (glTF 2.0, sections 3.6 and 4.4).

Nothing is read from outside the file's folder, and nothing decoded that the file's size does not justify.
"""

from __future__ import annotations

import base64
import binascii
import codecs
import json
import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from clsim.errors import InputError
from clsim.scene.files import asset_file
from clsim.scene.gltf import schema
from clsim.scene.wording import plainly

DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
EXTENSIONS = (
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_transform",
)
"""The extensions that clsim reads; a file may also require others of materials, which only look plainer then."""
HARMLESS = re.compile("KHR_(materials_|xmp)|EXT_(structural_metadata|mesh_features|texture_avif)|MSFT_texture_dds")
"""Optional extensions of which nothing is to be said: materials tell themselves, others change nothing that is seen."""
UNPACKED_BY = {
    "EXT_meshopt_compression": "gltfpack -i IN -o OUT",
    "KHR_meshopt_compression": "gltfpack -i IN -o OUT",
    "KHR_texture_basisu": "gltf-transform ktxdecompress IN OUT",
}
"""What unpacks what clsim does not."""
MAX_FILE_BYTES = 1 << 30
Item = TypeVar("Item")
Array = npt.NDArray[Any]


class GltfFile:
    """A checked glTF file.

    Attributes:
        path: where it lies.
        json: its contents.
        decode_limit: how many bytes of arrays the file may make of itself.
    """

    def __init__(self, path: Path) -> None:
        """Read and check a ``.gltf`` or ``.glb``.

        Raises:
            InputError: if it is damaged or requires an extension that clsim lacks.
        """
        self.path = path
        data = read_bytes(path)
        text, self._chunk = _split(path, data)
        text = text.removeprefix(codecs.BOM_UTF8).rstrip(b"\0")  # with which some fill up, in place of spaces
        try:
            self.json = schema.Gltf.model_validate_json(text)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(str(part) for part in first["loc"]) or "its JSON"
            if first["type"] != "json_invalid" and _version(text).startswith("1"):
                raise InputError(f"{path}: is glTF {_version(text)}, expected 2.0") from None
            got = "" if first["type"] in ("json_invalid", "missing") else f", got {repr(first['input'])[:60]}"
            raise InputError(f"{path}: {place}: {plainly(first)}{got}") from None
        lacking = [e for e in self.json.extensionsRequired if e not in EXTENSIONS and not _optional(e)]
        if lacking:
            tools = dict.fromkeys(UNPACKED_BY[name] for name in lacking if name in UNPACKED_BY)
            advice = f"; {' and '.join(tools)} unpacks it" if tools else ""
            names = ", ".join(lacking)
            raise InputError(f"{path}: requires the glTF extension {names}, which clsim does not support{advice}")
        self._buffers: dict[int, memoryview] = {}
        self._decoded: dict[int, Array] = {}
        sizes = [len(data)]
        sizes += [self._outside_bytes(f"buffers[{i}]", buffer.uri) for i, buffer in enumerate(self.json.buffers)]
        sizes += [self._outside_bytes(f"images[{i}]", image.uri) for i, image in enumerate(self.json.images)]
        self.decode_limit = 16 * sum(sizes) + (64 << 20)
        self._decoded_bytes = 0

    def unknown(self) -> list[str]:
        """Return which extensions the file uses that clsim neither reads nor can do without."""
        used = set(self.json.extensionsUsed) - set(EXTENSIONS) - set(UNPACKED_BY)
        return sorted(name for name in used if not HARMLESS.match(name))

    def item(self, kind: str, items: Sequence[Item], index: int) -> Item:
        """Return one of the file's items; raises InputError where there is none of that index."""
        if not 0 <= index < len(items):
            raise InputError(f"{self.path}: uses {kind}[{index}], of {len(items)}")
        return items[index]

    def claim(self, size: int, what: str) -> None:
        """Count memory against the limit; raises InputError beyond it."""
        self._decoded_bytes += size
        if self._decoded_bytes > self.decode_limit:
            raise InputError(
                f"{self.path}: {what} claims {self._decoded_bytes} bytes with all before, "
                f"more than {self.decode_limit}, which is what a file of its size may claim"
            )

    def accessor(self, index: int, use: str, *types: str) -> Array:
        """Return an accessor's values ``[count, components]``; normalized integers come as float32.

        Args:
            index: which accessor.
            use: what for, to be named in errors.
            types: the types allowed there, such as ``VEC3``.
        """
        accessor = self.item("accessors", self.json.accessors, index)
        place = f"{self.path}: accessors[{index}]"
        if accessor.type not in types:
            raise InputError(f"{place} is {accessor.type}, expected {' or '.join(types)} for {use}")
        if index not in self._decoded:
            self._decoded[index] = self._decode(accessor, place)
        found = self._decoded[index]
        if use != "NORMAL" and found.dtype.kind == "f" and not np.isfinite(found).all():
            raise InputError(f"{place} holds a number that is not finite")
        return found

    def provide(self, index: int, values: Array) -> None:
        """Set an accessor's values, where they come compressed; raises InputError unless they are of its shape."""
        accessor = self.item("accessors", self.json.accessors, index)
        place = f"{self.path}: accessors[{index}]"
        shape = (accessor.count, COMPONENTS[accessor.type])
        if values.shape != shape:
            raise InputError(f"{place} has the shape {values.shape} when unpacked, expected {shape}")
        self.claim(values.nbytes, place)
        self._decoded[index] = _meant(accessor, values)

    def view(self, index: int) -> memoryview:
        """Return the bytes of a buffer view."""
        view = self.item("bufferViews", self.json.bufferViews, index)
        buffer = self._buffer(view.buffer)
        if view.byteOffset + view.byteLength > len(buffer):
            raise InputError(
                f"{self.path}: bufferViews[{index}] ends at byte {view.byteOffset + view.byteLength}, "
                f"its buffer at {len(buffer)}"
            )
        return buffer[view.byteOffset : view.byteOffset + view.byteLength]

    def uri_bytes(self, place: str, uri: str) -> bytes:
        """Return what a URI stands for: a data URI's contents, or a file in the folder."""
        if uri.startswith("data:"):
            return _data_uri(f"{self.path}: {place}", uri)
        return read_bytes(self._file(place, uri))

    def _file(self, place: str, uri: str) -> Path:
        try:
            return asset_file(uri, self.path.parent)
        except InputError as error:
            raise InputError(f"{self.path}: {place}.uri: {error}") from None

    def _outside_bytes(self, place: str, uri: str | None) -> int:
        if uri is None or uri.startswith("data:"):
            return 0
        file = self._file(place, uri)
        if not file.is_file():
            raise InputError(f"{self.path}: {place}.uri: the file {uri!r} is missing")
        return file.stat().st_size

    def _buffer(self, index: int) -> memoryview:
        if index not in self._buffers:
            buffer = self.item("buffers", self.json.buffers, index)
            place = f"buffers[{index}]"
            data = self._chunk if buffer.uri is None and index == 0 else b""
            if buffer.uri is not None:
                data = self.uri_bytes(place, buffer.uri)
            if len(data) < buffer.byteLength:
                raise InputError(
                    f"{self.path}: {place} has {len(data)} bytes, expected {buffer.byteLength}: the file is truncated"
                )
            self._buffers[index] = memoryview(data)[: buffer.byteLength]
        return self._buffers[index]

    def _decode(self, accessor: schema.Accessor, place: str) -> Array:
        dtype, components = np.dtype(DTYPES[accessor.componentType]), COMPONENTS[accessor.type]
        if accessor.type.startswith("MAT") and accessor.componentType != 5126:
            raise InputError(f"{place} is a matrix of integers, expected floats")
        self.claim(accessor.count * components * max(dtype.itemsize, 4), place)
        values: Array = np.zeros((accessor.count, components), dtype)
        if accessor.bufferView is not None and accessor.count:
            stride = self.json.bufferViews[accessor.bufferView].byteStride if self._has_view(accessor) else None
            values[:] = self._strided(
                place, accessor.bufferView, accessor.byteOffset, accessor.count, dtype, components, stride
            )
        if accessor.sparse is not None:
            self._replace_sparse(accessor.sparse, place, values)
        return _meant(accessor, values)

    def _has_view(self, accessor: schema.Accessor) -> bool:
        return accessor.bufferView is not None and accessor.bufferView < len(self.json.bufferViews)

    def _strided(
        self, place: str, view: int, offset: int, count: int, dtype: np.dtype[Any], components: int, stride: int | None
    ) -> Array:
        data, each = self.view(view), dtype.itemsize * components
        step = stride or each
        end = offset + (count - 1) * step + each
        if step < each or end > len(data):
            raise InputError(f"{place} ends at byte {end} of its bufferView's {len(data)} (stride {step})")
        array: Array = np.ndarray((count, components), dtype, data, offset, (step, dtype.itemsize))
        return array

    def _replace_sparse(self, sparse: schema.Sparse, place: str, values: Array) -> None:
        if not 0 < sparse.count <= len(values):
            raise InputError(f"{place}: sparse.count is {sparse.count}, expected 1 to {len(values)}")
        where, what = sparse.indices, sparse.values
        kind = np.dtype(DTYPES[where.componentType])
        indices = self._strided(place, where.bufferView, where.byteOffset, sparse.count, kind, 1, None)[:, 0]
        if indices.max() >= len(values):
            raise InputError(f"{place}: sparse.indices has {indices.max()}, expected 0 to {len(values) - 1}")
        values[indices] = self._strided(
            place, what.bufferView, what.byteOffset, sparse.count, values.dtype, values.shape[1], None
        )


def _meant(accessor: schema.Accessor, values: Array) -> Array:
    """Return numbers; normalized integers stand for shares of 1."""
    if values.dtype.kind != "f" and accessor.normalized and accessor.componentType != 5125:
        values = np.maximum(values.astype(np.float32) / np.iinfo(DTYPES[accessor.componentType]).max, -1.0)
    return values


def read_bytes(path: Path) -> bytes:
    """Return a file's contents.

    Raises:
        InputError: if it is missing, larger than 1 GiB, or cannot be read.
    """
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError(f"{path}: is larger than {MAX_FILE_BYTES >> 30} GiB, expected a smaller file")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None


def _version(text: bytes) -> str:
    """Return the version of glTF that a JSON claims, as far as it can be read."""
    try:
        return str(json.loads(text)["asset"]["version"])
    except (ValueError, KeyError, TypeError):
        return ""


def _optional(extension: str) -> bool:
    return extension.startswith("KHR_materials_")


def _split(path: Path, data: bytes) -> tuple[bytes, bytes]:
    """Return the JSON and the binary chunk."""
    # Files of either kind are about with the other's ending.
    if data[:4] != b"glTF" and (path.suffix.lower() != ".glb" or data.lstrip()[:1] == b"{"):
        return data, b""
    if len(data) < 20 or data[:4] != b"glTF":
        raise InputError(f"{path}: is not a binary glTF file (it does not start with a glTF header)")
    version, length, text_length, kind = struct.unpack_from("<4xIIII", data)
    if version != 2:
        raise InputError(f"{path}: is glTF version {version}, expected 2")
    if kind != 0x4E4F534A:
        raise InputError(f"{path}: begins with a chunk of the kind {data[16:20]!r}, expected its JSON (b'JSON')")
    if length > len(data) or 20 + text_length > len(data):
        raise InputError(f"{path}: has {len(data)} bytes, expected {max(length, 20 + text_length)}: it is truncated")
    start = 20 + text_length
    chunk = b""
    if len(data) >= start + 8:
        chunk_length, chunk_kind = struct.unpack_from("<II", data, start)
        if start + 8 + chunk_length > len(data):
            raise InputError(
                f"{path}: its binary chunk claims {chunk_length} bytes, more than there are: it is truncated"
            )
        if chunk_kind == 0x004E4942:
            chunk = data[start + 8 : start + 8 + chunk_length]
    return data[20:start], chunk


def _data_uri(place: str, uri: str) -> bytes:
    head, comma, payload = uri.partition(",")
    if not comma or not head.endswith(";base64"):
        raise InputError(f"{place}.uri: is a data URI without base64, expected data:…;base64,…")
    try:
        return base64.b64decode(payload, validate=True)
    except (binascii.Error, ValueError) as error:
        raise InputError(f"{place}.uri: its base64 cannot be decoded ({error})") from None
