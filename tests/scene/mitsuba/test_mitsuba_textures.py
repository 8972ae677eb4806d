"""Mitsuba's textures of light: pictures end at 1, and light does not."""

import numpy as np
import pytest

from clsim.scene.pictures.images import decode_srgb
from tests.scene.mitsuba.mitsuba_files import load

LIGHTS = [(0.2, 0.1, 0.4), (0.5, 3.0, 1.0), (8.0, 0.0, 2.0)]


@pytest.mark.parametrize("second", LIGHTS)
@pytest.mark.parametrize("first", LIGHTS)
def test_a_checkerboard_of_light_is_as_bright_as_its_colours_whichever_is_brighter(tmp_path, first, second):
    colors = "".join(f'<rgb name="color{k}" value="{r}, {g}, {b}"/>' for k, (r, g, b) in enumerate((first, second)))
    squares = f'<texture type="checkerboard" name="radiance">{colors}</texture>'
    world = load(tmp_path, f'<shape type="rectangle"><emitter type="area">{squares}</emitter></shape>')
    lamp = world.materials[world.meshes[0].material_ids[0]]
    codes = world.textures[lamp.emission_texture].pixels[..., :3]
    light = decode_srgb(codes / 255.0) * lamp.emission
    for color, square in ((first, light[0, 0]), (second, light[0, 1]), (first, light[1, 1]), (second, light[1, 0])):
        np.testing.assert_allclose(square, color, atol=0.005 * max(1.0, *first, *second))
