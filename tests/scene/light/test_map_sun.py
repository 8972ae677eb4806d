"""The sun of a picture of the sky becomes a lamp, with the same light from the same direction."""

from dataclasses import replace

import numpy as np
import pytest

from clsim.scene.light.map_sun import part_sun
from clsim.scene.load import load_world
from clsim.scene.modulation import Sine
from clsim.scene.world import EnvironmentMap
from tests.render import hand_worlds as hw

HEIGHT, WIDTH = 128, 256
POLAR = np.pi * (np.arange(HEIGHT) + 0.5) / HEIGHT
TURN = 2 * np.pi * (np.arange(WIDTH) + 0.5) / WIDTH
TOWARDS = np.stack(
    (
        np.sin(POLAR)[:, None] * np.sin(TURN),
        np.cos(POLAR)[:, None] * np.ones(WIDTH),
        -np.sin(POLAR)[:, None] * np.cos(TURN),
    ),
    -1,
)
SOLID_ANGLE = np.broadcast_to(
    2 * np.pi / WIDTH * -np.diff(np.cos(np.pi * np.arange(HEIGHT + 1) / HEIGHT))[:, None], (HEIGHT, WIDTH)
)
QUARTER = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
SUNS = {
    "in the middle": (0.5, 0.6, 0.6),
    "above": (0.0, 1.0, 0.001),
    "at the picture's seam": (0.0, 0.5, -0.8),
    "low": (-0.9, 0.05, 0.1),
}


def sky(to_sun, radius_deg, sun=(900.0, 800.0, 600.0)):
    """A blue sky over dark ground, with a disk in it."""
    radiance = np.where(TOWARDS[..., 1:2] > 0, (0.2, 0.3, 0.5), (0.1, 0.08, 0.05)).astype(np.float32)
    to_sun = np.asarray(to_sun) / np.linalg.norm(to_sun)
    radiance[TOWARDS @ to_sun > np.cos(np.radians(radius_deg))] = sun
    return radiance


def under(radiance, to_world=None, **more):
    above = EnvironmentMap(radiance, np.eye(3) if to_world is None else to_world, **more)
    return hw.world(hw.quad((4, 0, 1), (2, 0, 0), (0, 0, -2)), environment_map=above)


def irradiance(world, normal):
    """Return that of a surface, ``[3]``: from the picture by a sum over its pixels, from spheres in closed form."""
    facing = np.maximum((TOWARDS @ world.environment_map.to_world.T) @ normal, 0.0) * SOLID_ANGLE
    total = np.tensordot(facing, world.environment_map.radiance.astype(float), 2)
    for light in world.sphere_lights:
        place = light.motion.pose(0.0)[:3, 3]
        away = np.linalg.norm(place)
        total = total + np.pi * (light.radius_m / away) ** 2 * max(place @ normal / away, 0.0) * np.array(
            light.radiance
        )
    return total


@pytest.mark.parametrize("to_world", [np.eye(3), QUARTER], ids=["as it is", "turned"])
@pytest.mark.parametrize("to_sun", SUNS.values(), ids=SUNS)
def test_surfaces_get_the_light_that_they_got(to_sun, to_world):
    before = under(sky(to_sun, 2.5), to_world)
    after = part_sun(before)
    assert len(after.sphere_lights) == 1 and after.environment_map.radiance.max() < 0.6
    for normal in ((0.0, 1.0, 0.0), (0.6, 0.64, 0.48), (-0.48, 0.6, -0.64)):
        np.testing.assert_allclose(
            irradiance(after, np.array(normal)), irradiance(before, np.array(normal)), rtol=0.002
        )


@pytest.mark.parametrize(
    ("radius_deg", "radiance"), [(2.5, (900, 800, 600)), (0.8, (9000, 8000, 6000))], ids=["wide", "a pixel"]
)
def test_it_is_as_large_as_it_is_in_the_picture(radius_deg, radiance):
    to_sun = TOWARDS[41, 170]
    picture = sky(to_sun, radius_deg, radiance)
    seen_rad = np.sqrt(SOLID_ANGLE[picture[..., 0] > 100].sum() / np.pi)
    (sun,) = part_sun(under(picture)).sphere_lights
    away = sun.motion.pose(0.0)[:3, 3] - (5.0, 0.0, 0.0)
    assert sun.radius_m / np.linalg.norm(away) == pytest.approx(seen_rad, rel=0.05)
    np.testing.assert_allclose(away / np.linalg.norm(away), to_sun, atol=0.01)
    assert sun.radiance == pytest.approx(radiance, rel=0.1)


def test_skies_without_a_sun_stay_as_they_are():
    worlds = {
        "even": under(np.full((HEIGHT, WIDTH, 3), 0.4, np.float32)),
        "black": under(np.zeros((HEIGHT, WIDTH, 3), np.float32)),
        "a soft box": under(sky((0.5, 0.6, 0.6), 20.0)),
        "a faint star": under(sky((0.5, 0.6, 0.6), 1.5, (5.0, 5.0, 5.0))),
        "of one pixel": under(np.full((1, 2, 3), 0.4, np.float32)),
        "turning": under(sky((0.5, 0.6, 0.6), 2.5), turn_deg_per_s=10.0),
        "over nothing": replace(under(sky((0.5, 0.6, 0.6), 2.5)), meshes=(), instances=()),
        "flickering": replace(under(sky((0.5, 0.6, 0.6), 2.5)), environment_modulation=Sine(100.0)),
    }
    kept = [name for name, world in worlds.items() if part_sun(world) is world]
    assert kept == list(worlds)


def test_a_file_s_sky_has_its_sun(tmp_path):
    radiance = sky((0.5, 0.6, 0.6), 2.5)
    exponent = np.ceil(np.log2(radiance.max(-1)))
    digits = np.clip(radiance / 2.0 ** exponent[..., None] * 256, 0, 255)
    texels = np.concatenate((digits, exponent[..., None] + 128), -1).astype(np.uint8)
    header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {HEIGHT} +X {WIDTH}\n"
    (tmp_path / "sky.hdr").write_bytes(header.encode() + texels.tobytes())
    (tmp_path / "scene.toml").write_text(
        '[camera]\nposition = [0, 1, 3]\nlook_at = [0, 0, 0]\n[environment]\nmap = "sky.hdr"\n'
        '[[objects]]\nname = "floor"\nshape = "quad"\nsize = [2, 2]\n'
    )
    world = load_world(tmp_path / "scene.toml")
    assert [light.radiance for light in world.sphere_lights] == [pytest.approx((900, 800, 600), rel=0.1)]
