"""Light that glTF's animations change (KHR_animation_pointer)."""

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.gltf.scene import load_gltf, read_gltf
from tests.scene.gltf.gltf_files import add, animate, gltf, with_camera, write_gltf

LAMP = "/extensions/KHR_lights_punctual/lights/0/"
STRENGTH = "/materials/0/extensions/KHR_materials_emissive_strength/emissiveStrength"


def file(*channels, **changes):
    """A triangle that glows and a point light, with channels (pointer, times, values, interpolation)."""
    tree = gltf(
        nodes=[{"mesh": 0}, {"name": "lamp", "extensions": {"KHR_lights_punctual": {"light": 0}}}],
        scenes=[{"nodes": [0, 1]}],
        materials=[{"name": "glow", "emissiveFactor": [1.0, 0.5, 0.0]}],
        extensions={
            "KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 683.0, "color": [1.0, 0.5, 0.25]}]}
        },
        extensionsRequired=["KHR_animation_pointer"],
        **changes,
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    animation = {"channels": [], "samplers": []}
    for pointer, times, values, interpolation in channels:
        sampler = {"input": add(tree, times), "output": add(tree, values), "interpolation": interpolation}
        target = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}}
        animation["channels"].append({"sampler": len(animation["samplers"]), "target": target})
        animation["samplers"].append(sampler)
    tree["animations"] = [animation]
    return tree


def light_at(light, time_s):
    """What a lamp or a material sends out at a time."""
    return np.multiply(getattr(light, "intensity", None) or light.emission, light.modulation.mean(time_s, time_s))


def test_a_lamps_intensity_has_the_keyframes_values(tmp_path):
    tree = file((LAMP + "intensity", [0.0, 1.0, 3.0], [0.0, 1366.0, 683.0], "LINEAR"))
    world = load_gltf(write_gltf(tmp_path, with_camera(tree)))
    (lamp,) = world.punctual_lights
    for time_s, watts in ((0.0, 0.0), (0.5, 1.0), (1.0, 2.0), (2.0, 1.5), (9.0, 1.0)):
        assert light_at(lamp, time_s) == pytest.approx(np.multiply(watts, (1.0, 0.5, 0.25))), time_s
    assert world.duration_s == 3.0 and world.warnings == () and lamp.modulation.least_fps == pytest.approx(2.0)


@pytest.mark.parametrize("keys", [([0.0], [1366.0]), ([0.0, 2.0], [1366.0, 1366.0])])
def test_keyframes_that_leave_a_lamp_as_it_is_are_no_change(tmp_path, keys):
    """Then nothing else would fire, so that the camera is set in motion as in any scene that stands still."""
    tree = file((LAMP + "intensity", *keys, "LINEAR"))
    world = load_world(write_gltf(tmp_path, with_camera(tree)))
    (lamp,) = world.punctual_lights
    assert lamp.modulation is None and lamp.intensity == pytest.approx((2.0, 1.0, 0.5))
    assert world.camera.motion.duration_s > 0


def test_colour_and_strength_multiply_along_their_curves(tmp_path):
    """A line times a line is a parabola: half of the way, a half times a half."""
    tree = file(
        ("/materials/0/emissiveFactor", [0.0, 2.0], [[0.0, 1.0, 1.0], [1.0, 1.0, 0.0]], "LINEAR"),
        (STRENGTH, [0.0, 2.0], [0.0, 4.0], "LINEAR"),
    )
    (glow,) = load_gltf(write_gltf(tmp_path, with_camera(tree))).materials
    for time_s in (0.0, 0.5, 1.0, 1.7, 2.0):
        s = time_s / 2
        assert light_at(glow, time_s) == pytest.approx((4 * s * s, 4 * s, 4 * s * (1 - s)), abs=5e-3), time_s
    assert glow.modulation.least_fps == pytest.approx(1.0), "lines that stand for a curve are no events"


def test_splines_are_followed_and_never_negative(tmp_path):
    keys = [[0.0], [0.0], [-8.0], [8.0], [1.0], [0.0]]  # in-tangent, value, out-tangent of both keys
    tree = file((STRENGTH, [0.0, 1.0], keys, "CUBICSPLINE"))
    (glow,) = load_gltf(write_gltf(tmp_path, with_camera(tree))).materials
    times = np.linspace(0.0, 1.0, 65)
    # Hermite's basis (glTF 2.0, appendix C), by hand.
    s = times
    curve = -8 * (s**3 - 2 * s**2 + s) + (3 * s**2 - 2 * s**3) + 8 * (s**3 - s**2)
    seen = np.array([light_at(glow, t)[0] for t in times])
    np.testing.assert_allclose(seen, np.maximum(curve, 0.0), atol=0.02)
    assert curve.min() < -1 and seen.min() == 0


