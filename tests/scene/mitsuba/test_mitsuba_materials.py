"""Mitsuba's scattering models, textures and spectra: what they become."""

import numpy as np
import PIL.Image
import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.mitsuba.materials import mean_reflectance
from clsim.scene.pictures.images import decode_srgb
from tests.scene.mitsuba.mitsuba_files import SENSOR, load, material, scene

SPHERE = '<shape type="sphere"><emitter type="area">{}</emitter></shape>'


def test_materials(tmp_path):
    gold, _ = material(
        tmp_path,
        '<bsdf type="twosided"><bsdf type="roughconductor"><string name="material" value="Au"/>'
        '<float name="alpha" value="0.3"/><string name="distribution" value="ggx"/></bsdf></bsdf>',
    )
    assert (gold.kind, gold.alpha, gold.back, gold.eta[2]) == ("conductor", 0.3, "same", 1.442)
    copper, _ = material(tmp_path, '<bsdf type="conductor"/>', "0.6.0")
    assert copper.eta[0] == 0.201
    ideal, _ = material(tmp_path, '<bsdf type="conductor"/>')
    assert ideal.eta is None
    glass, _ = material(tmp_path, '<bsdf type="dielectric"><string name="int_ior" value="diamond"/></bsdf>')
    assert (glass.kind, glass.back) == ("dielectric", "same")
    assert glass.ior == pytest.approx(2.419 / 1.000277)
    pane, _ = material(tmp_path, '<bsdf type="thindielectric"/>')
    assert pane.kind == "thin-dielectric"
    hole, _ = material(tmp_path, '<bsdf type="mask"><float name="opacity" value="0.3"/><bsdf type="diffuse"/></bsdf>')
    assert (hole.alpha_mode, hole.opacity) == ("blend", pytest.approx(0.3))
    back, _ = material(tmp_path, '<bsdf type="diffuse"/>')
    assert back.back == "black"
    srgb, _ = material(tmp_path, '<bsdf type="diffuse"><rgb name="reflectance" value="#ff8000"/></bsdf>')
    assert srgb.color == pytest.approx((1, float(decode_srgb(128 / 255)), 0))
    flat, _ = material(tmp_path, '<bsdf type="diffuse"><spectrum name="reflectance" value="400:0.5, 700:0.5"/></bsdf>')
    assert flat.color == pytest.approx((0.5, 0.5, 0.5), rel=0.01)
    _, world = material(tmp_path, '<bsdf type="hk"/>')
    assert any("hk" in warning for warning in world.warnings)
    rough, world = material(tmp_path, '<bsdf type="roughplastic"/>')
    assert rough.distribution == "beckmann" and not world.warnings
    _, world = material(tmp_path, '<bsdf type="roughplastic"><string name="distribution" value="phong"/></bsdf>')
    assert any("phong" in warning and "scene.xml:2" in warning for warning in world.warnings)
    both = '<float name="alpha_u" value="0.4"/><float name="alpha_v" value="0.1"/>'
    brushed, world = material(tmp_path, f'<bsdf type="roughconductor">{both}</bsdf>')
    assert (brushed.alpha, brushed.stretch) == pytest.approx((0.2, 2.0)) and not world.warnings
    with pytest.raises(InputError, match="hk"):
        load_world(scene(tmp_path, SENSOR + '<shape type="cube"><bsdf type="hk"/></shape>'), strict=True)


def test_the_scale_of_a_black_body_is_its_luminance(tmp_path):
    body = '<blackbody name="radiance" temperature="5000K" scale="{}"/>'
    one, three = (
        np.array(load(tmp_path, SPHERE.format(body.format(scale)), "0.6.0").sphere_lights[0].radiance)
        for scale in (1, 3)
    )
    np.testing.assert_allclose(three, 3 * one)
    assert one @ (0.2126, 0.7152, 0.0722) == pytest.approx(1) and one[0] > one[2]


