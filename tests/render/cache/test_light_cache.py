"""The radiance cache: it comes to the truth, learning it is no event, and nothing moves where it is used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from clsim.errors import InputError
from clsim.render import Effort, RenderOptions, direct_light_is_analytic, light_stands_still
from clsim.render.cache import cell_table, first_frame, light_cache_host
from clsim.render.device.launch import Threads
from clsim.render.motion.standstill import Standstill
from clsim.render.primary import effort
from clsim.scene import ImageTexture, Material, Sensor
from clsim.scene.defaults.drift import drifting
from tests.render import hand_worlds as hw
from tests.render.primary.test_steered import LUMINANCE, Run, log_brightness, textured_world
from tests.render.test_tracer import LAMP, moving_world

pytestmark = pytest.mark.usefixtures("ordinary")

UNTOLD = light_cache_host.next_event(None, Sensor())
CACHED = {"light_cache": True, "spp": 4, "probe_spp": 1}


@pytest.fixture(autouse=True)
def _all_frames_are_rendered(monkeypatch):
    """Also where nothing has moved, as where something moves that is not seen."""
    monkeypatch.setattr(Standstill, "repeat", lambda *_: False)


def panning(world):
    """The same world before a camera that moves past it."""
    return drifting(world)


def luminance(frame):
    return np.tensordot(LUMINANCE, frame.planes[:3].astype(float), axes=1)


def test_the_light_comes_to_the_truth():
    """A floor in lamp- and skylight: frames of 1 path a pixel agree in the mean with 1,024 paths."""
    world = textured_world()
    run = Run(world, **CACHED)
    for index in range(24):
        cached = run.fill(index)
    truth = hw.render(world, spp=1024)
    ratio = luminance(cached).mean() / luminance(truth).mean()
    assert ratio == pytest.approx(1.0, abs=0.05)


def test_learning_fires_no_event():
    """Before a still camera brightness stays as it was first shown, though the light is known ever better."""
    run = Run(textured_world(), **CACHED)
    first = log_brightness(run.fill(0))
    for index in range(1, 12):
        last = log_brightness(run.fill(index))
    np.testing.assert_allclose(last, first, atol=1e-5)


def dim_room():
    """A closed room with a hole of a decimetre in its roof, which few paths find."""
    walls = [
        hw.quad((-1, -1, -1), (2, 0, 0), (0, 0, 2)),
        hw.quad((-1, -1, -1), (0, 2, 0), (2, 0, 0)),
        hw.quad((-1, -1, 1), (2, 0, 0), (0, 2, 0)),
        hw.quad((-1, -1, -1), (0, 0, 2), (0, 2, 0)),
        hw.quad((1, -1, -1), (0, 2, 0), (0, 0, 2)),
    ]
    roof = [
        hw.quad((-1, 1, -1), (2, 0, 0), (0, 0, 0.95)),
        hw.quad((-1, 1, 0.05), (2, 0, 0), (0, 0, 0.95)),
        hw.quad((-1, 1, -0.05), (0.95, 0, 0), (0, 0, 0.1)),
        hw.quad((0.05, 1, -0.05), (0.95, 0, 0), (0, 0, 0.1)),
    ]
    view = hw.camera(hw.look_from((0, 0.8, 0.9), (0, -1, -0.3)), 24, 18)
    return hw.world(*walls, *roof, environment=(30.0, 30.0, 30.0), view=view)


def test_how_noisy_light_is_is_the_mean_of_relative_variances():
    """Pixels: paths found 1 and 3, twice 5, nothing, and one missed. Of the first the mean is 2, the variance 2."""
    lights = np.array([[1, 5, 0, 7], [3, 5, 0, 9]], np.float32)[..., None] * np.ones(3, np.float32)
    begin = np.array([[True, True, True, False], [True] * 4])
    assert first_frame._relative_variance(lights, begin) == pytest.approx((2 / 2**2 + 0) / 2)
    assert first_frame._relative_variance(1e-30 * lights, begin) == pytest.approx(0.25)
    assert first_frame._relative_variance(lights, ~begin) == 0.0


def test_noisy_light_gets_more_paths_before_the_first_frame_is_seen():
    """An even sky needs two passes of the first frame. In a dim room one of four paths finds light, in most pixels."""
    floor = hw.quad((-9, 0, 9), (18, 0, 0), (0, 0, -18))
    view = hw.camera(hw.look_from((0, 3, 3), (0, 0, 0)), 12, 10)
    outside = hw.world(floor, view=view, environment=(1.0, 1.0, 1.0))
    found = []
    for world in (outside, dim_room()):
        run = Run(world, **CACHED)
        run.fill(0)
        found.append(run.tracer.paths / (world.camera.width * world.camera.height))
    assert found[0] == 2 * 4 and 40 < found[1] <= 4 / 0.28**2 + 4


@pytest.mark.parametrize("floor", [1e-4, 0.01])
def test_what_seemed_black_comes_to_light_without_events(floor):
    """Where no path had found light, the first that does tells of it, and of no change; also about a sensor's floor."""
    # With a smaller error all is found before the first frame is seen.
    world = replace(dim_room(), sensor=Sensor(floor=floor))
    run = Run(world, probe_every=2, first_hit_rays=8, first_frame_error=0.5, **CACHED)
    seen = np.array([np.log(np.maximum(luminance(run.fill(index)), floor)) for index in range(40)])
    assert (seen[0] < np.log(2 * floor)).sum() > 10
    assert np.abs(np.diff(seen, axis=0)).max() < 1e-5


