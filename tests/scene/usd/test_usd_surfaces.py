"""Materials of USD that are told by MaterialX, and colours that meshes give them."""

import numpy as np
import pytest
from PIL import Image

from clsim.scene import load_world
from tests.scene.usd.usd_files import mesh, usda


def materials_of(tmp_path, kind, inputs, *, nodes="", output="mtlx:surface", extra=""):
    """The world of a square with a surface of that kind, and its material."""
    listed = "\n".join(inputs)
    material = f"""def Material "M" {{
        token outputs:{output}.connect = </M/S.outputs:surface>
        def Shader "S" {{
            uniform token info:id = "{kind}"
            {listed}
            token outputs:surface }}
        {nodes} }}
"""
    square = mesh("rel material:binding = </M>\n" + extra).replace(
        'def Mesh "square"', 'def Mesh "square" (prepend apiSchemas = ["MaterialBindingAPI"])'
    )
    world = load_world(usda(tmp_path, square + material))
    return world, world.materials[world.meshes[0].material_ids[0]]


def test_standard_surface(tmp_path):
    inputs = [
        "float inputs:base = 0.5",
        "color3f inputs:base_color = (0.8, 0.6, 0.4)",
        "float inputs:metalness = 0.25",
        "float inputs:specular_roughness = 0.4",
        "float inputs:specular_IOR = 1.8",
        "float inputs:specular = 0.7",
        "float inputs:coat = 0.3",
        "float inputs:coat_roughness = 0.2",
        "float inputs:transmission = 0.1",
        "float inputs:emission = 2",
        "color3f inputs:emission_color = (1, 0.5, 0.25)",
        "color3f inputs:opacity = (0.5, 0.5, 0.5)",
        "float inputs:sheen = 0.6",
    ]
    world, made = materials_of(tmp_path, "ND_standard_surface_surfaceshader", inputs)
    assert made.color == pytest.approx((0.4, 0.3, 0.2)) and made.metallic == 0.25
    assert made.alpha == pytest.approx(0.16) and made.ior == pytest.approx(1.8)
    assert made.specular_color == pytest.approx((0.7,) * 3)
    assert (made.clearcoat, made.clearcoat_alpha, made.transmission) == pytest.approx((0.3, 0.04, 0.1))
    assert made.emission == pytest.approx((2, 1, 0.5)) and made.opacity == pytest.approx(0.5)
    assert made.alpha_mode == "blend" and any("sheen of materials is left out" in text for text in world.warnings)


@pytest.mark.parametrize(
    ("kind", "color", "roughness", "metallic", "coat", "coat_roughness"),
    [
        ("ND_standard_surface_surfaceshader", 0.8, 0.2, 0, "coat", 0.1),
        ("ND_open_pbr_surface_surfaceshader", 0.8, 0.3, 0, "coat_weight", 0),
        ("ND_gltf_pbr_surfaceshader", 1.0, 1.0, 1, "clearcoat", 0),
        ("ND_UsdPreviewSurface_surfaceshader", 0.18, 0.5, 0, "clearcoat", 0.01),
    ],
)
def test_defaults_are_those_of_each_specification(tmp_path, kind, color, roughness, metallic, coat, coat_roughness):
    world, made = materials_of(tmp_path, kind, [f"float inputs:{coat} = 1"])
    assert made.color == pytest.approx((color,) * 3) and (made.metallic, made.ior) == (metallic, 1.5)
    assert (made.alpha, made.clearcoat_alpha) == pytest.approx((roughness**2, coat_roughness**2))
    assert made.emission == (0, 0, 0) and made.opacity == 1 and not world.warnings


def test_a_surface_for_any_renderer_comes_before_that_of_materialx(tmp_path):
    nodes = """token outputs:surface.connect = </M/U.outputs:surface>
        def Shader "U" { uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0, 1, 0)
            token outputs:surface }"""
    inputs = ["color3f inputs:base_color = (1, 0, 0)"]
    assert materials_of(tmp_path, "ND_standard_surface_surfaceshader", inputs, nodes=nodes)[1].color == (0, 1, 0)


def test_open_pbr_shines_in_candelas_a_square_metre(tmp_path):
    inputs = ["float inputs:emission_luminance = 1366", "float inputs:geometry_opacity = 0.25"]
    _, made = materials_of(tmp_path, "ND_open_pbr_surface_surfaceshader", inputs)
    assert made.emission == pytest.approx((2, 2, 2)) and made.opacity == 0.25