@pytest.mark.parametrize(("told", "used"), [(0, 1e-3), (0.5, 0.5), (1, 1), (8, 1)])
def test_specular_of_a_principled_stands_for_an_index(tmp_path, told, used):
    """.08 times it is reflected at right angles; 0 stands for hardly more, as in Mitsuba."""
    found, _ = material(tmp_path, f'<bsdf type="principled"><float name="specular" value="{told}"/></bsdf>')
    assert ((found.ior - 1) / (found.ior + 1)) ** 2 == pytest.approx(0.08 * used)


def shares(world, one, share=1.0):
    """The share of each plain colour in a blend."""
    if one.blend_with < 0:
        return [(share, one.color)]
    rest = shares(world, world.materials[one.blend_with], share * one.blend_share)
    return [(share * (1 - one.blend_share), one.color), *rest]


@pytest.mark.parametrize("inner_first", [True, False])
def test_a_blend_within_a_blend_has_the_shares_of_both_weights(tmp_path, inner_first):
    def blend(weight, *bsdfs):
        return f'<bsdf type="blendbsdf"><float name="weight" value="{weight}"/>{"".join(bsdfs)}</bsdf>'

    red, green, blue = (
        f'<bsdf type="diffuse"><rgb name="reflectance" value="{color}"/></bsdf>'
        for color in ("1 0 0", "0 1 0", "0 0 1")
    )
    inner = blend(0.25, red, green)
    found, world = material(tmp_path, blend(0.4, *((inner, blue) if inner_first else (blue, inner))))
    within = 0.6 if inner_first else 0.4
    expected = [(0.25 * within, (0, 1, 0)), (1 - within, (0, 0, 1)), (0.75 * within, (1, 0, 0))]
    assert {color: pytest.approx(share) for share, color in expected} == {c: s for s, c in shares(world, found)}


def test_bitmaps_keep_their_wrap_transform_and_opacity(tmp_path):
    pixels = np.zeros((2, 2, 4), np.uint8)
    pixels[0, 0] = (255, 255, 255, 0)
    PIL.Image.fromarray(pixels).save(tmp_path / "a.png")
    bitmap = (
        '<texture type="bitmap" name="{}"><string name="filename" value="a.png"/>'
        '<string name="wrap_mode" value="mirror"/><transform name="to_uv"><scale x="2" y="4"/></transform></texture>'
    )
    masked, world = material(
        tmp_path,
        f'<bsdf type="mask">{bitmap.format("opacity")}'
        f'<bsdf type="diffuse">{bitmap.format("reflectance")}</bsdf></bsdf>',
    )
    color, opacity = world.textures[masked.texture], world.textures[masked.opacity_texture]
    assert (color.wrap_u, color.srgb) == ("mirror", True)
    np.testing.assert_allclose(np.array(color.uv_matrix) @ (0.3, 1, 1), (0.6, 1))  # v runs down from the top
    np.testing.assert_array_equal(opacity.pixels[..., 3], [[255, 0], [0, 0]])  # white is opaque, whatever its alpha


@pytest.mark.parametrize("kind", ["conductor", "plastic", "dielectric"])
def test_textures_of_roughness_keep_their_alpha(tmp_path, kind):
    """Ours are the root of α in green, and blue multiplies metalness."""
    gray = np.array([[0, 64], [128, 255]], np.uint8)
    PIL.Image.fromarray(gray).save(tmp_path / "a.png")
    bitmap = (
        '<texture type="bitmap" name="alpha"><string name="filename" value="a.png"/><boolean name="raw" value="{}"/>'
        '<string name="filter_type" value="nearest"/></texture>'
    )
    ggx = '<string name="distribution" value="ggx"/>'
    for raw in (True, False):
        text = f'<bsdf type="rough{kind}">{bitmap.format(str(raw).lower())}{ggx}</bsdf>'
        found, world = material(tmp_path, text)
        image = world.textures[found.roughness_texture]
        expected = gray / 255 if raw else decode_srgb(gray / 255)
        assert (found.kind, found.alpha, image.srgb, image.nearest) == (kind, 1.0, False, True)
        np.testing.assert_allclose((image.pixels[..., 1] / 255) ** 2, expected, atol=0.005)
        assert (image.pixels[..., 2] == 255).all() and not world.warnings


