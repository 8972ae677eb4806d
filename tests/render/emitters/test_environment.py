"""Environment maps: their geometry, their distribution, and the light they give."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from clsim.render import SceneData
from clsim.render.device.devices import start_warp
from clsim.render.emitters import environment
from clsim.render.emitters.environment_build import LUMINANCE, guide, steps, tabulate, upload_environment
from clsim.scene import EnvironmentMap, Material, SphereLight, Static
from tests.render import hand_worlds as hw

pytestmark = pytest.mark.usefixtures("any_lights")

GREY = Material(color=(0.5, 0.5, 0.5))
WHITE = Material(color=(1.0, 1.0, 1.0))
TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])


def floor(**rest):
    """A floor seen in a narrow view from above: the picture is the radiance at the origin."""
    view = hw.camera(hw.look_from((0, 1, 0), (0, 0, 0), up=(0, 0, -1)), 4, 4, fov_deg=0.02)
    return hw.world(hw.quad((-9, 0, 9), (18, 0, 0), (0, 0, -18)), view=view, materials=(GREY,), **rest)


def random_map(height=8, width=16, seed=0, to_world=TURN):
    """Bright and dark texels, black ones among them."""
    rng = np.random.default_rng(seed)
    radiance = rng.exponential(1.0, (height, width, 3)) ** 3
    radiance[rng.random((height, width)) < 0.2] = 0
    return EnvironmentMap(radiance.astype(np.float32), to_world)


def reference(image, directions):
    """Bilinear radiance in float64, straight from the definition: column 0…w from −z over +x, +z, −x; row 0 is +y."""
    height, width, _ = image.radiance.shape
    local = directions @ image.to_world  # the transpose of to_world, applied from the left
    x = (np.arctan2(local[:, 0], -local[:, 2]) % (2 * np.pi)) / (2 * np.pi) * width - 0.5
    y = np.arccos(np.clip(local[:, 1], -1, 1)) / np.pi * height - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    rows = [np.clip(y0 + k, 0, height - 1) for k in (0, 1)]
    columns = [(x0 + k) % width for k in (0, 1)]
    pixels = image.radiance.astype(np.float64)
    top = pixels[rows[0], columns[0]] * (1 - fx) + pixels[rows[0], columns[1]] * fx
    bottom = pixels[rows[1], columns[0]] * (1 - fx) + pixels[rows[1], columns[1]] * fx
    return top * (1 - fy) + bottom * fy


def sphere_points(n):
    """Directions spread evenly over the sphere (a Fibonacci lattice)."""
    k = np.arange(n) + 0.5
    y, phi = 1 - 2 * k / n, k * np.pi * (3 - np.sqrt(5))
    s = np.sqrt(1 - y * y)
    return np.stack([s * np.cos(phi), y, s * np.sin(phi)], axis=1)


@wp.kernel(module="unique", enable_backward=False)
def probe(
    image: environment.EnvironmentImage,
    directions: wp.array(dtype=wp.vec3),
    pairs: wp.array(dtype=wp.vec2),
    out_towards: wp.array(dtype=wp.vec4),
    out_directions: wp.array(dtype=wp.vec3),
    out_drawn: wp.array(dtype=wp.vec4),
):
    i = wp.tid()
    towards = environment.environment_towards(image, directions[i])
    out_towards[i] = wp.vec4(towards.radiance[0], towards.radiance[1], towards.radiance[2], towards.pdf)
    out_directions[i] = environment.sample_environment(image, pairs[i])
    drawn = environment.environment_towards(image, out_directions[i])
    out_drawn[i] = wp.vec4(drawn.radiance[0], drawn.radiance[1], drawn.radiance[2], drawn.pdf)


def run_probe(image, count=1 << 18, seed=0):
    """Evaluate at evenly spread directions, draw as many, and evaluate where they were drawn."""
    start_warp()
    tables = tabulate(image, (0.0, 0.0, 0.0))
    device = upload_environment(tables, image.to_world, "cpu")
    directions = sphere_points(count)
    pairs = np.random.default_rng(seed).integers(0, 1 << 24, (count, 2)) / (1 << 24)
    out = [wp.zeros(count, dtype=kind, device="cpu") for kind in (wp.vec4, wp.vec3, wp.vec4)]
    inputs = [wp.array(directions, dtype=wp.vec3, device="cpu"), wp.array(pairs, dtype=wp.vec2, device="cpu")]
    wp.launch(probe, count, inputs=[device, *inputs], outputs=out, device="cpu")
    return tables, directions, *(a.numpy().astype(np.float64) for a in out)


def test_radiance_is_the_bilinear_image():
    image = random_map()
    _, directions, towards, *_ = run_probe(image, 1 << 14)
    np.testing.assert_allclose(towards[:, :3], reference(image, directions), rtol=1e-3, atol=1e-4)


def test_a_sky_of_one_colour_is_added_to_the_map():
    image = random_map()
    tables = tabulate(image, (0.0, 0.0, 2.0))
    np.testing.assert_array_equal(tables.radiance, image.radiance + np.array((0, 0, 2), np.float32))


@pytest.mark.slow  # kernels of their own are compiled
def test_column_0_begins_at_minus_z_and_goes_over_plus_x():
    pixels = np.zeros((2, 4, 3), np.float32)
    pixels[:, :, 0] = (1, 2, 3, 4)
    pixels[1] += 10
    image = EnvironmentMap(pixels, np.eye(3))
    # The centres of the four texels of the upper row.
    s = np.sqrt(0.5)
    sides = np.array([[s * x, s, s * z] for x, z in ((s, -s), (s, s), (-s, s), (-s, -s))])
    np.testing.assert_allclose(reference(image, sides)[:, 0], (1, 2, 3, 4))
    view = hw.camera(hw.look_from((0, 0, 0), sides[1], up=(0, 1, 0)), 1, 1, fov_deg=0.01)
    frame = hw.render(hw.world(materials=(), view=view, environment_map=image), spp=1)
    np.testing.assert_allclose(frame.planes[:3, 0, 0], (2, 0, 0), atol=1e-3)
    assert frame.plane("Coverage").max() == 0


@pytest.mark.parametrize("shape", [(8, 16), (1, 1), (3, 5), (64, 128)])
def test_directions_are_drawn_with_their_density(shape):
    image = random_map(*shape, seed=3)
    if not image.radiance.any():
        image = EnvironmentMap(image.radiance + 1, image.to_world)
    _, directions, towards, drawn, drawn_values = run_probe(image)
    # The density integrates to one.
    assert abs(towards[:, 3].mean() * 4 * np.pi - 1) < 0.01
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1, atol=1e-5)
    # Moments of what is drawn against the density's, by quadrature.
    for moment in (lambda d: d, lambda d: d * d, lambda d: d * np.roll(d, 1, axis=1)):
        values = moment(drawn)
        expected = (moment(directions) * towards[:, 3:]).mean(axis=0) * 4 * np.pi
        error = values.std(axis=0) / np.sqrt(len(values))
        assert np.all(np.abs(values.mean(axis=0) - expected) < 4.5 * error + 3e-3), shape
    # The estimator of the map's integral is unbiased, and its weights are bounded.
    weights = drawn_values[:, :3] @ LUMINANCE / drawn_values[:, 3]
    expected = (towards[:, :3] @ LUMINANCE).mean() * 4 * np.pi
    assert abs(weights.mean() - expected) < 4.5 * weights.std() / np.sqrt(len(weights)) + 3e-3 * expected
    assert weights.max() < 4.2 * np.pi / 2 * expected


@pytest.mark.parametrize("entries", [1, 2, 7, 8, 300])
def test_the_search_begins_at_the_first_entry_that_its_numbers_may_find(entries):
    rng = np.random.default_rng(entries)
    weights = rng.exponential(1.0, (3, entries)) ** 4
    weights[:, rng.random(entries) < 0.3] = 0
    weights[0, 0] = weights[1] = 1
    tables = steps(np.cumsum(weights, axis=1))
    for table, guesses in zip(tables, guide(tables), strict=True):
        if table[-1] > 0:
            first = np.arange(len(guesses)) / len(guesses)
            np.testing.assert_array_equal(guesses, np.searchsorted(table, first, side="right"))


def test_the_mean_is_the_spherical_mean():
    image = random_map(6, 9, seed=1)
    tables, _, towards, *_ = run_probe(image)
    np.testing.assert_allclose(tables.mean, (towards[:, :3] @ LUMINANCE).mean(), rtol=0.02)


@pytest.mark.slow  # kernels of their own are compiled
def test_a_constant_map_is_a_constant_environment():
    """Inside a furnace nothing is seen of a white body; and half of the light may come from either kind."""
    body, view = hw.ball(1.0), hw.camera(hw.look_from((0, 0.5, 4), (0, 0, 0)))
    even = EnvironmentMap(np.full((16, 32, 3), 0.4, np.float32), TURN)
    scene = hw.world(body, materials=(WHITE,), view=view, environment_map=even, environment=(0.3, 0.3, 0.3))
    frame = hw.render(scene, spp=64)
    outside = frame.plane("Coverage") == 0
    np.testing.assert_allclose(hw.radiance(frame)[:, outside], 0.7, rtol=1e-5)
    mean, error = hw.mean_and_error(frame)
    assert np.all(np.abs(mean - 0.7) < 4 * error) and np.all(error < 0.005)
    plain = hw.world(body, materials=(GREY,), view=view, environment=(0.7, 0.7, 0.7))
    mapped = hw.world(body, materials=(GREY,), view=view, environment_map=even, environment=(0.3, 0.3, 0.3))
    expected, _ = hw.mean_and_error(hw.render(plain, spp=64))
    mean, error = hw.mean_and_error(hw.render(mapped, spp=256, seed=3))
    assert np.all(np.abs(mean - expected) < 4 * error + 1e-5)


@pytest.mark.slow  # kernels of their own are compiled
@pytest.mark.parametrize("to_world", [np.eye(3), TURN])
@pytest.mark.parametrize("strategy", ["mis", "light"])
def test_one_bright_texel_gives_its_irradiance(to_world, strategy):
    """The integral of the bilinear tent over the sphere, by quadrature, times the cosine on a floor."""
    pixels = np.zeros((64, 128, 3), np.float32)
    y, x = (12, 40) if np.allclose(to_world, np.eye(3)) else (20, 70)
    pixels[y, x] = (500.0, 400.0, 300.0)
    image = EnvironmentMap(pixels, to_world)
    steps = np.linspace(-1, 1, 401)
    v, u = np.meshgrid((y + 0.5 + steps) / 64 * np.pi, (x + 0.5 + steps) / 128 * 2 * np.pi, indexing="ij")
    tent = np.outer(1 - abs(steps), 1 - abs(steps))
    local = np.stack([np.sin(v) * np.sin(u), np.cos(v), -np.sin(v) * np.cos(u)], axis=-1)
    up = np.maximum((local @ to_world.T)[..., 1], 0)
    assert up.min() > 0.1
    cell = (steps[1] - steps[0]) ** 2 * (np.pi / 64) * (2 * np.pi / 128)
    expected = 0.5 / np.pi * (tent * up * np.sin(v)).sum() * cell * pixels[y, x]
    mean, error = hw.mean_and_error(hw.render(floor(environment_map=image), spp=256, max_depth=2, strategy=strategy))
    assert np.all(np.abs(mean - expected) < 4 * error + 1e-3 * expected)
    assert np.all(error < 0.02 * expected)


@pytest.mark.slow  # kernels of their own are compiled
def test_every_way_of_finding_the_sky_agrees():
    scene = hw.world(
        hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)),
        hw.box((-0.4, 0.0, -0.4), (0.3, 0.6, 0.2)),
        view=hw.camera(hw.look_from((0.5, 1.5, 4), (0, 0.3, 0))),
        environment_map=random_map(16, 32, seed=5),
        environment=(0.2, 0.2, 0.1),
        sphere_lights=(SphereLight(0.3, (3.0, 3.0, 3.0), Static(hw.translation(0.9, 1.5, 0.6))),),
    )
    results = {
        strategy: hw.mean_and_error(hw.render(scene, spp=256, seed=seed, strategy=strategy, threads=2))
        for seed, strategy in enumerate(("mis", "light", "scatter"))
    }
    mean, error = results["mis"]
    for strategy in ("light", "scatter"):
        other, other_error = results[strategy]
        assert np.all(np.abs(other - mean) < 4 * np.hypot(error, other_error)), strategy
    assert np.all(error <= 1.2 * np.minimum(results["light"][1], results["scatter"][1]))


@pytest.mark.slow  # kernels of their own are compiled
def test_neighbouring_pixels_have_unrelated_errors():
    """White noise: the errors of a row's neighbours, and of the next row, do not correlate."""
    view = hw.camera(hw.look_from((0, 2, 0), (0, 0, 0), up=(0, 0, -1)), 64, 64, fov_deg=0.02)
    scene = hw.with_camera(floor(environment_map=random_map(16, 32, seed=5)), view)
    image = hw.radiance(hw.render(scene, spp=4, max_depth=2))[1].astype(np.float64)
    image -= image.mean()
    for shift in ((0, 1), (1, 0), (1, 1), (2, 0), (0, 2), (8, 8)):
        z = (image * np.roll(image, shift, axis=(0, 1))).mean() / image.var() * np.sqrt(image.size)
        assert abs(z) < 4.5, (shift, z)


