"""Small glTF files for tests."""

import base64
import io
import json
import struct
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

ASSETS = Path(__file__).resolve().parents[4] / "shared" / "assets" / "gltf"
needs_assets = pytest.mark.skipif(not ASSETS.is_dir(), reason="the real scenes are not beside this checkout")
CORNERS = [(0, 0, 0), (2, 0, 0), (0, 1, 0)]
SIZES = {"<f4": 5126, "<u2": 5123, "u1": 5121, "i1": 5120, "<i2": 5122, "<u4": 5125}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def gltf(**changes):
    """Return the JSON of one triangle, its positions in a data URI; keywords replace top-level keys."""
    points = np.array(changes.pop("points", CORNERS), "<f4").tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(points).decode()
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "node"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": uri}],
    }
    return tree | changes


def write_gltf(tmp_path, tree):
    path = tmp_path / "scene.gltf"
    path.write_text(json.dumps(tree))
    return path


def glb(tree, binary=b""):
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def image_uri(pixels):
    data = io.BytesIO()
    PIL.Image.fromarray(np.asarray(pixels, np.uint8)).save(data, "PNG")
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()


def add(tree, values, dtype="<f4", **extra):
    """Append an array to a file as buffer, view and accessor; return the accessor's index."""
    array = np.asarray(values, dtype)
    data = array.tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    tree["buffers"].append({"byteLength": len(data), "uri": uri})
    tree["bufferViews"].append({"buffer": len(tree["buffers"]) - 1, "byteLength": len(data)})
    width = array.shape[1] if array.ndim > 1 else 1
    tree["accessors"].append(
        {
            "bufferView": len(tree["bufferViews"]) - 1,
            "componentType": SIZES[dtype],
            "count": len(array),
            "type": TYPES[width],
            **extra,
        }
    )
    return len(tree["accessors"]) - 1


def animate(tree, *channels):
    """Append an animation of channels (node, path, times, values, interpolation)."""
    animation = {"channels": [], "samplers": []}
    for node, path, times, values, interpolation in channels:
        sampler = {"input": add(tree, times), "output": add(tree, values), "interpolation": interpolation}
        animation["channels"].append({"sampler": len(animation["samplers"]), "target": {"node": node, "path": path}})
        animation["samplers"].append(sampler)
    tree.setdefault("animations", []).append(animation)
    return tree


def with_camera(tree):
    """Make a file a scene of its own: its animation then plays once."""
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8}}]
    tree["nodes"].append({"camera": 0, "translation": [0, 0, 30]})
    tree["scenes"][0]["nodes"].append(len(tree["nodes"]) - 1)
    return tree


def decoded(source, index):
    """Decode an accessor without stride, by pygltflib's own classes."""
    accessor = source.accessors[index]
    view = source.bufferViews[accessor.bufferView]
    dtype = {5126: "<f4", 5123: "<u2", 5121: "u1"}[accessor.componentType]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor.type]
    start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
    return np.frombuffer(source.binary_blob(), dtype, accessor.count * width, start).reshape(accessor.count, width)