def test_lamps_without_a_bsdf_are_black_and_other_shapes_grey(tmp_path):
    light = '<emitter type="area"><rgb name="radiance" value="1, 2, 3"/></emitter>'
    world = load(tmp_path, f'<shape type="disk">{light}</shape><shape type="cube"/>')
    assert [m.color for m in world.materials] == [(0, 0, 0), (0.5, 0.5, 0.5)]


def test_one_image_as_colour_and_as_normals_is_two_textures(tmp_path):
    PIL.Image.fromarray(np.full((2, 2, 3), 128, np.uint8)).save(tmp_path / "a.png")
    image = '<texture type="bitmap" name="{}"><string name="filename" value="a.png"/>{}</texture>'
    diffuse = '<bsdf type="diffuse">' + image.format("reflectance", "") + "</bsdf>"
    bsdf = '<bsdf type="normalmap">' + image.format("normalmap", '<boolean name="raw" value="true"/>') + diffuse
    found, world = material(tmp_path, bsdf + "</bsdf>")
    assert found.texture != found.normal_texture
    assert [world.textures[k].srgb for k in (found.texture, found.normal_texture)] == [True, False]


@pytest.mark.parametrize(
    ("spectrum", "light", "reflectance"),
    [  # what Mitsuba 3.9 makes of them in its rgb variants
        ('value="0.5"', (0.6024, 0.4741, 0.4545), (0.5, 0.5, 0.5)),
        ('value="400:0.5, 700:0.5"', (0.5998, 0.4748, 0.4517), (0.4977, 0.4999, 0.4975)),
        ('value="500:0.2, 600:0.7"', (0.2717, 0.4174, 0.0), (0.2393, 0.4269, 0.0)),
        (
            'value="400:0.2, 500:0.4, 550:0.6, 600:0.1, 700:0.9"',
            (0.2675, 0.4578, 0.2614),
            (0.1986, 0.4844, 0.2917),
        ),
        ('type="d65"', (1, 1, 1), (1, 1, 1)),
        ('filename="a.spd"', (0.5998, 0.4748, 0.4517), (0.4977, 0.4999, 0.4975)),
    ],
)
def test_spectra_of_light_keep_their_tint_and_reflectances_are_white_by_daylight(
    tmp_path, spectrum, light, reflectance
):
    (tmp_path / "a.spd").write_text("# nm, share\n400 0.5\n700 0.5\n")
    lamp = f'<shape type="disk"><emitter type="area"><spectrum name="radiance" {spectrum}/></emitter></shape>'
    (emitter,) = load(tmp_path, lamp).materials
    assert emitter.emission == pytest.approx(light, rel=0.025, abs=1e-4)
    bsdf = f'<bsdf type="diffuse"><spectrum name="reflectance" {spectrum}/></bsdf>'
    assert material(tmp_path, bsdf)[0].color == pytest.approx(reflectance, rel=0.025, abs=1e-4)


def test_constant_spectra_of_old_files_are_white(tmp_path):
    lamp = '<shape type="disk"><emitter type="area"><spectrum name="radiance" value="9"/></emitter></shape>'
    assert load(tmp_path, lamp, "0.6.0").materials[0].emission == (9, 9, 9)
    pairs = lamp.replace('"9"', '"400:9, 700:9"')
    assert load(tmp_path, pairs, "0.6.0").materials[0].emission[0] > 10