@pytest.mark.parametrize("light_hz", [None, 1e6])
def test_duplicate_pixels_change_nothing_and_see_the_same_but_for_noise(light_hz):
    """Also where each frame is shown in the light as it was known before."""
    world = panning(textured_world())
    once, twice = (Run(world, duplicate_every=every, light_hz=light_hz, **CACHED) for every in (0, 3))
    for index in range(3):
        np.testing.assert_array_equal(once.fill(index).planes, twice.fill(index).planes)
        first, again = twice.tracer.sampled_twice(twice.frame)
    assert first == pytest.approx(luminance(twice.frame).reshape(-1)[::3], rel=0.2)
    assert again.mean() == pytest.approx(first.mean(), rel=0.02)
    # What shows the sky alone is seen alike.
    sky = twice.frame.plane("Coverage").reshape(-1)[::3] == 0
    assert sky.any()
    np.testing.assert_allclose(first[sky], again[sky], rtol=1e-4)
    assert 0.003 < np.median(np.abs(np.log(again / first))[~sky]) < 0.06


@pytest.mark.parametrize("world", [panning(textured_world()), dim_room()], ids=["floor", "dim room"])
def test_two_estimates_differ_as_two_seeds_do(world):
    """By the noise of first hits, which is most of it on the floor, and of the cached light."""
    primary_rays, seeds, dark = [], [], 1e-3
    for seed in range(4):
        twice, other = (Run(world, seed=seed + offset, duplicate_every=1, **CACHED) for offset in (0, 100))
        for index in range(0, 16, 4):
            seen, differs = (luminance(run.fill(index)).reshape(-1) for run in (twice, other))
            one, again = twice.tracer.sampled_twice(twice.frame)
            primary_rays.append(np.log((one + dark) / (again + dark)))
            seeds.append(np.log((seen + dark) / (differs + dark)))
    spread = [np.quantile(np.abs(each), (0.68, 0.95)) for each in (primary_rays, seeds)]
    # Standard errors count paths as independent, and these are spread evenly: more is told than there is.
    np.testing.assert_allclose(*spread, rtol=0.6)


