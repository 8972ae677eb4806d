"""Copies of a node's mesh (the glTF extension EXT_mesh_gpu_instancing)."""

from __future__ import annotations

import numpy as np

from clsim.errors import InputError
from clsim.scene.gltf import schema
from clsim.scene.gltf.accessors import GltfFile
from clsim.scene.motion import Matrix, compose, rotation_matrix


def copies(file: GltfFile, index: int, node: schema.Node) -> list[Matrix] | None:
    """Return where copies of a node's mesh stand within the node, 4×4 each; None where it has no copies.

    Raises:
        InputError: arrays do not fit together, or a rotation is none.
    """
    extension = node.extensions.EXT_mesh_gpu_instancing
    if extension is None:
        return None
    place = f"{file.path}: nodes[{index}]"
    types = {"TRANSLATION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3"}
    found = {
        name: file.accessor(extension.attributes[name], name, kind).astype(np.float64)
        for name, kind in types.items()
        if name in extension.attributes
    }
    counts = {len(values) for values in found.values()}
    if len(counts) != 1:
        raise InputError(f"{place}: its copies have {sorted(counts) or 'no'} places, expected one number of them")
    count = counts.pop()
    places = found.get("TRANSLATION", np.zeros((count, 3)))
    turns = found.get("ROTATION", np.tile((0.0, 0.0, 0.0, 1.0), (count, 1)))
    scales = found.get("SCALE", np.ones((count, 3)))
    lengths = np.linalg.norm(turns, axis=1)
    if (lengths < 1e-9).any():
        raise InputError(f"{place}: a copy has a quaternion of length 0, expected rotations")
    return [
        compose(at, rotation_matrix(turn / length) @ np.diag(scale))
        for at, turn, length, scale in zip(places, turns, lengths, scales, strict=True)
    ]