def test_black_bodies_have_the_radiance_of_plancks_law(tmp_path):
    """At 2856 K and 5000 K as Mitsuba 3.9's spectral variant renders them."""
    for temperature, expected in ((2856, (499.9, 223.7, 63.0)), (5000, (15277, 12095, 9574))):
        spectrum = f'<spectrum name="radiance" type="blackbody"><float name="temperature" value="{temperature}"/>'
        lamp = f'<shape type="disk"><emitter type="area">{spectrum}</spectrum></emitter></shape>'
        assert load(tmp_path, lamp).materials[0].emission == pytest.approx(expected, rel=0.02)


def test_glass_keeps_what_it_lets_pass(tmp_path):
    bsdf = '<bsdf type="dielectric"><rgb name="specular_transmittance" value="0.5, 0.05, 0"/></bsdf>'
    found, world = material(tmp_path, bsdf)
    assert (found.color, found.specular_color) == ((0.5, 0.05, 0), (1, 1, 1)) and not world.warnings


def test_negative_indices_of_metals_are_mended_with_a_word(tmp_path):
    bsdf = '<bsdf type="conductor"><rgb name="eta" value="-0.01, 0.5, 1"/><rgb name="k" value="3, 2, 1"/></bsdf>'
    found, world = material(tmp_path, bsdf)
    assert (found.eta, found.k) == ((0, 0.5, 1), (3, 2, 1))
    assert any("negative index" in warning for warning in world.warnings)
    with pytest.raises(InputError, match="strict"):
        load_world(tmp_path / "scene.xml", strict=True)


def test_both_indices_of_a_metal_are_relative_to_what_is_around(tmp_path):
    bsdf = (
        '<bsdf type="conductor"><rgb name="eta" value="2, 1, 0.5"/><rgb name="k" value="3, 2, 1"/>'
        '<float name="ext_eta" value="2"/></bsdf>'
    )
    found, _ = material(tmp_path, bsdf)
    assert (found.eta, found.k) == ((1, 0.5, 0.25), (1.5, 1, 0.5))


def test_old_texture_scales_come_before_the_transform(tmp_path):
    PIL.Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "a.png")
    texture = (
        '<texture type="bitmap" name="reflectance"><string name="filename" value="a.png"/>'
        '<float name="uscale" value="2"/><transform name="to_uv"><translate x="0.25"/></transform></texture>'
    )
    _, world = material(tmp_path, f'<bsdf type="diffuse">{texture}</bsdf>')
    np.testing.assert_allclose(np.array(world.textures[0].uv_matrix) @ (0.5, 0, 1), (1.25, 0))


def test_masks_and_two_sides_are_combined(tmp_path):
    red = '<bsdf type="diffuse"><rgb name="reflectance" value="0.9, 0.1, 0.1"/></bsdf>'
    blue = red.replace("0.9, 0.1, 0.1", "0.1, 0.1, 0.9")

    def mask(bsdf, opacity):
        return f'<bsdf type="mask"><float name="opacity" value="{opacity}"/>{bsdf}</bsdf>'

    found, _ = material(tmp_path, mask(mask(red, 0.5), 0.4))
    assert (found.alpha_mode, found.opacity) == ("blend", pytest.approx(0.2))
    found, world = material(tmp_path, f'<bsdf type="twosided">{red}{blue}</bsdf>')
    other = world.materials[found.blend_with]
    assert (found.color[0], other.color[2], found.blend_behind) == (0.9, 0.9, True) and not world.warnings
    assert (found.back, other.back) == ("same", "same")
    weight = '<float name="weight" value="0.25"/>'
    found, _ = material(tmp_path, f'<bsdf type="blendbsdf">{weight}{red}{mask(blue, 0.2)}</bsdf>')
    # Of the light that meets it .75 is scattered by red, .05 by blue, and .2 goes on.
    assert (found.opacity, found.blend_share * found.opacity) == (pytest.approx(0.8), pytest.approx(0.05))


