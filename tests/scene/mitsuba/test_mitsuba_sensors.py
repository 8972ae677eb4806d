"""What Mitsuba's sensors show: crop windows, distortion; and merged shapes."""

import numpy as np
import pytest

from clsim.live.outputs.sidecars import about_camera
from clsim.scene.mitsuba.scene import load_mitsuba
from tests.scene.mitsuba.mitsuba_files import complaint, load, scene

LIGHT = '<emitter type="constant"/>'
FILM = '<integer name="width" value="400"/><integer name="height" value="300"/>'
CROP = "".join(
    f'<integer name="crop_{name}" value="{value}"/>'
    for name, value in (("offset_x", 50), ("offset_y", 200), ("width", 300), ("height", 70))
)


def camera(tmp_path, kind, inside="", crop=""):
    film = f'<film type="hdrfilm">{FILM}{crop}</film>'
    place = '<transform name="to_world"><lookat origin="1, 2, 5" target="0, 0, 0" up="0, 1, 0"/></transform>'
    body = f'<sensor type="{kind}">{place}{inside}{film}</sensor>{LIGHT}<shape type="cube"/>'
    world = load_mitsuba(scene(tmp_path, body))
    assert world.warnings == ()
    return world.camera


def pixel(camera, point):
    about = about_camera(camera)
    x, y, z, _ = np.linalg.inv(camera.motion.pose(0.0)) @ (*point, 1.0)
    if camera.lens.model == "orthographic":
        scale, centre = about["pixels_per_m"], about["axis_px"]
        return centre["cx"] + scale["x"] * x, centre["cy"] - scale["y"] * y
    k = about["intrinsics_px"]
    return k["cx"] + k["fx"] * x / -z, k["cy"] - k["fy"] * y / -z


@pytest.mark.parametrize(
    ("kind", "inside"),
    [
        ("perspective", '<float name="fov" value="50"/>'),
        ("perspective", '<float name="fov" value="50"/><float name="principal_point_offset_y" value="0.2"/>'),
        ("thinlens", '<string name="focal_length" value="35mm"/><float name="principal_point_offset_x" value="0.1"/>'),
        ("orthographic", ""),
    ],
)
def test_a_crop_shows_a_part_of_the_same_picture(tmp_path, kind, inside):
    whole, part = (camera(tmp_path, kind, inside, crop) for crop in ("", CROP))
    assert (part.width, part.height) == (300, 70)
    for point in ((0, 0, 0), (0.5, -0.3, 0.2), (-1, 1, 1)):
        np.testing.assert_allclose(np.add(pixel(part, point), (50, 200)), pixel(whole, point), atol=1e-6)


@pytest.mark.parametrize("crop", ['name="crop_width" value="401"', 'name="crop_offset_y" value="1"'])
def test_a_crop_beyond_its_film_is_refused(tmp_path, crop):
    body = f'<sensor type="perspective"><film type="hdrfilm">{FILM}<integer {crop}/></film></sensor>{LIGHT}'
    assert "expected a part of 400×300" in complaint(scene(tmp_path, body))


@pytest.mark.parametrize(("told", "expected"), [("", ()), ('<string name="kc" value="-0.25, 0.09"/>', (-0.25, 0.09))])
def test_radial_distortion_is_that_of_tangents(tmp_path, told, expected):
    """A tangent r appears at r (1 + kc₀ r² + kc₁ r⁴), as OpenCV's k1 and k2 have it (Mitsuba 0.6's manual)."""
    assert camera(tmp_path, "perspective_rdist", told).lens.distortion == expected


def test_merged_shapes_are_those_inside(tmp_path):
    inside = '<shape type="cube"/><shape type="sphere"/>'
    merged, plain = load(tmp_path, f'<shape type="merge">{inside}</shape>'), load(tmp_path, inside)
    assert [len(mesh.triangles) for mesh in merged.meshes] == [len(mesh.triangles) for mesh in plain.meshes]
    assert len(merged.instances) == 2 and merged.warnings == ()


@pytest.mark.parametrize(
    ("told", "warning"),
    [
        ('<shape type="sphere"><float name="raduis" value="2"/></shape>', "the raduis of a sphere shape is left out"),
        (
            '<shape type="cube"><bsdf type="diffuse"><rgb name="color" value="1"/></bsdf></shape>',
            "the color of a diffuse bsdf is left out",
        ),
        (
            '<emitter type="point"><rgb name="radiance" value="9"/></emitter>',
            "the radiance of a point emitter is left out",
        ),
        (
            '<shape type="sdfgrid"><string name="filename" value="a"/></shape>',
            "shapes of type sdfgrid are left out",
        ),
    ],
)
def test_properties_that_nothing_reads_are_told(tmp_path, told, warning):
    assert load(tmp_path, told).warnings == (f"scene.xml: {warning}",)


def test_what_usual_scenes_tell_is_no_cause_for_warnings(tmp_path):
    """As Mitsuba's own previews of materials have it."""
    body = """<sensor type="perspective" id="camera"><string name="fov_axis" value="smaller"/>
    <float name="focus_distance" value="6"/><float name="fov" value="28.8"/><float name="near_clip" value="0.1"/>
    <float name="shutter_open" value="0"/><film type="hdrfilm"><integer name="width" value="64"/>
    <integer name="height" value="48"/><string name="pixel_format" value="rgb"/><rfilter type="tent"/></film></sensor>
    <emitter type="constant"><rgb name="radiance" value="0.5"/><float name="sampling_weight" value="2"/></emitter>
    <texture type="checkerboard" id="squares"><rgb name="color0" value="0.2"/><rgb name="color1" value="0.4"/>
    <transform name="to_uv"><scale x="8" y="8"/></transform></texture>
    <bsdf type="twosided" id="floor"><bsdf type="diffuse"><ref name="reflectance" id="squares"/></bsdf></bsdf>
    <bsdf type="roughplastic" id="ball"><rgb name="diffuse_reflectance" value="0.9, 0.3, 0.4"/>
    <float name="int_ior" value="1.9"/><float name="alpha" value="0.1"/><string name="distribution" value="ggx"/>
    <boolean name="nonlinear" value="true"/><boolean name="sample_visible" value="true"/></bsdf>
    <bsdf type="roughconductor" id="metal"><string name="material" value="Al"/><float name="alpha_u" value="0.05"/>
    <float name="alpha_v" value="0.3"/></bsdf>
    <shape type="rectangle"><ref id="floor"/><transform name="to_world"><scale value="9"/></transform></shape>
    <shape type="sphere"><ref id="ball"/><float name="radius" value="2"/><point name="center" z="1"/></shape>
    <shape type="cylinder"><ref id="metal"/><point name="p0" x="0" y="0" z="0"/><point name="p1" x="0" y="0" z="2"/>
    <float name="radius" value="0.5"/></shape>"""
    assert load_mitsuba(scene(tmp_path, body)).warnings == ()
