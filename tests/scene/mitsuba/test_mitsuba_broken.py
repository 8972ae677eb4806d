"""What a damaged or hostile file of Mitsuba's is told."""

import struct
import zlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.mitsuba.shapes import read_serialized
from tests.scene.mitsuba.mitsuba_files import SENSOR, complaint, scene, whole


def serialized(vertices, faces, flags=0x1000, version=4):
    body = struct.pack("<I", flags) + b"name\0" + struct.pack("<QQ", len(vertices), len(faces))
    body += np.asarray(vertices, "<f8" if flags & 0x2000 else "<f4").tobytes() + np.asarray(faces, "<u4").tobytes()
    return struct.pack("<HH", 0x041C, version) + zlib.compress(body)


def test_serialized_meshes(tmp_path):
    first = serialized([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    second = serialized([(0, 0, 0), (2, 0, 0), (0, 2, 0), (2, 2, 0)], [(0, 1, 2), (1, 3, 2)], 0x2000)
    path = tmp_path / "a.serialized"
    path.write_bytes(first + second + struct.pack("<QQI", 0, len(first), 2))
    assert read_serialized(path, 0)[0].triangles.tolist() == [[0, 1, 2]]
    mesh, _ = read_serialized(path, 1)
    assert mesh.vertices[3].tolist() == [2, 2, 0]
    assert mesh.triangles.tolist() == [[0, 1, 2], [1, 3, 2]]
    for index in (2, 9):
        with pytest.raises(InputError, match="has 2 meshes"):
            read_serialized(path, index)
    for cut in (0, 3, 10, 60, len(first) + 30):
        path.write_bytes((first + second)[:cut] + struct.pack("<QQI", 0, len(first), 2))
        with pytest.raises(InputError, match=r"a\.serialized"):
            read_serialized(path, 1)


PLACED = '<shape type="cube"><transform name="to_world">{}</transform></shape>'


BOMB = "".join(f'<default name="a{k}" value="$a{k - 1}$a{k - 1}"/>' for k in range(1, 60))


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "scene.xml:1: is not well-formed XML"),
        ("<scene", "not well-formed"),
        ("\0\1\2", "not well-formed"),
        ("<other/>", "expected <scene>"),
        ("<robot/>", "is <robot>, expected <scene> of Mitsuba's or <mujoco>"),
        ("<scene/>", "no version"),
        ('<!DOCTYPE scene [<!ENTITY a "aaaa">]><scene version="3.0.0">&a;</scene>', "document type"),
        ('<!DOCTYPE scene SYSTEM "http://example.com/x.dtd"><scene version="3.0.0"/>', "document type"),
        (whole("&undefined;"), "not well-formed"),
        ('<scene version="3.0.0">' + "<shape type='cube'>" * 100, "nested deeper"),
        (whole('<default name="a0" value="x"/>' + BOMB), "longer than"),
        (whole('<shape type="$what"/>'), "of which no <default>"),
        (whole('<include filename="scene.xml"/>'), "include each other"),
        (whole('<include filename="../up.xml"/>'), "missing"),
        (
            whole('<shape type="obj"><string name="filename" value="/dev/null"/></shape>'),
            "no ordinary file",
        ),
        (
            whole('<shape type="obj"><string name="filename" value="no.obj"/></shape>'),
            "missing",
        ),
        (whole('\n\n<shape type="cube"><ref id="x"/></shape>'), "scene.xml:3: refers to 'x'"),
        (whole("<what/>"), "neither a property nor an object"),
        (whole('<shape type="cube"><float name="a" value="x"/></shape>'), "got 'x'"),
        (whole('<shape type="sphere"><float name="radius" value="nan"/></shape>'), "got 'nan'"),
        (
            whole('<shape type="sphere"><string name="radius" value="1"/></shape>'),
            "expected a float",
        ),
        (whole('<shape type="sphere"><transform name="radius"/></shape>'), "radius is a transform, expected a float"),
        (
            whole('<shape type="sphere"><float name="radius" value="-1"/></shape>'),
            "radius is -1",
        ),
        (whole('<shape type="cube"><boolean name="a" value="2"/></shape>'), "true or false"),
        (
            whole('<sensor type="perspective"><float name="fov" value="190"/></sensor>'),
            "fov is 190",
        ),
        (whole('<sensor type="perspective"/>'), "no extent"),
        (
            whole(PLACED.format("<skew/>")),
            "skew",
        ),
        (
            whole(PLACED.format('<rotate angle="3"/>')),
            "no axis",
        ),
        (
            whole(PLACED.format('<scale value="0"/>')),
            "no extent",
        ),
        (whole('<shape type="instance"/>'), "no shapegroup"),
        (
            whole('<emitter type="envmap"><string name="filename" value="scene.xml"/></emitter>'),
            "image",
        ),
    ],
)
def test_broken_scenes_get_one_sentence(tmp_path, text, part):
    path = tmp_path / "scene.xml"
    path.write_text(text)
    assert part in complaint(path)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_text_never_raises_anything_but_an_input_error(tmp_path, data):
    text = (
        '<scene version="0.6.0"><default name="r" value="0.5"/>' + SENSOR + '<bsdf type="twosided" id="b">'
        '<bsdf type="roughplastic"><rgb name="diffuseReflectance" value="$r, 0, 1"/>'
        '<float name="alpha" value="0.1"/></bsdf></bsdf>'
        '<shape type="cube"><ref id="b"/><transform name="toWorld"><rotate x="1" angle="20"/>'
        '<matrix value="1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1"/></transform></shape>'
        '<shape type="sphere"><emitter type="area"><rgb name="radiance" value="3"/></emitter></shape>'
        '<emitter type="spot"><float name="cutoffAngle" value="30"/></emitter></scene>'
    )
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text) - 1))
        piece = data.draw(st.sampled_from(["", "0", "-", "9", '"', "x", "<", "/>", "$", "e9", "nan", " "]))
        text = text[:at] + piece + text[at + data.draw(st.integers(0, 12)) :]
    path = tmp_path / "scene.xml"
    path.write_text(text)
    try:
        load_world(path)
    except InputError as error:
        assert "scene.xml" in str(error)


@pytest.mark.parametrize(
    ("spectrum", "part"),
    [
        ('value="700:1, 400:1"', "increasing wavelengths"),
        ('value="400:1:2"', "wavelength:value pairs"),
        ('type="what"', "expected d65, uniform, blackbody"),
        ('type="blackbody"', "expected 1 numbers"),
        ('filename="none.spd"', "missing"),
        ('filename="scene.xml"', "no table"),
    ],
)
def test_wrong_spectra_get_one_sentence(tmp_path, spectrum, part):
    bsdf = f'<bsdf type="diffuse"><spectrum name="reflectance" {spectrum}/></bsdf>'
    assert part in complaint(scene(tmp_path, SENSOR + f'<shape type="cube">{bsdf}</shape>'))


def test_two_that_refer_to_each_other_get_one_sentence(tmp_path):
    body = '<bsdf type="twosided" id="a"><ref id="b"/></bsdf><bsdf type="twosided" id="b"><ref id="a"/></bsdf>'
    assert "refers to" in complaint(scene(tmp_path, SENSOR + body))