@pytest.mark.parametrize(("version", "corner"), [("3.0.0", 0.4), ("0.6.0", 0.0)])
def test_numbers_of_a_checkerboard_stand_in_the_other_squares(tmp_path, version, corner):
    """Mitsuba 3 gives numbers of a checkerboard at the corner that of color1, and colours that of color0."""
    values = '<float name="color0" value="0"/><float name="color1" value="0.4"/>'
    squares = f'<texture type="checkerboard" name="{{}}">{values}</texture>'
    found, world = material(tmp_path, f'<bsdf type="roughconductor">{squares.format("alpha")}</bsdf>', version)
    perceptual = world.textures[found.roughness_texture].pixels[0, 0, 1] / 255
    assert perceptual**2 == pytest.approx(corner, abs=0.01)
    found, world = material(tmp_path, f'<bsdf type="diffuse">{squares.format("reflectance")}</bsdf>', version)
    assert world.textures[found.texture].pixels[0, 0, 0] == 0


def test_phongs_lobe_and_base_keep_their_reflectances(tmp_path):
    colors = (
        '<rgb name="diffuseReflectance" value="0.5, 0.2, 0.1"/><rgb name="specularReflectance" value="0.1, 0.3, 0.2"/>'
    )
    bsdf = f'<bsdf type="phong">{colors}<float name="exponent" value="20"/></bsdf>'
    found, world = material(tmp_path, bsdf, "0.6.0")
    lobe, share = world.materials[found.blend_with], found.blend_share
    np.testing.assert_allclose((1 - share) * np.array(found.color), (0.5, 0.2, 0.1))
    np.testing.assert_allclose(share * np.array(lobe.specular_color), (0.1, 0.3, 0.2))
    # Reflected by 10° from the mirror direction, the half vector is off by 5°: as much less as cosⁿ says.
    away = np.radians(10.0)
    slopes = np.exp(-((np.tan(away / 2) / lobe.alpha) ** 2))
    assert slopes == pytest.approx(np.cos(away) ** 20, rel=0.02)
    assert any("phong" in warning for warning in world.warnings)
    # Where both reflect all light that comes, roundings must not make it more.
    grey = '<spectrum name="{}" value="{}"/>'
    both = grey.format("diffuseReflectance", 0.1) + grey.format("specularReflectance", 0.9)
    found, _ = material(tmp_path, f'<bsdf type="phong">{both}</bsdf>', "0.6.0")
    assert 0.999 < max(found.color) <= 1.0
    # Without a lobe it is diffuse, of which there is nothing to tell.
    for none in ("0", "1e-320"):
        bsdf = f'<bsdf type="phong">{grey.format("specularReflectance", none)}</bsdf>'
        found, world = material(tmp_path, bsdf, "0.6.0")
        assert found.blend_with == -1 and found.color == (0.5, 0.5, 0.5) and not world.warnings


def test_wards_lobe_is_of_beckmanns_microfacets(tmp_path):
    colors = '<spectrum name="diffuseReflectance" value="0"/><rgb name="specularReflectance" value="0.6, 0.4, 0.3"/>'
    found, world = material(tmp_path, f'<bsdf type="ward">{colors}<float name="alpha" value="0.4"/></bsdf>', "0.6.0")
    lobe, share = world.materials[found.blend_with], found.blend_share
    np.testing.assert_allclose(share * np.array(lobe.specular_color), (0.6, 0.4, 0.3))
    assert (1 - share) * max(found.color) == 0 and "diffuse with a lobe of Beckmann's" in world.warnings[0]
    assert (lobe.kind, lobe.distribution, lobe.alpha, lobe.stretch) == ("conductor", "beckmann", 0.4, 1.0)
    both = '<float name="alphaU" value="0.4"/><float name="alphaV" value="0.1"/>'
    found, world = material(tmp_path, f'<bsdf type="ward">{both}</bsdf>', "0.6.0")
    lobe, share = world.materials[found.blend_with], found.blend_share
    assert (lobe.alpha, lobe.stretch) == pytest.approx((0.2, 2.0))
    assert (share * lobe.specular_color[0], (1 - share) * found.color[0]) == pytest.approx((0.2, 0.5))