def test_two_estimates_of_a_still_picture_stay_as_they_are():
    run = Run(textured_world(), duplicate_every=1, **CACHED)
    run.fill(0)
    first = run.tracer.sampled_twice(run.frame).copy()
    for index in range(1, 12):
        run.fill(index)
    change = np.abs(np.log(run.tracer.sampled_twice(run.frame) / first))
    assert np.abs(np.log(first[0] / first[1])).max() > 0.1, "they differ much"
    assert np.quantile(change, 0.95) < 0.005 and change.max() < 0.1


def test_pixels_whose_surfaces_differ_in_brightness_get_more_rays(monkeypatch):
    """A lamp before a floor and the sky: the shares of what lies in one pixel are counted well."""
    world = textured_world()

    def seen(rays):
        return Run(world, **CACHED, first_hit_rays=rays).fill(0)

    truth, closer = log_brightness(seen(512)), seen(16)
    monkeypatch.setattr(effort, "_AT_CONTRAST", 0)
    plain = seen(16)
    asked = closer.plane("Samples") > plain.plane("Samples") + 16
    assert 0.01 < asked.mean() < 0.3
    errors = [np.abs(log_brightness(run) - truth)[asked].mean() for run in (closer, plain)]
    assert errors[0] < 0.5 * errors[1], errors


@pytest.mark.slow
def test_lamps_smaller_than_a_pixel_do_not_vanish():
    """Dots between the corners of pixels, seen by the fewest rays with cached light: one inside each pixel."""
    side = 2 * np.tan(np.radians(20.0)) / 16
    lamps = [
        hw.quad(((x - 7.85) * side, (y - 7.85) * side, -1), (0.7 * side, 0, 0), (0, 0.7 * side, 0), material=1)
        for x, y in np.ndindex(15, 15)
    ]
    wall = hw.quad((-2, -2, -2), (4, 0, 0), (0, 4, 0))
    world = hw.world(wall, *lamps, materials=(hw.GREY, LAMP), view=hw.camera())
    shines = Run(world, **CACHED).fill(0).plane("Emission") > 0
    assert shines.mean() > 0.3


def test_paths_are_spent_where_little_is_known():
    run = Run(textured_world(), **CACHED)
    pixels = run.frame.width * run.frame.height
    run.fill(0)
    start = run.spent[0]
    for index in range(1, 24):
        run.fill(index)
    assert start > 3 * pixels
    assert run.spent[0] < 1.5 * pixels


@pytest.mark.slow
def test_where_paths_find_all_light_most_are_traced_at_first():
    """Two passes will do where light is even; the first has no primary rays. What comes into view is soon known too."""
    world = textured_world()
    world = panning(replace(world, materials=(world.materials[0], hw.GREY)))
    assert not direct_light_is_analytic(world)
    run = Run(world, light_cache=True, spp=16, probe_spp=1, probe_every=8)
    covered = (run.fill(0).plane("Coverage") > 0).sum()
    assert run.spent[0] == 16 * (world.camera.width * world.camera.height + covered)
    later = []
    for index in range(1, 6):
        run.fill(index)
        later.append(run.spent[0])
    assert max(later) < 5 * covered and later[-1] < 1.5 * covered


@pytest.mark.parametrize("sampler", ["sobol", pytest.param("pcg", marks=pytest.mark.slow)])
def test_threads_and_tiles_change_nothing(sampler):
    world = panning(textured_world())
    one = Run(world, threads=1, sampler=sampler, **CACHED)
    many = Run(world, threads=3, tile_pixels=7, sampler=sampler, **CACHED)
    for index in range(4):
        np.testing.assert_array_equal(one.fill(index).planes, many.fill(index).planes)


