"""Many lights: what the tree knows of them, and that it draws without bias and with little noise."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

from clsim.render import RenderOptions, SceneData
from clsim.render.emitters.light_list import bounds_of_small
from clsim.render.emitters.light_tree import LightTree, Receiver, make_light_tree
from clsim.render.emitters.light_tree_build import TreeOfLights, around, of_triangles
from clsim.render.emitters.upload_lights import _shares
from clsim.render.features.scene_features import scene_features
from clsim.render.features.scene_lamps import tree_follows
from clsim.scene import Material, PunctualLight, SphereLight, Static
from clsim.scene.motion import Keyframes
from tests.render import hand_worlds as hw

GREY = Material(color=(0.6, 0.6, 0.6))


def nodes_of(tree):
    """What is known of each node, by name, in the order of their numbers."""
    groups = tree.nodes.numpy()
    columns = {name: np.moveaxis(groups[name], -1, 1) for name in groups.dtype.names}
    return {name: values.reshape(-1, *values.shape[2:]) for name, values in columns.items()}


def leaves_of(tree):
    return {name: values[tree.leaves : 2 * tree.leaves] for name, values in nodes_of(tree).items()}


@settings(max_examples=20, deadline=None)
@given(count=st.integers(1, 24), seed=st.integers(0, 1000), spread=st.sampled_from([0.0, 0.1, 100.0]))
def test_a_node_bounds_its_lights(count, seed, spread):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(count, 1, 3)) * spread + rng.normal(size=(count, 3, 3))
    both = rng.random(count) < 0.3
    bounds = of_triangles(corners, rng.random(count) + 0.1, both)
    lamps = around(corners[:3, 0], corners[:3, 0], np.ones(min(count, 3)))
    bounds = np.concatenate([bounds, lamps])
    lights = rng.permutation(2 * len(bounds))[: len(bounds)]
    tree = TreeOfLights(bounds, lights, 2 * len(bounds), 0.5, "cpu").tree
    nodes, slots = nodes_of(tree), tree.slots.numpy()
    np.testing.assert_array_equal(np.flatnonzero(slots >= 0), np.sort(lights))
    assert len(set(slots[lights])) == len(lights)
    np.testing.assert_array_equal(tree.lights.numpy()[slots[lights]], lights)
    for light, own in zip(lights, bounds, strict=True):
        places = np.stack([own["low"], own["high"]])
        rounding_m = 1e-6 * (1 + np.abs(places).max())
        node = tree.leaves + slots[light]
        while node:
            row = {name: values[node] for name, values in nodes.items()}
            assert np.linalg.norm(places - row["middle"], axis=1).max() <= row["radius_m"] + rounding_m
            assert row["reach"] <= own["reach"] and row["both"] >= own["both"]
            angle = np.arccos(np.clip(own["facing"], -1, 1)) + np.arccos(np.clip(own["axis"] @ row["axis"], -1, 1))
            assert row["facing"] <= -1 or np.cos(angle) >= row["facing"] - 1e-5
            node //= 2
    assert nodes["intensity"][1] == pytest.approx(bounds["intensity"].sum(), rel=1e-5)


def test_the_tree_has_the_power_of_its_lights_and_no_light_is_counted_twice():
    power = np.array([4.0, 6.0, 10.0, 30.0])
    far, in_tree = np.array([False, False, False, True]), np.array([True, True, False, False])
    np.testing.assert_allclose(_shares(power, far, in_tree, 2, 1e9), [0.0, 0.0, 10.0, 20.0, 40.0, 10.0])
    np.testing.assert_allclose(_shares(power, far, np.zeros(4, bool), 2, 5.0), [4.0, 6.0, 10.0, 20.0, 5.0])
    np.testing.assert_allclose(_shares(power, far, in_tree, 4, 0.0)[-1], 10.0)


def panel(x, z, side, radiance_at=1):
    return hw.quad((x - side / 2, 1.5, z - side / 2), (side, 0, 0), (0, 0, side), radiance_at)


def test_one_panel_is_one_light_and_two_are_several():
    glow = Material(emission=(1.0, 1.0, 1.0))
    ground = hw.quad((-5, 0, 5), (10, 0, 0), (0, 0, -10))
    one = hw.world(ground, panel(0, 0, 1), materials=(GREY, glow))
    assert not scene_features(one, 0.0).light_tree
    two = hw.world(ground, panel(0, 0, 1), panel(2, 0, 1), materials=(GREY, glow))
    assert scene_features(two, 0.0).light_tree
    bulb = SphereLight(0.1, (1.0,) * 3, Static(hw.translation(0, 3, 0)))
    assert scene_features(hw.world(ground, panel(0, 0, 1), materials=(GREY, glow), sphere_lights=(bulb,)), 0).light_tree
    sun = PunctualLight("directional", (1.0,) * 3, Static(np.eye(4)))
    lit = hw.world(ground, materials=(GREY,), sphere_lights=(bulb,), punctual_lights=(sun, sun))
    assert not scene_features(lit, 0.0).light_tree


def test_cached_light_needs_a_tree_where_lamps_are_more_than_eight_or_not_analytic():
    glow = Material(emission=(1.0, 1.0, 1.0))
    ground = hw.quad((-5, 0, 5), (10, 0, 0), (0, 0, -10))

    def has_tree(panels, lamp=glow):
        world = hw.world(ground, *(panel(2 * k, 0, 1) for k in range(panels)), materials=(GREY, lamp))
        return scene_features(world, 0.0, light_cache=True).light_tree

    assert [has_tree(panels) for panels in (1, 2, 4, 5)] == [False, False, False, True]
    assert has_tree(2, replace(glow, alpha_mode="mask"))


def street(number, seed=1):
    """A wide floor under lamps without size, and the irradiance of each pixel's middle in closed form."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(number)))
    places = np.stack([np.arange(number) % side, np.arange(number) // side], axis=1) + rng.uniform(
        0.2, 0.8, (number, 2)
    )
    places = (places / side - 0.5) * 16
    intensity = rng.uniform(1, 10, number)
    lamps = tuple(
        PunctualLight("point", (float(i),) * 3, Static(hw.translation(x, 1.5, z)))
        for (x, z), i in zip(places, intensity, strict=True)
    )
    floor = hw.quad((-40, 0, 40), (80, 0, 0), (0, 0, -80))
    view = hw.camera(hw.look_from((0, 500, 0), (0, 0, 0), up=(0, 0, -1)), 24, 24, fov_deg=2.2)
    world = hw.world(floor, materials=(GREY,), view=view, punctual_lights=lamps)
    half = 500 * np.tan(np.radians(1.1))
    fine = (np.arange(24 * 8) + 0.5) / (24 * 8) * 2 * half - half
    x, z = np.meshgrid(fine, fine)
    exact = np.zeros_like(x)
    for (a, b), i in zip(places, intensity, strict=True):
        exact += 0.6 / np.pi * i * 1.5 / ((x - a) ** 2 + (z - b) ** 2 + 1.5**2) ** 1.5
    return world, exact.reshape(24, 8, 24, 8).mean(axis=(1, 3))


@pytest.mark.slow
@pytest.mark.parametrize("sampler", ["pcg", "sobol"])
def test_a_hundred_lamps_have_the_closed_forms_light(sampler):
    world, exact = street(100)
    frame = hw.render(world, spp=1024, max_depth=2, sampler=sampler)
    if sampler == "pcg":  # the other one's variances are of four batches
        off = (frame.plane("R") - exact) / np.sqrt(frame.plane("Variance.R"))
        assert np.abs(off).max() < 6
    assert abs(frame.plane("R").mean() / exact.mean() - 1) < 2e-3


@pytest.mark.slow
def test_a_hundred_lamps_are_hardly_noisier_than_ten():
    noise = {}
    for number in (10, 100):
        world, exact = street(number)
        frame = hw.render(world, spp=256, max_depth=2)
        bright = exact > 0.2 * exact.mean()
        noise[number] = np.sqrt((256 * frame.plane("Variance.R") / exact**2)[bright].mean())
    # By power alone it is 3.3 for a hundred lamps.
    assert noise[100] < 0.9
    assert noise[100] < 1.6 * noise[10]


def driven(number, seed=2):
    """The street one second after its lamps stood elsewhere."""
    world, exact = street(number)
    rng = np.random.default_rng(seed)
    lamps = []
    for lamp in world.punctual_lights:
        x, y, z = lamp.motion.pose(0.0)[:3, 3]
        dx, dz = rng.normal(size=2) * 2
        way = Keyframes((0.0, 1.0), ((x + dx, y, z + dz), (x, y, z)), ((0.0, 0.0, 0.0, 1.0),) * 2)
        lamps.append(replace(lamp, motion=way))
    return replace(world, punctual_lights=tuple(lamps), fps=1.0), exact


@pytest.mark.slow
def test_a_hundred_lamps_that_move_have_the_closed_forms_light_and_little_noise():
    """By power alone, or by where they were at the start, noise is 3.3."""
    world, exact = driven(100)
    frame = hw.render(world, index=1, spp=1024, max_depth=2)
    variance = frame.plane("Variance.R")
    assert np.abs((frame.plane("R") - exact) / np.sqrt(variance)).max() < 6
    assert abs(frame.plane("R").mean() / exact.mean() - 1) < 2e-3
    bright = exact > 0.2 * exact.mean()
    assert np.sqrt((1024 * variance / exact**2)[bright].mean()) < 1.0


def test_a_tree_knows_where_lamps_and_panels_are_that_move():
    glow = Material(emission=(1.0, 2.0, 3.0), emits_behind=False)
    turned = Keyframes((0.0, 1.0), ((0.0, 0.0, 0.0), (3.0, 0.0, 0.0)), ((0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0)))
    ground = hw.quad((-5, 0, 5), (10, 0, 0), (0, 0, -10))
    world = hw.world(ground, panel(0, 0, 1), panel(2, 0, 1), materials=(GREY, glow))
    bulb = SphereLight(0.1, (1.0,) * 3, turned)
    moving = tuple(replace(each, motion=turned) if k == 1 else each for k, each in enumerate(world.instances))
    world = replace(world, instances=moving, sphere_lights=(bulb,))
    assert scene_features(world, 0.0).light_tree and tree_follows(world)
    data = SceneData(world)
    for time_s in (0.0, 1.0):
        data.move(time_s)
        tree = data.scene.lights.tree
        nodes, slots = leaves_of(tree), tree.slots.numpy()
        assert (slots >= 0).all()
        fresh = [replace(each, motion=Static(each.motion.pose(time_s))) for each in world.instances]
        still = replace(bulb, motion=Static(turned.pose(time_s)))
        expected = SceneData(replace(world, instances=tuple(fresh), sphere_lights=(still,)))
        places = expected.scene.lights.tree
        middles = leaves_of(places)["middle"] + expected.origin_m
        own = nodes["middle"] + data.origin_m
        here = nodes["intensity"] > 0
        found = own[here][np.lexsort(own[here].round(4).T)]
        wanted = middles[leaves_of(places)["intensity"] > 0]
        np.testing.assert_allclose(found, wanted[np.lexsort(wanted.round(4).T)], atol=1e-5)
    assert nodes["axis"][slots[0]] == pytest.approx((0, 1, 0), abs=1e-6) or nodes["axis"][slots[0]][1] == pytest.approx(
        -1
    )


def plates(seed=0):
    """Glossy plates and a smooth metal ball in a room with lamps of all sorts that have a size."""
    rng = np.random.default_rng(seed)
    glossy = [
        Material(kind="plastic", color=(0.2, 0.3, 0.4), alpha=0.1, ior=1.6),
        Material(kind="conductor", color=(0.9, 0.7, 0.4), alpha=0.2),
        Material(kind="principled", color=(0.4, 0.5, 0.3), alpha=0.05, metallic=0.5, clearcoat=1.0),
        Material(kind="dielectric", ior=1.5, alpha=0.3),
    ]
    glow = Material(color=(0.0, 0.0, 0.0), emission=(6.0, 5.0, 4.0), emits_behind=False)
    both = Material(color=(0.0, 0.0, 0.0), emission=(9.0, 9.0, 9.0))
    meshes = [hw.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8))]
    meshes += [hw.quad((-3 + 1.6 * i, 0.2, 0.8), (1.4, 0, 0), (0, 0.6, -1.4), 1 + i) for i in range(4)]
    meshes += [
        hw.quad((x, 2 + y, z), (0.3, 0, 0.1), (0.05, 0.1, 0.3), 5 + k % 2)
        for k, (x, y, z) in enumerate(rng.uniform(-2, 1.5, (7, 3)))
    ]
    bulbs = tuple(
        SphereLight(r, (0.05 / r**2,) * 3, Static(hw.translation(x, 1.5, -1.0)))
        for x, r in ((-2, 0.05), (0, 0.1), (2, 0.3))
    )
    view = hw.camera(hw.look_from((0, 1.5, 4), (0, 0.5, 0)), 24, 16, fov_deg=60)
    return hw.world(*meshes, materials=(GREY, *glossy, glow, both), view=view, sphere_lights=bulbs)