@pytest.mark.parametrize(("space", "srgb"), [("srgb_texture", True), ("lin_rec709", False), ("raw", False)])
def test_pictures_of_materialx(tmp_path, space, srgb):
    Image.fromarray(np.full((2, 2, 3), 128, np.uint8)).save(tmp_path / "a.png")
    nodes = f"""def Shader "P" {{
        uniform token info:id = "ND_image_color3"
        asset inputs:file = @a.png@ (colorSpace = "{space}")
        string inputs:uaddressmode = "clamp"
        float2 inputs:texcoord.connect = </M/T.outputs:out>
        color3f outputs:out }}
    def Shader "T" {{
        uniform token info:id = "ND_geompropvalue_vector2"
        string inputs:geomprop = "map1"
        float2 outputs:out }}
    def Shader "N" {{
        uniform token info:id = "ND_normalmap"
        float3 inputs:in.connect = </M/Q.outputs:out>
        float3 outputs:out }}
    def Shader "Q" {{
        uniform token info:id = "ND_image_vector3"
        asset inputs:file = @a.png@
        float3 outputs:out }}"""
    inputs = [
        "color3f inputs:base_color.connect = </M/P.outputs:out>",
        "float3 inputs:normal.connect = </M/N.outputs:out>",
    ]
    uvs = 'texCoord2f[] primvars:map1 = [(0, 0), (3, 0), (3, 3), (0, 3)] (interpolation = "vertex")'
    world, made = materials_of(tmp_path, "ND_standard_surface_surfaceshader", inputs, nodes=nodes, extra=uvs)
    picture = world.textures[made.texture]
    assert picture.srgb == srgb and (picture.wrap_u, picture.wrap_v) == ("clamp", "repeat")
    assert not world.textures[made.normal_texture].srgb
    assert world.meshes[0].uvs.max() == 3 and not world.warnings


PICTURE = """def Shader "P" { uniform token info:id = "ND_image_color3"
    asset inputs:file = @a.png@
    color3f outputs:out }"""


@pytest.mark.parametrize(
    ("connected", "told", "shown"),
    [
        ("base_color", ["color3f inputs:default = (0.2, 0.2, 0.2)"], ("", "color", 0.2)),
        ("base_color", ["float inputs:base = 0.5"], ("texture", "color", 0.5)),
        ("base_color", ["float inputs:transmission = 1", "bool inputs:thin_walled = 1"], ("", "color", 1.0)),
        (
            "coat_color",
            ["float inputs:coat = 1", "color3f inputs:base_color = (.3, .3, .3)"],
            ("texture", "color", 0.3),
        ),
        (
            "coat_color",
            ["float inputs:coat = 1", "color3f inputs:base_color.connect = </M/P.outputs:out>"],
            ("texture", "color", 1.0),
        ),
        ("coat_color", ["float inputs:coat = 0"], ("", "color", 0.8)),
        ("emission_color", ["float inputs:emission = 2"], ("emission_texture", "emission", 2.0)),
        ("emission_color", ["float inputs:emission = 0"], ("", "emission", 0.0)),
    ],
)
def test_pictures_are_multiplied_by_what_else_is_told_and_gone_where_they_do_not_show(tmp_path, connected, told, shown):
    Image.fromarray(np.full((2, 2, 3), 128, np.uint8)).save(tmp_path / "a.png")
    missing = "".join(each for each in told if "inputs:default" in each)
    nodes = PICTURE.replace("@a.png@", f"@gone.png@\n{missing}") if missing else PICTURE
    inputs = [f"color3f inputs:{connected}.connect = </M/P.outputs:out>", *(each for each in told if each != missing)]
    _, made = materials_of(tmp_path, "ND_standard_surface_surfaceshader", inputs, nodes=nodes)
    where, factor, value = shown
    assert getattr(made, factor) == pytest.approx((value,) * 3)
    assert [name for name in ("texture", "emission_texture") if getattr(made, name) >= 0] == [where] * bool(where)


def test_pictures_of_roughness_and_metalness_may_differ_in_size(tmp_path):
    """Each texel of the smaller one stands for as many of the larger one."""
    for name, row in (("a", [0, 255]), ("b", [0, 85, 170, 255])):
        Image.fromarray(np.array([row], np.uint8)).save(tmp_path / f"{name}.png")
    nodes = PICTURE + "\n" + PICTURE.replace('"P"', '"Q"').replace("@a.png@", "@b.png@")
    inputs = [f"float inputs:{name}.connect = </M/{node}.outputs:out>" for name, node in
              (("specular_roughness", "P"), ("metalness", "Q"))]  # fmt: skip
    world, made = materials_of(
        tmp_path,
        "ND_standard_surface_surfaceshader",
        inputs,
        nodes=nodes.replace("color3", "float").replace("floatf", "float"),
    )
    texels = world.textures[made.roughness_texture].pixels[0]
    assert texels[:, 1].tolist() == [0, 0, 255, 255] and texels[:, 2].tolist() == [0, 85, 170, 255]