@pytest.mark.parametrize("fps", [60.0, 240.0])
def test_at_a_pace_light_becomes_better_at_the_same_times_whatever_the_frames(fps):
    """A frame that comes sooner shows it as it is known, traces no path, and leaves all later frames as they were."""
    world = panning(textured_world())
    few, many = (Run(world, light_hz=30.0, fps=each, **CACHED) for each in (30.0, fps))
    times = int(fps / 30.0)
    first = few.fill(0)
    np.testing.assert_array_equal(many.fill(0).planes, first.planes)
    for index in range(1, 3 * times + 1):
        found = many.fill(index)
        assert (many.spent[0] == 0) == (index % times > 0)
        if index % times == 0:
            np.testing.assert_array_equal(found.planes, few.fill(index // times).planes)
    assert (found.planes != first.planes).any()


def test_effort_that_is_set_meanwhile_holds_from_the_next_frame_on():
    """Else a frame would have more paths than there is room for."""

    class Doubling(light_cache_host.LightCacheHost):
        @property
        def effort(self):
            now, self._now = self._now, Effort(2 * self._now.spp, 1, 8)
            return now

        @effort.setter
        def effort(self, value):
            self._now = value

    setup, threads = effort.PrimarySetup((0.01, 0.0), sharp=True), Threads(1, wp.get_device("cpu"))
    cache_host = Doubling(4, 3, Effort(2, 1, 8), setup, None, UNTOLD, 0.28, 0, None, None, threads, "cpu")
    for index in range(3):
        changed, paths = cache_host.prepare(index, 1_000 * index, np.eye(4))
        assert changed["out_lights"].shape == (paths, 12)


def test_first_hit_rays_that_are_set_meanwhile_leave_a_frame_as_it_was():
    """Corners of pixels are seen for as many rays as the frame has."""
    calm, changed = (Run(textured_world(), **CACHED) for _ in range(2))
    cache_host = changed.tracer.light_cache_host
    prepare = cache_host.prepare

    def prepare_and_change(*arguments):
        cache_host.effort = Effort(4, 1, 8)
        found = prepare(*arguments)
        cache_host.effort = Effort(4, 1, 4)
        return found

    cache_host.prepare = prepare_and_change
    for index in range(2):
        np.testing.assert_array_equal(changed.fill(index).planes, calm.fill(index).planes)


def test_a_table_that_grows_loses_nothing(monkeypatch):
    world = panning(textured_world())
    large = Run(world, **CACHED)
    monkeypatch.setattr(cell_table, "_CELLS_PER_PIXEL", 0.25)
    small = Run(world, **CACHED)
    few = small.tracer._steerer._table.cells.shape[0]
    for index in range(4):
        np.testing.assert_array_equal(small.fill(index).planes, large.fill(index).planes)
    assert small.tracer._steerer._table.cells.shape[0] > few


def test_a_table_that_may_not_grow_forgets(monkeypatch):
    monkeypatch.setattr(cell_table, "_CELLS_PER_PIXEL", 0.25)
    monkeypatch.setattr(cell_table, "_LARGEST_TABLE", 64)
    run = Run(panning(textured_world()), **CACHED)
    for index in range(4):
        frame = run.fill(index)
    assert np.isfinite(frame.planes).all()
    assert luminance(frame).mean() > 0


def test_what_few_paths_showed_leaves_no_trace_once_it_is_forgotten():
    """With many paths then, a frame is as one that nothing was shown before: not as wrong as the first one was."""
    few, many = Effort(4, 1, 8), Effort(128, 128, 8)
    once, anew = (
        Run(textured_world(), light_cache=True, first_frame_error=9.0, spp=each.spp, probe_spp=each.probe_spp)
        for each in (few, many)
    )
    truth, first = log_brightness(anew.fill(0)), log_brightness(once.fill(0))
    for index in range(1, 4):
        once.fill(index)
    once.tracer.effort = many
    once.tracer.forget_light()
    off, before = (np.sqrt(np.mean((each - truth) ** 2)) for each in (log_brightness(once.fill(4)), first))
    assert off < 0.1 * before


def test_light_stands_still_where_nothing_but_the_camera_moves():
    assert light_stands_still(panning(textured_world()))
    assert not light_stands_still(moving_world())


def test_noise_of_each_frame_is_refused():
    with pytest.raises(InputError, match="`light_cache` needs `noise` common"):
        RenderOptions(first_hit_rays=8, light_cache=True, noise="independent")


def test_a_change_of_effort_is_silent():
    run = Run(textured_world(), **CACHED)
    first = log_brightness(run.fill(0))
    for k, (spp, probe, every) in enumerate([(1, 1, 4), (16, 2, 1), (2, 1, 8), (8, 8, 1)], start=1):
        run.tracer.effort = Effort(spp, probe, 8, every)
        assert np.abs(log_brightness(run.fill(k)) - first).max() < 1e-4


@pytest.mark.slow
def test_a_coat_reflects_what_it_does_at_the_angles_that_a_pixel_shows():
    """A black floor with a smooth coat in white light from all around; at a pixel's corner the coat is 5 % off."""
    coated = Material(kind="plastic", color=(0.0, 0.0, 0.0))
    floor = hw.quad((-30, 0, 30), (60, 0, 0), (0, 0, -60))
    view = hw.camera(hw.look_from((0, 2, 5), (0, 0, 0)), 24, 18)
    world = hw.world(floor, materials=(coated,), view=view, environment=(1.0, 1.0, 1.0))
    cached = luminance(Run(world, light_cache=True, spp=4, probe_spp=1, first_hit_rays=16).fill(0))
    truth = luminance(hw.render(world, spp=256, sampler="sobol"))
    np.testing.assert_allclose(cached.mean(axis=1), truth.mean(axis=1), rtol=0.01)


def floor_in_lamplight(floor, *textures):
    """A floor, a lamp above it, a box that throws a shadow, and a diffuse wall."""
    lamp = hw.quad((-0.2, 3.0, -0.2), (0.4, 0, 0), (0, 0, 0.4), material=1)
    meshes = [
        hw.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6), material=2),
        hw.quad((-3, 0, -2), (6, 0, 0), (0, 4, 0)),
        hw.box((-0.3, 0.4, -0.3), (0.3, 0.8, 0.3)),
    ]
    view = hw.camera(hw.look_from((0.3, 3.0, 4.0), (0, 0.2, 0)), 32, 24)
    return hw.world(*meshes, lamp, materials=(hw.GREY, LAMP, floor), view=view, textures=textures)


