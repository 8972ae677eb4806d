"""Small glTF files for tests."""

import base64
import io
import json
import struct

import numpy as np
import PIL.Image

CORNERS = [(0, 0, 0), (2, 0, 0), (0, 1, 0)]


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