def test_tiles_of_materialx_are_as_many_along_each_axis_as_told(tmp_path):
    Image.fromarray(np.full((2, 2, 3), 128, np.uint8)).save(tmp_path / "a.png")
    nodes = """def Shader "P" { uniform token info:id = "ND_tiledimage_color3"
        asset inputs:file = @a.png@
        float2 inputs:uvtiling = (2, 3)
        color3f outputs:out }"""
    inputs = ["color3f inputs:base_color.connect = </M/P.outputs:out>"]
    world, made = materials_of(tmp_path, "ND_standard_surface_surfaceshader", inputs, nodes=nodes)
    assert world.textures[made.texture].uv_matrix == ((2, 0, 0), (0, 3, 0))


def test_a_coloured_coat_tints_what_lies_below(tmp_path):
    inputs = [
        "float inputs:coat = 0.5",
        "color3f inputs:coat_color = (1, 0.5, 0)",
        "color3f inputs:base_color = (1, 1, 1)",
    ]
    _, made = materials_of(tmp_path, "ND_standard_surface_surfaceshader", inputs)
    assert made.color == pytest.approx((1, 0.75, 0.5))


def test_a_picture_for_a_number_counts_by_its_mean(tmp_path):
    """Of the channel that is asked for."""
    Image.fromarray(np.array([[(9, 0, 9), (9, 255, 9)], [(9, 255, 9)] * 2], np.uint8)).save(tmp_path / "a.png")
    nodes = """def Shader "P" {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @a.png@
        token inputs:sourceColorSpace = "raw"
        float outputs:g }"""
    inputs = ["float inputs:clearcoat.connect = </M/P.outputs:g>"]
    world, made = materials_of(tmp_path, "UsdPreviewSurface", inputs, nodes=nodes, output="surface")
    assert made.clearcoat == pytest.approx(0.75)
    assert any("the mean of clearcoat textures" in text for text in world.warnings)


def test_nothing_is_thinner_than_air_nor_bends_light_more_than_any_matter(tmp_path):
    for told, ior in ((0.0, 1.0), (1.7, 1.7), (9.0, 9.0), (99.0, 10.0)):
        _, made = materials_of(tmp_path, "UsdPreviewSurface", [f"float inputs:ior = {told}"], output="surface")
        assert made.ior == pytest.approx(ior)


COLORS = 'color3f[] primvars:{} = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0)] (interpolation = "vertex")'


@pytest.mark.parametrize(
    ("kind", "other"), [("UsdPrimvarReader_float3", "displayColor"), ("ND_geomcolor_color3", "tint")]
)
def test_colours_of_a_mesh_reach_its_material(tmp_path, kind, other):
    nodes = f"""def Shader "R" {{
        uniform token info:id = "{kind}"
        string inputs:varname = "tint"
        float3 outputs:result }}"""
    inputs = ["color3f inputs:diffuseColor.connect = </M/R.outputs:result>"]
    name = "tint" if other == "displayColor" else "displayColor"
    extra = COLORS.format(name) + "\n" + COLORS.format(other).replace("(1, 0, 0)", "(0, 0, 0)")
    world, made = materials_of(tmp_path, "UsdPreviewSurface", inputs, nodes=nodes, output="surface", extra=extra)
    assert made.color == (1, 1, 1) and world.meshes[0].colors[0].tolist() == [1, 0, 0] and not world.warnings


def test_a_material_of_its_own_hides_the_colours_of_a_mesh(tmp_path):
    """As in usdview: they are for what has no material."""
    inputs = ["color3f inputs:diffuseColor = (0.5, 0.5, 0.5)"]
    extra = COLORS.format("displayColor")
    world, made = materials_of(tmp_path, "UsdPreviewSurface", inputs, output="surface", extra=extra)
    assert made.color == (0.5, 0.5, 0.5) and world.meshes[0].colors is None
    bare = load_world(usda(tmp_path, mesh(extra.replace("(1, 0, 0)", "(3, 0, 0)")), name="bare.usda"))
    assert bare.meshes[0].colors[0].tolist() == [1, 0, 0], "no surface reflects more than all"
    assert bare.materials[bare.meshes[0].material_ids[0]].color == (1, 1, 1)


