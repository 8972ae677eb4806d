"""What a TOML says of materials, lights, environment maps and lenses."""

import json
import math

import numpy as np
import PIL.Image
import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.light.spectra import METALS

BOX = '[[objects]]\nshape = "box"\nmaterial = "m"\n'


def load(tmp_path, text, camera="position = [0, 0, 9]"):
    path = tmp_path / "scene.toml"
    path.write_text(f"[camera]\n{camera}\n{text}")
    return load_world(path)


def material(tmp_path, text):
    world = load(tmp_path, f"[materials.m]\n{text}\n{BOX}")
    return world.materials[world.meshes[0].material_ids[0]], world


def test_materials(tmp_path):
    gold, _ = material(tmp_path, 'kind = "conductor"\nmetal = "Au"\nroughness = 0.3')
    assert (gold.eta, gold.k) == METALS["Au"]
    assert gold.alpha == pytest.approx(0.09)
    mirror, _ = material(tmp_path, 'kind = "conductor"')
    assert mirror.eta is None and mirror.color == (1, 1, 1) and mirror.alpha == 0
    own, _ = material(tmp_path, 'kind = "conductor"\neta = [1, 2, 3]\nk = [4, 5, 6]')
    assert (own.eta, own.k) == ((1, 2, 3), (4, 5, 6))
    glass, _ = material(tmp_path, 'kind = "dielectric"\nior = 1.7')
    assert (glass.kind, glass.ior, glass.color) == ("dielectric", 1.7, (1, 1, 1))
    paint, _ = material(
        tmp_path, 'kind = "principled"\nmetallic = 0.4\nclearcoat = 0.5\nclearcoat_roughness = 0.2\ntransmission = 0.1'
    )
    assert (paint.metallic, paint.clearcoat, paint.transmission) == (0.4, 0.5, 0.1)
    assert paint.clearcoat_alpha == pytest.approx(0.04)


def test_every_property_of_a_surface_can_be_said(tmp_path):
    """What only some kinds have, each by the name that `Material` gives it."""
    plastic, _ = material(tmp_path, 'kind = "plastic"\ndistribution = "beckmann"\nnonlinear = true')
    assert (plastic.distribution, plastic.nonlinear) == ("beckmann", True)
    said = {
        "stretch": 2.0,
        "absorption": (1.0, 2.0, 3.0),
        "specular_tint": 0.1,
        "sheen": 1.5,
        "sheen_tint": 0.3,
        "flatness": 0.4,
        "bump_scale": 0.01,
    }
    lines = "\n".join(f"{key} = {json.dumps(value)}" for key, value in said.items())
    PIL.Image.new("RGB", (2, 2)).save(tmp_path / "heights.png")
    text = f'kind = "disney"\n{lines}\nbump_texture = {{ file = "heights.png" }}'
    found, world = material(tmp_path, text)
    assert found.kind == "disney" and {key: getattr(found, key) for key in said} == said
    assert not world.textures[found.bump_texture].srgb
    with pytest.raises(InputError, match=r"ior is 1\.0, expected more than 1"):
        material(tmp_path, 'kind = "disney"\nior = 1.0')


def test_textures_come_from_files_in_the_folder(tmp_path):
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
    PIL.Image.fromarray(pixels).save(tmp_path / "a.png")
    image = '{ file = "a.png", wrap = "mirror", nearest = true, repeats = [2.0, 3.0] }'
    m, world = material(
        tmp_path,
        f'kind = "principled"\ntexture = {image}\nnormal_texture = {{ file = "a.png" }}\n'
        'roughness_texture = { file = "a.png" }\n'
        f'opacity_texture = {image}\nalpha_mode = "blend"',
    )
    color, normal = world.textures[m.texture], world.textures[m.normal_texture]
    np.testing.assert_array_equal(color.pixels, pixels)
    assert (color.srgb, color.wrap_u, color.nearest, m.color) == (True, "mirror", True, (1, 1, 1))
    np.testing.assert_allclose(np.array(color.uv_matrix) @ (1, 1, 1), (2, 3))
    assert (normal.srgb, normal.wrap_v) == (False, "repeat")
    assert not world.textures[m.roughness_texture].srgb
    assert m.alpha_mode == "blend" and m.opacity_texture >= 0


def test_lights(tmp_path):
    text = """
        [[lights]]
        kind = "spot"
        intensity = [1, 2, 3]
        position = [0, 5, 0]
        look_at = [0, 0, 0]
        inner_deg = 10
        outer_deg = 20
        [[lights]]
        kind = "directional"
        intensity = [4, 4, 4]
        rotation_deg = [-90, 0, 0]
        [[lights]]
        kind = "point"
        intensity = [1, 1, 1]
        keyframes = [{ time_s = 0, position = [0, 0, 0] }, { time_s = 3, position = [3, 0, 0] }]
        [[objects]]
        shape = "box"
    """
    world = load(tmp_path, text)
    spot, sun, point = world.punctual_lights
    assert (spot.kind, spot.intensity, spot.inner_deg, spot.outer_deg) == ("spot", (1, 2, 3), 10, 20)
    for light in (spot, sun):
        np.testing.assert_allclose(-light.motion.pose(0)[:3, 2], (0, -1, 0), atol=1e-9)
    np.testing.assert_allclose(point.motion.pose(1.0)[:3, 3], (1, 0, 0), atol=1e-9)
    assert world.duration_s == 3


