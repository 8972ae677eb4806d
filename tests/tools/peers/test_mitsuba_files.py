"""Mitsuba files of earlier versions, which Mitsuba 3 refuses as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from clsim.errors import InputError
from tools.peers.mitsuba_files import load_mitsuba_file

EARLIER = """<scene version="0.6.0">
    <default name="method" value="sppm"/>
    <integrator type="$method"><integer name="photonCount" value="1000"/></integrator>
    <shape type="obj">
        <string name="filename" value="meshes/triangle.obj"/>
        <bsdf type="roughdiffuse">
            <float name="alpha" value="0.2"/>
            <texture type="bitmap" name="reflectance">
                <string name="filename" value="dot.exr"/>
                <string name="filterType" value="trilinear"/>
            </texture>
        </bsdf>
    </shape>
    <emitter type="constant"><float name="noSuchThing" value="2"/></emitter>
</scene>"""


@pytest.fixture
def earlier(mi, tmp_path: Path) -> Path:
    (tmp_path / "meshes").mkdir()
    corners = "\n".join(["v -9 -9 0", "v 9 -9 0", "v 0 9 0"])
    (tmp_path / "meshes" / "triangle.obj").write_text(f"{corners}\nvt 0.5 0.5\nf 1/1 2/1 3/1\n")
    mi.Bitmap(np.full((2, 2, 3), 0.25, np.float32)).write(str(tmp_path / "dot.exr"))
    file = tmp_path / "earlier.xml"
    file.write_text(EARLIER)
    return file


def test_a_file_of_an_earlier_version_is_rendered(mi, earlier: Path) -> None:
    """A surface that reflects a quarter of a white sky; its files lie beside the scene's, wherever the reader is."""
    with pytest.raises(RuntimeError, match=r"sppm|no_such_thing"):  # by version, one or the other is told first
        mi.load_file(str(earlier))
    scene = load_mitsuba_file(mi, earlier)
    view = mi.ScalarTransform4f().look_at(origin=[0, -1, 3], target=[0, -1, 0], up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": 4, "height": 4, "pixel_format": "rgb"}
    sensor = mi.load_dict({"type": "perspective", "fov": 20, "to_world": view, "film": film})
    image = np.array(mi.render(scene, sensor=sensor, spp=64))
    np.testing.assert_allclose(image.mean(), 0.25, rtol=0.03)


def test_a_file_that_cannot_be_loaded_is_named(mi, tmp_path: Path) -> None:
    before = str(mi.file_resolver())
    file = tmp_path / "no.xml"
    file.write_text('<scene version="3.0.0"><shape type="dodecahedron"/></scene>')
    with pytest.raises(InputError, match=r"no\.xml: Mitsuba cannot load it: .*dodecahedron"):
        load_mitsuba_file(mi, file)
    assert str(mi.file_resolver()) == before, "others look for files where they did"