STANDARD, OPEN_PBR, GLTF = (f"ND_{name}_surfaceshader" for name in ("standard_surface", "open_pbr_surface", "gltf_pbr"))


@pytest.mark.parametrize(
    ("kind", "weight", "thin"),
    [(STANDARD, "transmission", "thin_walled"), (OPEN_PBR, "transmission_weight", "geometry_thin_walled")],
)
def test_what_passes_light_has_a_colour_of_its_own(tmp_path, kind, weight, thin):
    all_of_it = [f"float inputs:{weight} = 1", f"bool inputs:{thin} = 1"]
    world, made = materials_of(tmp_path, kind, all_of_it)
    assert made.color == (1, 1, 1) and not world.warnings
    green = "color3f inputs:transmission_color = (0, 1, 0)"
    world, made = materials_of(tmp_path, kind, [*all_of_it, green])
    assert made.color == (0, 1, 0) and not world.warnings
    world, made = materials_of(tmp_path, kind, [f"float inputs:{weight} = 0.5", green])
    assert made.color == pytest.approx((0.8,) * 3) and world.warnings == (
        "scene.usda: what passes light is a thin wall and does not refract (first M)",
        "scene.usda: light that passes in part has the surface's own colour (first that of M)",
    )


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (
            STANDARD,
            "sheen subsurface thin_film_thickness specular_anisotropy coat_anisotropy diffuse_roughness "
            "transmission_depth transmission_dispersion",
        ),
        (
            OPEN_PBR,
            "fuzz_weight subsurface_weight thin_film_weight specular_roughness_anisotropy base_diffuse_roughness "
            "transmission_depth",
        ),
        (GLTF, "iridescence thickness"),
    ],
)
def test_what_surfaces_lack_is_told(tmp_path, kind, names):
    """Those of the specifications whose value of 0 changes nothing."""
    for value, warned in ((0, False), (0.5, True)):
        world, _ = materials_of(tmp_path, kind, [f"float inputs:{name} = {value}" for name in names.split()])
        told = (f"scene.usda: {name} of materials is left out (first that of M)" for name in names.split() * warned)
        assert sorted(world.warnings) == sorted(told)


@pytest.mark.parametrize(
    ("mode", "encoded"),
    [("RGB", True), ("RGBA", True), ("P", True), ("L", False), ("LA", False), ("1", False), ("I;16", False)],
)
def test_pictures_of_8_bits_with_colours_have_srgbs_curve_unless_told(tmp_path, mode, encoded):
    """UsdUVTexture's sourceColorSpace, "auto": 8 bits of three or four channels are sRGB; a palette has three."""
    if mode == "I;16":
        Image.fromarray(np.array([[0, 65535], [32768, 257]], np.uint16)).save(tmp_path / "a.png")
    else:
        Image.new("RGB", (2, 2), (90, 90, 90)).convert(mode).save(tmp_path / "a.png")
    nodes = """def Shader "P" {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @a.png@
        float3 outputs:rgb }"""
    inputs = ["color3f inputs:diffuseColor.connect = </M/P.outputs:rgb>"]
    world, made = materials_of(tmp_path, "UsdPreviewSurface", inputs, nodes=nodes, output="surface")
    assert world.textures[made.texture].srgb == encoded


NORMAL_MAP = """def Shader "N" {
        uniform token info:id = "ND_image_vector3"
        asset inputs:file = @a.png@
        float3 outputs:out }"""
