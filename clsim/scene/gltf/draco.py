"""Meshes compressed with Draco (the glTF extension KHR_draco_mesh_compression)."""

from __future__ import annotations

import numpy as np

from clsim.errors import InputError
from clsim.scene.gltf import schema
from clsim.scene.gltf.accessors import GltfFile

DRACO = "KHR_draco_mesh_compression"


def unpacked(file: GltfFile, place: str, primitive: schema.Primitive) -> schema.Primitive:
    """Give the file's accessors what a primitive compresses, and return the primitive as if it were not compressed.

    Where the optional library is missing and the file has the arrays plainly too, those are used.

    Raises:
        InputError: if the library is missing, or the data are damaged or not those that the file describes.
    """
    draco = primitive.extensions.KHR_draco_mesh_compression
    if draco is None:
        return primitive
    try:
        import DracoPy
    except ImportError:
        if DRACO not in file.json.extensionsRequired and _is_plain(file, primitive):
            return primitive
        raise InputError(f"{file.path}: {place} is compressed with Draco: pip install 'clsim[draco]'") from None
    try:
        mesh = DracoPy.decode(bytes(file.view(draco.bufferView)))
        arrays = {attribute["unique_id"]: np.asarray(attribute["data"]) for attribute in mesh.attributes}
        corners = np.asarray(mesh.faces).reshape(-1, 1).astype(np.uint32)
    except InputError:
        raise
    except Exception as error:  # the library raises whatever its decoder stumbles over
        raise InputError(f"{file.path}: {place}: its Draco data cannot be decoded ({error})") from None
    for name, unique_id in draco.attributes.items():
        if unique_id not in arrays:
            raise InputError(f"{file.path}: {place}: its Draco data have no attribute {unique_id} for {name}")
        if name in primitive.attributes:
            file.provide(primitive.attributes[name], arrays[unique_id])
    if primitive.indices is not None:
        file.provide(primitive.indices, corners)
    return primitive.model_copy(update={"mode": 4})


def _is_plain(file: GltfFile, primitive: schema.Primitive) -> bool:
    """Whether a file has a primitive's arrays without compression, too."""
    used = [*primitive.attributes.values(), *([] if primitive.indices is None else [primitive.indices])]
    return all(file.item("accessors", file.json.accessors, index).bufferView is not None for index in used)
