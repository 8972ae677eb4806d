"""Layers of glTF's materials for which other properties stand in: brushed grooves and thin films."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from clsim.scene.gltf.layers import reflected_by_film, roughness_between
from clsim.scene.gltf.scene import load_gltf
from tests.scene.gltf.gltf_files import gltf, image_uri, write_gltf


def test_a_film_reflects_as_the_closed_forms_say() -> None:
    """None of a quarter of a wave at the root of the index below; twice that thickness, and none, change nothing."""
    below = 1.69
    bare = ((below - 1) / (below + 1)) ** 2
    quarter_nm = 550.0 / (4 * 1.3)
    assert reflected_by_film((bare,) * 3, 1.0, 1.3, quarter_nm)[1] == pytest.approx(0.0, abs=1e-12)
    assert reflected_by_film((bare,) * 3, 1.0, 1.3, 2 * quarter_nm)[1] == pytest.approx(bare)
    assert reflected_by_film((bare,) * 3, 1.0, 1.3, 0.0) == pytest.approx((bare,) * 3)
    # At a quarter of a wave it is ((n² − n₃) / (n² + n₃))², with n the film's index.
    much = reflected_by_film((bare,) * 3, 1.0, 2.0, 550.0 / 8.0)[1]
    assert much == pytest.approx(((4.0 - below) / (4.0 + below)) ** 2)
    assert reflected_by_film((bare,) * 3, 0.25, 2.0, 550.0 / 8.0)[1] == pytest.approx(bare + 0.25 * (much - bare))


def test_grooves_are_as_rough_as_the_mean_of_both_ways() -> None:
    assert roughness_between(0.09, 0.0) == pytest.approx(0.09)
    assert roughness_between(0.09, 1.0) == pytest.approx(0.3)


def test_pictures_of_layers_count_by_the_mean_of_their_own_channels(tmp_path: Path) -> None:
    """Strength of grooves in blue, share of a film in red, its thickness in green."""
    red, green, blue = 50 / 255, 150 / 255, 200 / 255
    thickness = {"iridescenceThicknessMinimum": 100.0, "iridescenceThicknessMaximum": 400.0}
    film = {"iridescenceFactor": 0.5, "iridescenceIor": 1.8, **thickness}
    film |= {"iridescenceTexture": {"index": 0}, "iridescenceThicknessTexture": {"index": 0}}
    grooves = {"anisotropyStrength": 0.8, "anisotropyTexture": {"index": 0}}
    layers = {"KHR_materials_iridescence": film, "KHR_materials_anisotropy": grooves}
    rough = {"roughnessFactor": 0.3, "metallicFactor": 0.0}
    tree = gltf(
        materials=[{"pbrMetallicRoughness": rough, "extensions": layers}],
        images=[{"uri": image_uri(np.full((2, 2, 3), (50, 150, 200)))}],
        textures=[{"source": 0}],
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    (found, *_) = load_gltf(write_gltf(tmp_path, tree)).materials
    assert found.alpha == pytest.approx(roughness_between(0.09, 0.8 * blue))
    seen = reflected_by_film((0.04,) * 3, 0.5 * red, 1.8, 100.0 + 300.0 * green)
    above = ((found.ior - 1) / (found.ior + 1)) ** 2
    assert [above * channel for channel in found.specular_color] == pytest.approx(seen)


@pytest.mark.parametrize("metallic", [0.0, 0.4, 1.0])
def test_a_film_colours_what_is_metal_of_a_surface(tmp_path: Path, metallic: float) -> None:
    base = (0.9, 0.6, 0.3)
    film = {"iridescenceFactor": 0.7, "iridescenceIor": 1.6, "iridescenceThicknessMaximum": 250.0}
    rough = {"baseColorFactor": [*base, 1.0], "metallicFactor": metallic, "roughnessFactor": 0.3}
    tree = gltf(materials=[{"pbrMetallicRoughness": rough, "extensions": {"KHR_materials_iridescence": film}}])
    tree["meshes"][0]["primitives"][0]["material"] = 0
    (found, *_) = load_gltf(write_gltf(tmp_path, tree)).materials
    filmed = reflected_by_film(base, 0.7, 1.6, 250.0)
    assert max(abs(a - b) for a, b in zip(filmed, base, strict=True)) > 0.02
    assert found.color == pytest.approx(
        tuple((1 - metallic) * a + metallic * b for a, b in zip(base, filmed, strict=True))
    )


@pytest.mark.parametrize(("ior", "thickness_nm"), [(1.3, 100.0), (1.3, 250.0), (2.0, 100.0)])
def test_a_film_on_glass_leaves_its_index_and_gains_nothing(tmp_path: Path, ior: float, thickness_nm: float) -> None:
    """What passes bends as before; in no colour does more than the glass's own light come back."""
    film = {"iridescenceFactor": 1.0, "iridescenceIor": ior, "iridescenceThicknessMaximum": thickness_nm}
    layers = {"KHR_materials_iridescence": film, "KHR_materials_transmission": {"transmissionFactor": 1.0}}
    tree = gltf(materials=[{"pbrMetallicRoughness": {"metallicFactor": 0.0}, "extensions": layers}])
    tree["meshes"][0]["primitives"][0]["material"] = 0
    (found, *_) = load_gltf(write_gltf(tmp_path, tree)).materials
    assert found.ior == pytest.approx(1.5)
    wanted = np.minimum(np.array(reflected_by_film((0.04,) * 3, 1.0, ior, thickness_nm)) / 0.04, 1.0)
    assert found.specular_color == pytest.approx(tuple(wanted))


def test_a_file_has_them_with_a_warning(tmp_path: Path) -> None:
    film = {"iridescenceFactor": 1.0, "iridescenceThicknessMaximum": 550.0 / 8.0}  # of an index of 1.3, unless told
    layers = {"KHR_materials_iridescence": film, "KHR_materials_anisotropy": {"anisotropyStrength": 0.5}}
    tree = gltf(
        materials=[
            {
                "name": "shell",
                "pbrMetallicRoughness": {"roughnessFactor": 0.3, "metallicFactor": 0.0},
                "extensions": layers,
            }
        ]
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    world = load_gltf(write_gltf(tmp_path, tree))
    material = world.materials[0]
    highest = ((material.ior - 1) / (material.ior + 1)) ** 2
    assert highest * material.specular_color[1] == pytest.approx(reflected_by_film((0.04,) * 3, 1.0, 1.3, 68.75)[1])
    assert material.alpha == pytest.approx((0.09 * (0.09 + 0.91 * 0.5**2)) ** 0.5)
    assert sum("of shell" in text and ("films" in text or "anisotropy" in text) for text in world.warnings) == 2
