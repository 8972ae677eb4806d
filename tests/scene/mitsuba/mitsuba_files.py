"""Mitsuba's files, written in a line."""

import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.mitsuba.scene import load_mitsuba

SENSOR = '<sensor type="perspective"><float name="fov" value="60"/></sensor>'


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def scene(tmp_path, body, version="3.0.0"):
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="{version}">\n{body}\n</scene>')
    return path


def load(tmp_path, body, version="3.0.0"):
    return load_mitsuba(scene(tmp_path, SENSOR + '<emitter type="constant"/>' + body, version))


def material(tmp_path, bsdf, version="3.0.0"):
    world = load(tmp_path, f'<shape type="cube">{bsdf}</shape>', version)
    return world.materials[world.meshes[0].material_ids[0]], world


def complaint(path):
    with pytest.raises(InputError) as caught:
        load_world(path)
    assert path.name in str(caught.value) and "\n" not in str(caught.value)
    return str(caught.value)


def whole(body):
    return f'<scene version="3.0.0">{body}</scene>'