def test_a_lamp_that_is_done_before_the_animation_holds_its_last_value_until_all_repeats(tmp_path):
    tree = file((LAMP + "intensity", [0.0, 1.0], [0.0, 683.0], "LINEAR"))
    animate(tree, (0, "translation", [0.0, 4.0], [(0, 0, 0), (1, 0, 0)], "LINEAR"))
    (lamp,) = read_gltf(write_gltf(tmp_path, tree)).lights
    for time_s, watts in ((0.5, 0.5), (1.0, 1.0), (2.5, 1.0), (3.9, 1.0), (4.5, 0.5), (7.0, 1.0)):
        assert light_at(lamp, time_s) == pytest.approx(np.multiply(watts, (1.0, 0.5, 0.25))), time_s


def test_steps_hold_and_an_asset_without_a_camera_repeats(tmp_path):
    tree = file(
        (LAMP + "intensity", [0.0, 1.0], [683.0, 0.0], "STEP"),
        (LAMP + "color", [0.0, 1.5], [[1.0, 1.0, 1.0], [0.0, 1.0, 0.0]], "STEP"),
        ("/nodes/0/translation", [0.0, 2.0], [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]], "LINEAR"),
    )
    parts = read_gltf(write_gltf(tmp_path, tree))
    (lamp,), (triangle,) = parts.lights, parts.instances
    for time_s, on in ((0.5, 1.0), (1.2, 0.0), (2.0, 1.0), (2.9, 1.0), (3.1, 0.0), (3.9, 0.0)):
        assert light_at(lamp, time_s) == pytest.approx((on, on, on)), "the longest animation gives the period"
    assert triangle.motion.pose(1.0)[0, 3] == pytest.approx(1.0), "a node's place can be pointed at too"


def test_a_line_beside_steps_jumps_where_they_do(tmp_path):
    tree = file(
        (LAMP + "intensity", [0.0, 1.0, 2.0], [683.0, 0.0, 683.0], "STEP"),
        (LAMP + "color", [0.0, 2.0], [[1.0, 1.0, 1.0], [0.0, 0.0, 0.0]], "LINEAR"),
    )
    (lamp,) = load_gltf(write_gltf(tmp_path, with_camera(tree))).punctual_lights
    for time_s, red in ((0.5, 0.75), (0.9999, 0.5), (1.0001, 0.0), (1.99, 0.0)):
        assert light_at(lamp, time_s)[0] == pytest.approx(red, abs=1e-3), time_s


def test_a_curve_of_very_many_keys_has_hardly_more_points(tmp_path, monkeypatch):
    monkeypatch.setattr("clsim.scene.gltf.light._MOST_POINTS", 100)
    keys = np.arange(200.0)
    values = np.stack([0 * keys, keys, 0 * keys], axis=1).ravel().tolist()
    (lamp,) = load_gltf(
        write_gltf(tmp_path, with_camera(file((LAMP + "intensity", keys.tolist(), values, "CUBICSPLINE"))))
    ).punctual_lights
    assert len(lamp.modulation.times_s) < 2 * len(keys)
    np.testing.assert_allclose(light_at(lamp, 150.0), np.multiply(150.0 / 683, (1.0, 0.5, 0.25)), rtol=1e-6)


def test_what_is_not_played_is_named_and_what_is_wrong_refused(tmp_path):
    cone = file((LAMP + "spot/outerConeAngle", [0.0, 1.0], [0.1, 0.2], "LINEAR"))
    warnings = load_gltf(write_gltf(tmp_path, cone)).warnings
    assert warnings == (f"scene.gltf: animations of {LAMP}spot/outerConeAngle are not played",)
    long = file((LAMP.replace("0", "1" * 5000) + "color", [0.0], [1.0, 1.0, 1.0], "LINEAR"))
    assert "are not played" in load_gltf(write_gltf(tmp_path, long)).warnings[0]
    with pytest.raises(InputError, match=r"uses lights\[7\], of 1"):
        load_gltf(write_gltf(tmp_path, file((LAMP.replace("0", "7") + "intensity", [0.0], [1.0], "LINEAR"))))
    with pytest.raises(InputError, match="has 2 numbers, expected 2 keyframes of 1 × 3"):
        load_gltf(write_gltf(tmp_path, file((LAMP + "color", [0.0, 1.0], [1.0, 1.0], "LINEAR"))))
    dark = file((LAMP + "intensity", [0.0, 1.0], [0.0, 0.0], "LINEAR"))
    (lamp,) = load_gltf(write_gltf(tmp_path, dark)).punctual_lights
    assert lamp.intensity == (0.0, 0.0, 0.0) and lamp.modulation is None


def test_what_is_unlit_shows_its_colour_whatever_its_emission_does(tmp_path):
    tree = file((STRENGTH, [0.0, 1.0], [0.0, 4.0], "LINEAR"))
    tree["materials"][0] |= {
        "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.3, 1.0]}, "extensions": {"KHR_materials_unlit": {}},
    }  # fmt: skip
    (found,) = load_gltf(write_gltf(tmp_path, with_camera(tree))).materials
    assert found.emission == (0.1, 0.2, 0.3) and found.modulation is None