def test_pplastic_is_plastic_that_loses_what_its_coat_reflects_inwards(tmp_path):
    """The mean of Fresnel's reflectance over diffuse light has a closed form (Walsh 1926)."""
    n = 1.5
    closed = 0.5 + (n - 1) * (3 * n + 1) / (6 * (n + 1) ** 2)
    closed += n**2 * (n**2 - 1) ** 2 / (n**2 + 1) ** 3 * np.log((n - 1) / (n + 1))
    closed -= 2 * n**3 * (n**2 + 2 * n - 1) / ((n**2 + 1) * (n**4 - 1))
    closed += 8 * n**4 * (n**4 + 1) / ((n**2 + 1) * (n**4 - 1) ** 2) * np.log(n)
    assert mean_reflectance(n) == pytest.approx(closed, abs=1e-5)
    bsdf = '<bsdf type="pplastic"><rgb name="diffuse_reflectance" value="0.5"/><float name="int_ior" value="1.5"/>'
    found, world = material(tmp_path, bsdf + '<float name="ext_ior" value="1"/></bsdf>')
    assert (found.kind, found.distribution, found.alpha) == ("plastic", "beckmann", 0.1)
    np.testing.assert_allclose(found.color, 0.5 * (1 - closed), atol=1e-4)
    assert any("polarisation" in warning for warning in world.warnings)
    # Of an index beyond all sense nothing passes, and nothing overflows.
    assert material(tmp_path, bsdf.replace("1.5", "1e300") + "</bsdf>")[0].color == pytest.approx((0.0, 0.0, 0.0))


def test_textures_on_vertices_are_left_out_with_a_word(tmp_path):
    painted = '<texture type="mesh_attribute" name="reflectance"><string name="name" value="vertex_color"/></texture>'
    found, world = material(tmp_path, f'<bsdf type="diffuse">{painted}</bsdf>')
    assert world.textures[found.texture].color_a == (0.5, 0.5, 0.5)
    assert any("the texture mesh_attribute is left out; grey stands in" in each for each in world.warnings)


@pytest.mark.parametrize(("kind", "passed"), [("polarizer", 0.3), ("circular", 0.3), ("retarder", 0.6)])
def test_filters_of_polarisation_dim_alone(tmp_path, kind, passed):
    found, world = material(tmp_path, f'<bsdf type="{kind}"><float name="transmittance" value="0.6"/></bsdf>')
    assert (found.color, found.alpha_mode, found.opacity) == ((0, 0, 0), "blend", pytest.approx(1 - passed))
    assert any(f"the bsdf {kind} is rendered without polarisation" in each for each in world.warnings)


def test_phong_tells_that_the_texture_of_its_exponent_is_left_out(tmp_path):
    texture = '<texture type="checkerboard" name="exponent"/>'
    found, world = material(tmp_path, f'<bsdf type="phong">{texture}</bsdf>', "0.6.0")
    assert world.materials[found.blend_with].alpha == pytest.approx(np.sqrt(2 / 122))
    assert any("exponent" in warning and "30 stands in" in warning for warning in world.warnings)


@pytest.mark.parametrize("across", ["repeat", "mirror", "clamp"])
@pytest.mark.parametrize("along", ["repeat", "mirror", "clamp"])
def test_each_direction_of_a_texture_has_its_own_wrap_mode(tmp_path, across, along):
    PIL.Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "a.png")
    modes = f'<string name="wrap_mode_u" value="{across}"/><string name="wrap_mode_v" value="{along}"/>'
    bitmap = f'<texture type="bitmap" name="reflectance"><string name="filename" value="a.png"/>{modes}</texture>'
    found, world = material(tmp_path, f'<bsdf type="diffuse">{bitmap}</bsdf>')
    texture = world.textures[found.texture]
    assert (texture.wrap_u, texture.wrap_v) == (across, along)


