"""Spots and projectors that show a picture on a wall."""

from dataclasses import replace

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene import ImageTexture, Material, PunctualLight, Static, load_world, validate
from tests.render import hand_worlds as hw

LEFT, RIGHT, BELOW = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
SLIDE = np.zeros((2, 2, 4), np.uint8)
SLIDE[0, 0, :3], SLIDE[0, 1, :3], SLIDE[1, :, :3] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
"""Red on top to the left, green to the right, blue below."""


def wall(light, distance=2.0):
    """A matt wall, seen from its lamp's own place; 32×32 pixels show 4×4 m of it."""
    slide = ImageTexture(SLIDE, nearest=True)
    view = hw.camera(hw.look_from((0, 0, distance), (0, 0, 0)), 32, 32, fov_deg=90.0)
    square = hw.quad((-9, -9, 0), (18, 0, 0), (0, 18, 0))
    half = Material(color=(0.5, 0.5, 0.5))
    return replace(hw.world(square, materials=(half,), view=view, punctual_lights=(light,)), textures=(slide,))


def lamp(**more):
    pose = Static(hw.translation(0, 0, 2))
    return PunctualLight("spot", (8.0, 8.0, 8.0), pose, 0.0, 60.0, picture=0, picture_size=(0.5, 0.25), **more)


def colors(picture):
    """The wall's light where the slide has its four parts."""
    return [tuple(picture[:, y, x].round(5)) for y, x in ((13, 10), (13, 20), (18, 10), (18, 20))]


@pytest.mark.slow
def test_a_projector_lights_a_wall_evenly_within_its_frame():
    """It is 2 m wide and 1 m high at 2 m, and pixels are 1/8 m. Light is I/d²·ρ/π all over, and none outside."""
    picture = hw.radiance(hw.render(wall(lamp(falloff="frame")), spp=4, max_depth=2, variances=False))
    even = 8.0 / 4.0 * 0.5 / np.pi
    lit = picture.sum(axis=0) > 0
    assert lit[12:20, 8:24].all() and lit.sum() == 8 * 16
    np.testing.assert_allclose(picture.sum(axis=0)[lit], even, rtol=1e-4)
    red, green, left, right = colors(picture / even)
    for found, expected in ((red, LEFT), (green, RIGHT), (left, BELOW), (right, BELOW)):
        np.testing.assert_allclose(found, expected, atol=1e-3)


@pytest.mark.slow
def test_a_spot_keeps_its_falloff_under_its_picture():
    """White instead of the slide is the plain spot; the slide takes its share of that."""
    slide = wall(lamp(falloff="smooth"))
    plain = replace(slide, punctual_lights=(replace(slide.punctual_lights[0], picture=-1),))
    seen, white = (hw.radiance(hw.render(each, spp=64, max_depth=2)) for each in (slide, plain))
    inside = (slice(None), slice(12, 20), slice(8, 24))
    np.testing.assert_allclose(seen.sum(axis=0)[inside[1:]], white[0][inside[1:]], rtol=0.02)
    assert [np.argmax(each) for each in colors(seen)] == [0, 1, 2, 2]


def test_a_picture_that_is_none_is_told():
    for light, said in (
        (replace(lamp(), picture=3), "picture is 3"),
        (replace(lamp(), picture_size=(0, 1)), "_size is"),
    ):
        with pytest.raises(InputError, match=said):
            validate(wall(light), "made")


def test_a_spot_of_a_toml_shows_its_picture_over_its_cone(tmp_path):
    import PIL.Image

    PIL.Image.fromarray(SLIDE).save(tmp_path / "slide.png")
    text = (
        '[camera]\nposition = [0, 0, 9]\n[[objects]]\nshape = "box"\n'
        '[[lights]]\nkind = "{kind}"\nintensity = [1, 1, 1]\n'
    )
    scene = tmp_path / "scene.toml"
    scene.write_text(text.format(kind="spot") + 'outer_deg = 45\npicture = { file = "slide.png", nearest = true }')
    world = load_world(scene)
    (light,) = world.punctual_lights
    assert light.picture_size == pytest.approx((1, 1))
    np.testing.assert_array_equal(world.textures[light.picture].pixels[..., :3], SLIDE[..., :3])
    scene.write_text(text.format(kind="point") + 'picture = { file = "slide.png" }')
    with pytest.raises(InputError, match=r"lights\[0\].picture: expected it of a spot only"):
        load_world(scene)
