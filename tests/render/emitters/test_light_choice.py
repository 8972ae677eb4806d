"""Which light is drawn: none is starved, whatever another sends into a wide scene."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.render import SceneData
from clsim.render.accel.upload_geometry import bulk_of
from clsim.render.emitters.light_choice import LEAST_SHARE, arriving, fair
from clsim.scene import Material, PunctualLight, SphereLight, Static
from clsim.scene.motion import Orbit
from tests.render import hand_worlds as hw

pytestmark = pytest.mark.usefixtures("anything")

GREY = Material(color=(0.5, 0.5, 0.5))
SUN_W_M2 = 1000.0


def lamp_in_the_shade(sun):
    """A kilometre of ground, a lamp of 10 W/sr 1 m over it, and a roof that keeps the sun off."""
    ground = hw.quad((-500, 0, 500), (1000, 0, 0), (0, 0, -1000))
    roof = hw.quad((-5, 3, 5), (10, 0, 0), (0, 0, -10))
    view = hw.camera(hw.look_from((0, 0.9, 0), (0, 0, 0), up=(0, 0, -1)), 8, 8, fov_deg=0.2)
    lights = [PunctualLight("point", (10.0,) * 3, Static(hw.translation(0, 1, 0)))]
    spheres = []
    if sun == "directional":
        pose = hw.look_from((0, 1, 0.01), (0, 0, 0))
        lights.append(PunctualLight("directional", (SUN_W_M2,) * 3, Static(pose)))
    if sun == "sphere":
        radiance = SUN_W_M2 / (np.pi * 0.00465**2)
        spheres = [SphereLight(465.0, (radiance,) * 3, Static(hw.translation(0, 1e5, 0)))]
    return hw.world(
        ground, roof, materials=(GREY,), view=view, punctual_lights=tuple(lights), sphere_lights=tuple(spheres)
    )


@pytest.mark.slow  # kernels of their own are compiled
@pytest.mark.parametrize("sun", ["directional", "sphere"])
def test_a_lamp_is_not_starved_by_the_sun(sun):
    """Radiance 0.5/π·10 W/m²; a sample is that over its probability p, or 0: its deviation is the mean's √(1/p − 1)."""
    spp = 256
    frame = hw.render(lamp_in_the_shade(sun), spp=spp, max_depth=2)
    mean, error = hw.mean_and_error(frame)
    expected = 0.5 / np.pi * 10.0
    assert np.all(np.abs(mean - expected) < 4 * error + 1e-3 * expected)
    one_sample = error * np.sqrt(spp * 64)
    assert np.all(one_sample < expected * np.sqrt(2 / LEAST_SHARE))


def test_what_is_far_gets_no_more_than_what_is_near():
    far = np.array([False, True, False, True])
    np.testing.assert_allclose(fair(np.array([2.0, 30.0, 4.0, 10.0]), far, 0), [2.0, 4.5, 4.0, 1.5])
    np.testing.assert_allclose(fair(np.array([2.0, 3.0, 4.0, 1.0]), far, 0), [2.0, 3.0, 4.0, 1.0])
    alone = np.array([3.0, 1.0])
    np.testing.assert_array_equal(fair(alone, np.array([True, True]), 0), alone)


def test_small_lights_get_a_least_share_unless_they_are_dark():
    power = np.array([1000.0, 0.001, 0.0, 100.0])
    drawn = fair(power, np.zeros(4, bool), 3)
    np.testing.assert_allclose(drawn, [1000.0, LEAST_SHARE / 3 * 1100.001, 0.0, 100.0])


def test_of_a_far_light_the_power_arrives_that_the_scene_covers():
    """A disc of radius r at distance d, of a sphere: π·r² / (4·π·d²)."""
    assert arriving(1000.0, 2.0) == pytest.approx(np.pi * 4 / (4 * np.pi * 1e6))
    assert arriving(5.0, 2.0) == 1.0


@pytest.mark.slow
def test_lamps_that_are_all_off_are_no_reason_to_crash():
    """Several lights that stand still bring the light tree in, and then none of them is in it."""
    off = tuple(SphereLight(0.5, (0.0, 0.0, 0.0), Static(hw.translation(x, 2.0, 0.0))) for x in (-3.0, 3.0))
    view = hw.camera(hw.look_from((0.0, 1.0, 2.0), (0.0, 0.0, 0.0)), 8, 8, fov_deg=40)
    scene = hw.world(hw.quad((-9, 0, 9), (18, 0, 0), (0, 0, -18)), view=view, sphere_lights=off)
    assert np.all(hw.radiance(hw.render(scene, spp=4)) == 0)


def test_a_speck_that_is_far_off_takes_no_draws_from_lamps():
    """How much of the sky's light comes in goes by how large the scene is, and a bird far away makes it no larger."""
    floor = hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4))
    bird = hw.box((-0.01, 300.0, 0.0), (0.01, 300.02, 0.02))
    lamp = SphereLight(0.2, (40.0, 40.0, 40.0), Static(hw.translation(0.0, 2.0, 0.0)))
    shares = []
    for meshes in ((floor,), (floor, bird)):
        motions = [hw.IDENTITY, Orbit((0.0, 300.0, 0.0), 1.0, 1.0)][: len(meshes)]
        scene = hw.world(*meshes, motions=motions, sphere_lights=(lamp,), environment=(0.01, 0.01, 0.01))
        shares.append(SceneData(scene).scene.lights.environment_probability)
    assert shares[0] == pytest.approx(shares[1], rel=1e-6)
    assert 0.0 < shares[0] < 0.4


def test_a_scene_is_as_large_as_nearly_all_of_it():
    lowers = np.array([[0.0, 0, 0], [100, 0, 0], [-2, 0, 0], [3, 3, 3]])
    uppers = lowers + np.array([[4.0], [0.05], [0.05], [4.0]])
    middle, radius_m = bulk_of(lowers, uppers)
    np.testing.assert_allclose(middle, 3.5)
    assert radius_m == pytest.approx(3.5 * np.sqrt(3))
    np.testing.assert_allclose(bulk_of(lowers[1:2], uppers[1:2])[0], middle * 0 + [100.025, 0.025, 0.025])