@pytest.mark.slow
def test_what_is_glossy_keeps_the_shadows_of_lamps():
    """Next to a wall with analytic direct light, for which few paths would do."""
    world = floor_in_lamplight(Material(kind="principled", color=(0.5, 0.5, 0.5), alpha=0.8))
    assert direct_light_is_analytic(world)
    truth = log_brightness(hw.render(world, spp=2048, sampler="sobol"))
    cached = Run(world, first_hit_rays=32, light_cache=True, spp=32, probe_spp=1).fill(0)
    assert np.sqrt(np.mean((log_brightness(cached) - truth) ** 2)) < 0.25


def test_lamps_alone_are_nothing_to_be_lit():
    """They count as diffuse, but have no analytic direct light."""
    world = floor_in_lamplight(Material(kind="conductor", alpha=0.3))
    assert direct_light_is_analytic(world)
    assert not direct_light_is_analytic(replace(world, materials=(world.materials[2], *world.materials[1:])))


@pytest.mark.slow
def test_a_normal_map_is_no_edge_where_light_is_cached():
    """The cells know the mean light of all that it bends, so it takes no more rays to see."""
    rough = Material(kind="principled", color=(0.5, 0.5, 0.5), alpha=0.4)
    texels = np.array([[[230, 128, 204, 255], [25, 128, 204, 255]]], np.uint8)
    lean = ImageTexture(texels, srgb=False, uv_matrix=((40.0, 0.0, 0.0), (0.0, 40.0, 0.0)))
    rays = []
    for floor in (rough, replace(rough, normal_texture=0)):
        run = Run(floor_in_lamplight(floor, lean), **CACHED)
        run.fill(0)
        rays.append(run.spent[1])
    assert rays[1] < 1.02 * rays[0]