def test_a_picture_of_the_widest_spot_has_an_end(tmp_path):
    """At a right angle it would have none; 89° are next to it."""
    PIL.Image.new("RGB", (2, 2)).save(tmp_path / "slide.png")
    spot = "[[lights]]\nkind = 'spot'\nintensity = [1, 1, 1]\nouter_deg = 90\npicture = {file = 'slide.png'}\n"
    (light,) = load(tmp_path, spot + BOX.replace('material = "m"\n', "")).punctual_lights
    assert light.picture_size == pytest.approx((57.29, 57.29), rel=1e-3)


def test_environment_maps_turn_about_the_vertical(tmp_path):
    PIL.Image.fromarray(np.full((4, 8, 3), 255, np.uint8)).save(tmp_path / "sky.png")
    text = '[environment]\nmap = "sky.png"\nmap_scale = 2.5\nmap_rotation_deg = 90\n[[objects]]\nshape = "box"\n'
    environment = load(tmp_path, text).environment_map
    np.testing.assert_allclose(environment.radiance, 2.5)
    np.testing.assert_allclose(environment.to_world @ (0, 0, -1), (-1, 0, 0), atol=1e-12)


def test_lenses_and_focal_lengths(tmp_path):
    camera = (
        "position = [0, 0, 9]\nfocal_length_mm = 18\nshutter_s = 0.01\n"
        "lens = { aperture_radius_m = 0.02, focus_distance_m = 3, distortion = [0.1, -0.2, 0, 0, 0] }"
    )
    world = load(tmp_path, '[[objects]]\nshape = "box"\n', camera)
    assert world.camera.fov_deg == pytest.approx(90)
    assert (world.camera.lens.aperture_radius_m, world.camera.lens.focus_distance_m) == (0.02, 3)
    assert world.camera.lens.distortion == (0.1, -0.2, 0, 0, 0)
    wide = load(
        tmp_path, '[[objects]]\nshape = "box"\n', "position = [0, 0, 9]\nfocal_length_mm = 18\nsensor_width_mm = 18"
    )
    assert wide.camera.fov_deg == pytest.approx(2 * math.degrees(math.atan(0.5)))


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ('kind = "conductor"\nmetal = "Xx"', "materials.m: metal is 'Xx', expected one of a-C, Ag"),
        ('metal = "Au"\neta = [1, 1, 1]\nk = [1, 1, 1]', "has metal and eta"),
        ("eta = [1, 1, 1]", "one of eta and k"),
        ('texture = { file = "no.png" }', "'no.png' is missing"),
        ('texture = { file = "../no.png" }', "'../no.png' is missing"),
        ('texture = { file = "scene.toml" }', "cannot be decoded as an image"),
        ('texture = { file = "a.png", wrap = "round" }', "materials.m.texture.wrap"),
        ("roughness = 2", "materials.m.roughness"),
        ('kind = "wood"', "materials.m.kind"),
        ("roughness = 0.5", "materials.m.roughness: diffuse materials have none, expected the kind conductor or diel"),
        (
            'kind = "plastic"\nstretch = 2.0',
            "stretch: plastic materials have none, expected the kind conductor or diel",
        ),
        ('kind = "principled"\nsheen = 1.0', "sheen: principled materials have none, expected the kind disney"),
    ],
)
def test_wrong_surfaces(tmp_path, text, part):
    with pytest.raises(InputError) as caught:
        material(tmp_path, text)
    assert part in str(caught.value)


def test_a_material_of_ones_own_covers_the_colours_of_a_file(tmp_path):
    corners = ["0 0 0 255 0 0", "1 0 0 0 255 0", "0 1 0 0 0 255"]
    names = [*(f"float {axis}" for axis in "xyz"), *(f"uchar {color}" for color in ("red", "green", "blue"))]
    head = ["ply", "format ascii 1.0", "element vertex 3", *(f"property {name}" for name in names)]
    text = [*head, "element face 1", "property list uchar int vertex_indices", "end_header", *corners, "3 0 1 2"]
    (tmp_path / "a.ply").write_text("\n".join(text) + "\n")
    told = '[[objects]]\nfile = "a.ply"\n'
    assert load(tmp_path, told).meshes[0].colors is not None
    covered = load(tmp_path, f'[materials.m]\ncolor = [0.1, 0.2, 0.3]\n{told}material = "m"\n')
    mesh = covered.meshes[0]
    assert covered.materials[mesh.material_ids[0]].color == (0.1, 0.2, 0.3) and mesh.colors is None


def test_a_spots_inner_cone_is_no_wider_than_the_outer(tmp_path):
    (tmp_path / "a.toml").write_text(
        '[camera]\nposition = [0.0, 0.0, 3.0]\n[[lights]]\nkind = "spot"\nintensity = [1.0, 1.0, 1.0]\n'
        "inner_deg = 50.0\nouter_deg = 30.0\n"
    )
    (spot,) = load_world(tmp_path / "a.toml").punctual_lights
    assert (spot.inner_deg, spot.outer_deg) == (30, 30)