def test_what_is_dim_beside_what_is_bright_is_drawn_too():
    """Shares within a block are bytes; one that shines at all has one, or its light would never be found."""
    radiance = np.full((16, 32, 3), 1e-4, np.float32)
    radiance[5, 9] = 1e4
    shares = tabulate(EnvironmentMap(radiance, np.eye(3)), (0.0, 0.0, 0.0)).shares
    cells = shares.swapaxes(1, 2).reshape(shares.shape[0] * shares.shape[2], -1)
    assert cells[:17, :32].all() and not cells[17:].any()


@pytest.mark.slow  # kernels of their own are compiled
def test_a_black_map_is_dark():
    dark = EnvironmentMap(np.zeros((4, 8, 3), np.float32), np.eye(3))
    scene = floor(environment_map=dark)
    assert np.all(hw.radiance(hw.render(scene, spp=4)) == 0)
    lights = SceneData(scene).scene.lights
    # What is drawn then lies beyond the last entry of one table, and has an entry of none in the other.
    drawn = int(np.searchsorted(lights.cumulative.numpy(), environment.STEP))
    assert drawn == len(lights.cumulative) and lights.probability.numpy()[drawn] == 0


@pytest.mark.slow  # kernels of their own are compiled
def test_motion_of_the_camera_does_not_move_the_sky():
    """The map is at infinity: two places, one picture."""
    image = random_map(16, 32)
    poses = [hw.translation(*at) for at in ((0, 0, 0), (100, -50, 30))]
    frames = [
        hw.render(hw.world(materials=(), view=hw.camera(Static(pose).matrix), environment_map=image), spp=2).planes
        for pose in poses
    ]
    np.testing.assert_array_equal(*frames)
