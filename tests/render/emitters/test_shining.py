"""Light that changes, in the arrays that kernels read; no kernel runs here but that of a picture."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

import clsim
from clsim.render import SceneData, light_stands_still
from clsim.render.accel.placement import place
from clsim.render.emitters.environment_build import LUMINANCE, tabulate
from clsim.render.emitters.light_list import small_lights, triangle_lights
from clsim.render.primary.effort import GRADES, Effort, PrimarySetup, Steerer
from clsim.scene import Camera, EnvironmentMap, ImageTexture, Instance, Material, Mesh, Static, World
from clsim.scene.modulation import Keyframed, Pwm, Sine
from clsim.scene.motion import compose, euler_quaternion, rotation_matrix
from tests.scene.pictures.test_film import film_of, write_pictures
from tests.scene.test_modulation import SCENE

pytestmark = pytest.mark.usefixtures("ordinary")

HALF = Keyframed((0.0, 1.0), ((1.0, 1.0, 1.0), (0.0, 0.5, 1.0)))


def lit_by_everything(folder: Path) -> World:
    file = folder / "flicker.toml"
    file.write_text(SCENE)
    return clsim.load_scene(file)


def test_all_light_is_its_mean_over_the_exposure(tmp_path: Path) -> None:
    world = lit_by_everything(tmp_path)
    data = SceneData(world)
    data.shine(0.4, 0.6)
    led, point, marker, sky = (change.mean(0.4, 0.6) for _, change in world.modulations())
    assert led[0] != point[0] != marker[0] and marker == pytest.approx((0.5, 0.75, 0.625))
    lights = data.scene.lights
    np.testing.assert_allclose(lights.sphere_radiance.numpy(), [5.0 * led], rtol=1e-6)
    np.testing.assert_allclose(lights.punctual.intensity.numpy(), [point], rtol=1e-6)
    np.testing.assert_allclose(list(lights.environment), sky, rtol=1e-6)
    emission = data.scene.materials.rows.numpy()["emission"]
    np.testing.assert_allclose(emission[:, 0], [0.0, 3.0 * marker[0]], rtol=1e-6)
    assert (emission[:, 1:] == 0).all()


def test_what_is_set_goes_on_changing_and_the_state_tells_of_it(tmp_path: Path) -> None:
    data = SceneData(lit_by_everything(tmp_path))
    off_s, on_s = 0.0019, 0.0001
    seen = [data.shine(t, t).copy() for t in (off_s, on_s, off_s)]
    assert (seen[0] == seen[2]).all() and not np.array_equal(seen[0], seen[1])
    data.set_light("led", (100.0, 0.0, 50.0))
    np.testing.assert_allclose(data.scene.lights.sphere_radiance.numpy(), [[1.0, 0.0, 0.5]], rtol=1e-6)
    data.shine(on_s, on_s)
    np.testing.assert_allclose(data.scene.lights.sphere_radiance.numpy(), [[100.0, 0.0, 50.0]], rtol=1e-6)


def test_a_sky_turns_and_fades() -> None:
    pixels, to_world = np.random.default_rng(1).random((4, 8, 3)), rotation_matrix(euler_quaternion((20.0, 0.0, 0.0)))
    sky = EnvironmentMap(pixels.astype(np.float32), to_world, turn_deg_per_s=90.0)
    world = replace(clsim.load_scene("still"), environment_map=sky, environment_modulation=HALF)
    data = SceneData(world)
    assert data.scene.lights.environment_image.radiance.numpy() == pytest.approx(pixels + 0.25)
    data.shine(0.4, 0.6)
    image = data.scene.lights.environment_image
    assert image.radiance.numpy() == pytest.approx((pixels + 0.25) * (0.5, 0.75, 1.0), rel=1e-6)
    # Half of a quarter turn: what came from +z comes from +x + z.
    turned = np.array(image.to_world, np.float64).reshape(3, 3) @ to_world.T
    np.testing.assert_allclose(turned @ (0.0, 0.0, 1.0), (0.5**0.5, 0.0, 0.5**0.5), atol=1e-6)
    steady = replace(world, environment_modulation=None)
    assert world.light_changes() and steady.light_changes()
    assert not replace(steady, environment_map=None).light_changes()


def test_a_lamp_that_is_dark_at_first_is_drawn_as_often_as_when_it_is_brightest() -> None:
    dark_first = Keyframed((0.0, 1.0), ((0.0, 0.0, 0.0), (3.0, 3.0, 3.0)))
    world = clsim.load_scene("still")
    (lamp,) = world.sphere_lights
    for modulation, power in ((dark_first, 3.0), (Sine(100.0, 0.5), 1.5), (Pwm(100.0, 0.001), 1.0)):
        changing = replace(world, sphere_lights=(lamp, replace(lamp, modulation=modulation)))
        lights = small_lights(changing, np.zeros(3), np.zeros(3), 10.0)
        assert lights.in_tree.all()
        for weights in (lights.power, lights.bounds["intensity"]):
            assert weights[1] / weights[0] == pytest.approx(power, rel=1e-5)


def test_whether_light_changes_is_not_asked_in_each_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """To find out takes a pass over all materials."""
    data = SceneData(clsim.load_scene("still"))
    monkeypatch.setattr(World, "light_changes", None)
    assert data.shine(0.0, 0.0).size == 0


def test_light_that_changes_does_not_stand_still() -> None:
    world = clsim.load_scene("still")
    assert light_stands_still(world)
    assert not light_stands_still(replace(world, environment_modulation=HALF))


def test_once_light_has_changed_all_paths_are_traced_and_no_correction_is_left() -> None:
    steerer = Steerer(
        4, 3, Effort(spp=8, probe_spp=1, first_hit_rays=4), PrimarySetup((0.01, 0.0), sharp=True), None, "cpu"
    )

    def wanted(index: int) -> set[int]:
        steerer.arguments["correction"].fill_(7.0)
        steerer.arguments["known"].fill_(2)
        steerer.prepare(index, 1_000 * index, np.eye(4))
        return set(steerer.arguments["grades"].numpy().tolist())

    assert wanted(0) == {GRADES + 1} and wanted(1) == {0}
    assert (steerer.arguments["known"].numpy() == 2).all()
    steerer.forget()
    assert wanted(2) == {GRADES + 1}
    assert (steerer.arguments["known"].numpy() == 0).all() and (steerer.arguments["correction"].numpy() == 0).all()
    assert wanted(3) == {0}


def test_films_are_written_where_their_first_picture_was(tmp_path: Path) -> None:
    write_pictures(tmp_path / "shots", 10, 20, 40)
    PIL.Image.new("RGB", (3, 3), (7, 7, 7)).save(tmp_path / "still.png")
    world, _ = film_of(tmp_path, 'frames = "shots/*.png", fps = 10')
    still = ImageTexture(np.full((3, 3, 4), 7, np.uint8))
    materials = (Material(texture=1), replace(world.materials[1], texture=1))
    world = replace(world, materials=materials, textures=(*world.textures, still))
    data = SceneData(world)
    states = [data.shine(time_s, time_s).copy() for time_s in (0.0, 0.05, 0.1, 0.3)]
    assert [np.array_equal(states[0], state) for state in states] == [True, True, False, True]
    data.shine(0.1, 0.1)
    texels = data.scene.materials.textures.texels.numpy().view(np.uint8).reshape(-1, 4)
    assert texels[:8, 0].tolist() == [20] * 8 and texels[8:, 0].tolist() == [7] * 9


@pytest.mark.parametrize("even", [(0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.2, 0.5)])
def test_an_even_sky_of_any_colour_is_added_to_a_picture_of_one(even):
    picture = np.random.default_rng(0).uniform(0, 2, (4, 8, 3)).astype(np.float32)
    found = tabulate(EnvironmentMap(picture, np.eye(3)), even).radiance
    np.testing.assert_allclose(found, picture + np.array(even, np.float32))


def test_an_emitting_triangle_has_the_power_of_its_area_and_of_each_side_that_shines() -> None:
    """A Lambertian emitter sends π · radiance · area into the half space before it; one that flickers, at its crest."""
    corners = np.array([(0, 0, 0), (2, 0, 0), (0, 1, 0), (0, 0, 5), (6, 0, 5), (0, 3, 5)], np.float32)
    radiance = (3.0, 2.0, 1.0)
    ids = np.array([0, 1], np.int32)
    mesh = Mesh(corners, np.array([(0, 1, 2), (3, 4, 5)], np.int32), ids)
    crests = Sine(100.0, 0.5), None
    materials = tuple(
        Material(emission=radiance, emits_behind=behind, modulation=each)
        for behind, each in zip((False, True), crests, strict=True)
    )
    turned = Static(compose((1.0, 2.0, 3.0), rotation_matrix(euler_quaternion((30.0, 40.0, 50.0)))))
    camera = Camera(4, 4, 50.0, Static(np.eye(4)))
    world = World("lamps", camera, (mesh,), (Instance(0, turned, "lamp"),), materials)
    lights = triangle_lights(world, place(world))
    expected = math.pi * float(np.dot(radiance, LUMINANCE)) * np.array([1.5, 2 * 9.0])
    np.testing.assert_allclose(lights.power, expected, rtol=1e-5)