@pytest.mark.slow
def test_both_ways_to_find_light_agree_with_scattering_alone():
    """Scattering alone knows nothing of the tree."""
    blocks = {}
    for strategy, spp in (("mis", 4096), ("scatter", 24576)):
        frame = hw.render(plates(), spp=spp, max_depth=3, strategy=strategy, threads=None)
        shape = (4, 4, 6, 4)
        mean = frame.plane("G").reshape(shape).mean(axis=(1, 3))
        error = np.sqrt(frame.plane("Variance.G").reshape(shape).mean(axis=(1, 3)) / 16)
        blocks[strategy] = mean, error
    (mis, mis_error), (brute, brute_error) = blocks["mis"], blocks["scatter"]
    error = np.hypot(mis_error, brute_error)
    assert np.all(np.abs(mis - brute) <= 4.5 * error)
    assert abs(mis.mean() / brute.mean() - 1) < 0.01


@cache
def drawing():
    """A kernel that draws lights for a point of a matt floor that shines a little."""
    lit = hw.world(hw.quad((-5, 0, 5), (10, 0, 0), (0, 0, -10)), materials=(Material(kind="plastic", alpha=0.3),))
    draw, pdf = make_light_tree(RenderOptions().features_of(lit))

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(
        tree: LightTree,
        to: Receiver,
        u: wp.array(dtype=wp.vec2),
        lights: wp.array(dtype=int),
        out_drawn: wp.array(dtype=int),
        out_probability: wp.array(dtype=float),
        out_pdf: wp.array(dtype=float),
    ):
        i = wp.tid()
        choice = draw(tree, to, u[i][0], u[i][1])
        out_drawn[i] = choice.light
        out_probability[i] = choice.probability
        out_pdf[i] = pdf(tree, lights[i], to)

    return kernel