SPECIFIED = {
    "UsdPreviewSurface": "diffuseColor emissiveColor specularColor metallic roughness opacity normal "
    "useSpecularWorkflow ior clearcoat clearcoatRoughness opacityThreshold",
    "ND_standard_surface_surfaceshader": "base base_color metalness specular specular_color specular_roughness "
    "specular_IOR transmission transmission_color thin_walled coat coat_color coat_roughness emission emission_color "
    "opacity normal",
    "ND_open_pbr_surface_surfaceshader": "base_weight base_color base_metalness specular_weight specular_color "
    "specular_roughness specular_ior transmission_weight transmission_color geometry_thin_walled coat_weight "
    "coat_color coat_roughness emission_luminance emission_color geometry_opacity geometry_normal",
    "ND_gltf_pbr_surfaceshader": "base_color metallic roughness normal transmission specular specular_color ior alpha "
    "alpha_mode alpha_cutoff clearcoat clearcoat_roughness emissive emissive_strength",
}
"""The inputs of each specification that clsim shows."""
SHOWN_WITH = {
    "specularColor": ["int inputs:useSpecularWorkflow = 1"],
    "opacityThreshold": ["float inputs:opacity = 0.5"],
    "clearcoatRoughness": ["float inputs:clearcoat = 0.5"],
    "clearcoat_roughness": ["float inputs:clearcoat = 0.5"],
    "coat_roughness": ["float inputs:coat = 0.5", "float inputs:coat_weight = 0.5"],
    "coat_color": ["float inputs:coat = 0.5", "float inputs:coat_weight = 0.5"],
    "transmission_color": [
        *("float inputs:transmission = 1", "float inputs:transmission_weight = 1"),
        *("bool inputs:thin_walled = 1", "bool inputs:geometry_thin_walled = 1"),
    ],
    "emission_color": ["float inputs:emission = 2", "float inputs:emission_luminance = 2000"],
    "emissive_strength": ["color3f inputs:emissive = (0.1, 0.2, 0.3)"],
    "alpha": ["int inputs:alpha_mode = 2"],
    "alpha_mode": ["float inputs:alpha = 0.5"],
    "alpha_cutoff": ["float inputs:alpha = 0.5", "int inputs:alpha_mode = 1"],
}
"""What must have a value for an input to show."""


def authored(kind, name):
    """An input with a value that is not its default."""
    if name.endswith("normal"):
        return f"float3 inputs:{name}.connect = </M/N.outputs:out>"
    if name.endswith(("olor", "emissive")) or (name == "opacity" and "standard" in kind):
        return f"color3f inputs:{name} = (0.3, 0.6, 0.2)"
    if name in ("useSpecularWorkflow", "alpha_mode"):
        return f"int inputs:{name} = 1"
    return f"float inputs:{name} = {2.2 if name.lower().endswith('ior') else 0.37}"


SHOWN = [
    (kind, name)
    for kind, told in SPECIFIED.items()
    for name in told.split()
    if not name.endswith("thin_walled")  # it says how light passes: clsim's surfaces of such materials are thin always
]


@pytest.mark.parametrize(("kind", "name"), SHOWN)
def test_each_input_of_each_kind_of_surface_changes_the_material(tmp_path, kind, name):
    Image.fromarray(np.full((2, 2, 3), 90, np.uint8)).save(tmp_path / "a.png")
    before = SHOWN_WITH.get(name, [])
    _, plain = materials_of(tmp_path, kind, before)
    world, made = materials_of(tmp_path, kind, [*before, authored(kind, name)], nodes=NORMAL_MAP)
    assert made != plain and not any(f"{name} of" in text for text in world.warnings)


@pytest.mark.parametrize(
    ("mode", "cutoff", "seen"),
    [
        ("", "", ("opaque", 1.0)),
        ("int inputs:alpha_mode = 0", "float inputs:alpha_cutoff = 0.2", ("opaque", 1.0)),
        ("int inputs:alpha_mode = 1", "", ("mask", 0.5)),
        ("int inputs:alpha_mode = 1", "float inputs:alpha_cutoff = 0.2", ("mask", 0.2)),
        ("int inputs:alpha_mode = 1", "float inputs:alpha_cutoff = 0", ("opaque", 1.0)),
        ("int inputs:alpha_mode = 2", "float inputs:alpha_cutoff = 0.2", ("blend", 0.3)),
    ],
)
def test_the_mode_of_gltfs_surface_says_what_becomes_of_its_alpha(tmp_path, mode, cutoff, seen):
    """MaterialX, ``gltf_pbr``: 0 is opaque, and the default; 1 cuts where alpha is less than the cut-off; 2 blends."""
    inputs = ["float inputs:alpha = 0.3", *filter(None, (mode, cutoff))]
    _, made = materials_of(tmp_path, "ND_gltf_pbr_surfaceshader", inputs)
    shown = {"opaque": made.opacity, "mask": made.alpha_cutoff, "blend": made.opacity}
    assert (made.alpha_mode, shown[made.alpha_mode]) == (seen[0], pytest.approx(seen[1]))


@pytest.mark.parametrize("kind", ["ND_standard_surface_surfaceshader", "ND_gltf_pbr_surfaceshader"])
def test_a_reflection_has_its_colour_times_its_weight(tmp_path, kind):
    inputs = ["float inputs:specular = 0.5", "color3f inputs:specular_color = (1, 0.6, 0.2)"]
    _, made = materials_of(tmp_path, kind, inputs)
    assert made.specular_color == pytest.approx((0.5, 0.3, 0.1))