@pytest.mark.parametrize("scales", [{"uscale": 2, "vscale": 3}, {"uvscale": 4}])
def test_old_offsets_and_scales_are_each_directions_own(tmp_path, scales):
    """Of version 0.6: u' = uscale·u + uoffset, v' = vscale·v + voffset, v from the top."""
    PIL.Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "a.png")
    given = scales | {"uoffset": 0.25, "voffset": 0.5}
    told = "".join(f'<float name="{name}" value="{value}"/>' for name, value in given.items())
    texture = f'<texture type="bitmap" name="reflectance"><string name="filename" value="a.png"/>{told}</texture>'
    _, world = material(tmp_path, f'<bsdf type="diffuse">{texture}</bsdf>', "0.6.0")
    matrix = np.array(world.textures[0].uv_matrix)
    for u, v in ((0.0, 0.0), (0.3, 0.6)):
        across, up = matrix @ (u, 1 - v, 1)
        assert (across, 1 - up) == pytest.approx(
            (scales.get("uscale", 4) * u + 0.25, scales.get("vscale", 4) * v + 0.5)
        )


@pytest.mark.parametrize(
    ("told", "srgb"),
    [("", True), ('<float name="gamma" value="1"/>', False), ('<float name="gamma" value="2.2"/>', True),
     ('<boolean name="raw" value="true"/>', False)],
)  # fmt: skip
def test_raw_pictures_and_those_of_gamma_1_are_linear(tmp_path, told, srgb):
    PIL.Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "a.png")
    texture = f'<texture type="bitmap" name="reflectance"><string name="filename" value="a.png"/>{told}</texture>'
    _, world = material(tmp_path, f'<bsdf type="diffuse">{texture}</bsdf>')
    assert world.textures[0].srgb is srgb


@pytest.mark.parametrize(("told", "roughness"), [(None, 0.5), (0.3, 0.3), (1.0, 1.0), (7.0, 1.0)])
def test_principled_roughness_is_the_root_of_alpha(tmp_path, told, roughness):
    value = "" if told is None else f'<float name="roughness" value="{told}"/>'
    found, _ = material(tmp_path, f'<bsdf type="principled">{value}</bsdf>')
    assert found.alpha == pytest.approx(roughness**2)


@pytest.mark.parametrize(("told", "alpha"), [(0.0, 0.1), (0.25, 0.07525), (1.0, 0.001)])
def test_a_coat_of_more_gloss_is_smoother(tmp_path, told, alpha):
    coat = f'<float name="clearcoat" value="0.5"/><float name="clearcoat_gloss" value="{told}"/>'
    found, _ = material(tmp_path, f'<bsdf type="principled">{coat}</bsdf>')
    assert (found.clearcoat, found.clearcoat_alpha) == (0.5, pytest.approx(alpha))


@pytest.mark.parametrize("scale", [None, 2.5])
def test_a_bump_map_is_as_high_as_its_scale(tmp_path, scale):
    PIL.Image.fromarray(np.zeros((2, 2), np.uint8)).save(tmp_path / "a.png")
    told = "" if scale is None else f'<float name="scale" value="{scale}"/>'
    picture = '<texture type="bitmap"><string name="filename" value="a.png"/></texture>'
    found, _ = material(tmp_path, f'<bsdf type="bumpmap">{told}{picture}<bsdf type="diffuse"/></bsdf>')
    assert found.bump_scale == (scale or 1.0) and found.bump_texture >= 0


@pytest.mark.parametrize(("kind", "name"), [("d65", "scale"), ("uniform", "value")])
def test_white_spectra_are_as_bright_as_they_are_told(tmp_path, kind, name):
    spectrum = f'<spectrum type="{kind}" name="intensity"><float name="{name}" value="2.5"/></spectrum>'
    (lamp,) = load(tmp_path, f'<emitter type="point">{spectrum}</emitter><shape type="cube"/>').punctual_lights
    assert lamp.intensity == (2.5, 2.5, 2.5)