@pytest.mark.parametrize("count", [1, 2, 3, 7, 20, 100, 1000])
def test_lights_are_drawn_as_often_as_is_said(count):
    rng = np.random.default_rng(count)
    corners = rng.normal(size=(count, 1, 3)) * 3 + (0, 4, 0) + 0.3 * rng.normal(size=(count, 3, 3))
    bounds = of_triangles(corners, rng.random(count) + 0.1, rng.random(count) < 0.3)
    tree = TreeOfLights(bounds, np.arange(count), count, 1.0, "cpu").tree
    to = Receiver()
    to.position, to.normal, to.mirror = wp.vec3(0.3, 0.0, 0.1), wp.vec3(0.0, 1.0, 0.0), wp.vec3(0.6, 0.8, 0.0)
    to.matt, to.gloss, to.alpha2 = 0.2, 0.05, 0.01
    n = 1 << 16
    stratified = (np.arange(n) + rng.random(n)) / n
    u = np.minimum(np.stack([stratified, rng.random(n)], axis=1), 1 - 2.0**-24).astype(np.float32)
    arrays = [wp.array(u, dtype=wp.vec2, device="cpu"), wp.array(np.arange(n) % count, dtype=int, device="cpu")]
    out = [wp.zeros(n, dtype=dtype, device="cpu") for dtype in (int, float, float)]
    wp.launch(drawing(), dim=n, inputs=[tree, to, *arrays], outputs=out, device="cpu")
    drawn, probability, pdf = (array.numpy() for array in out)
    # Sometimes a branch seems to send something, and then none of its lights does.
    some = drawn >= 0
    assert pdf[:count].sum() == pytest.approx(some.mean(), abs=1e-3) and some.mean() > 0.99
    np.testing.assert_allclose(probability[some], pdf[drawn[some]], rtol=1e-4)
    often = np.bincount(drawn[some], minlength=count) / n
    np.testing.assert_allclose(often, pdf[:count], atol=6 * np.sqrt(pdf[:count].max() / n))


@pytest.mark.parametrize("turn", range(3))
def test_a_spot_is_known_to_shine_where_it_looks(turn):
    """Along its -z, which leads to one of the axes here, and up to its edge; a point shines all around."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.roll(np.eye(3), turn, axis=0), (3.0, 2.0, 1.0)
    spot = PunctualLight("spot", (1.0, 1.0, 1.0), Static(pose), 10.0, 60.0)
    (found,) = bounds_of_small(spot, pose, np.array((1.0, 1.0, 1.0)))
    np.testing.assert_allclose(found["axis"], -np.eye(3)[(2 + turn) % 3])
    np.testing.assert_allclose((found["low"], found["high"]), [(2.0, 1.0, 0.0)] * 2)
    assert (found["facing"], found["reach"], found["intensity"]) == (1.0, pytest.approx(0.5), pytest.approx(1.0))
    (found,) = bounds_of_small(replace(spot, kind="point"), pose, np.zeros(3))
    assert (found["facing"], found["reach"]) == (-1.0, -1.0)
