"""Primary rays and steered samples: the same picture for less, and a change of effort that nobody sees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.frames import (
    RADIANCE,
    SAMPLES,
    Frame,
    InterestBoard,
    InterestMap,
    page_aligned,
    rendered_planes,
)
from clsim.render import Effort, PathTracer, RenderOptions
from clsim.scene import CheckerTexture, Instance, Material, SphereLight, Static
from clsim.scene.motion import Keyframes
from tests.render import hand_worlds as hw
from tests.render.test_tracer import LAMP, lit_world, moving_world

pytestmark = pytest.mark.usefixtures("ordinary")

STANDING = Keyframes((0.0, 1.0), ((0.0, 0.0, 0.0),) * 2, ((0.0, 0.0, 0.0, 1.0),) * 2)
"""A motion, as kernels take it, that leads nowhere."""
LEADS = Keyframes((0.0, 1.0), ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0)), ((0.0, 0.0, 0.0, 1.0),) * 2)
"""One that does."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def textured_world():
    """A floor of small squares, a lamp in view and sky behind."""
    checker = CheckerTexture((0.9, 0.8, 0.7), (0.1, 0.2, 0.05), scale=9.0)
    materials = (Material(color=(1.0, 1.0, 1.0), texture=0), LAMP)
    return replace(lit_world(environment=(0.3, 0.4, 0.5)), materials=materials, textures=(checker,))


def walled_world():
    """A floor, a ball and a lamp before a wall: each pixel shows a surface."""
    open_air = lit_world()
    wall = Instance(len(open_air.meshes), Static(np.eye(4)))
    meshes = *open_air.meshes, hw.quad((-20, -20, -6), (40, 0, 0), (0, 40, 0))
    return replace(open_air, meshes=meshes, instances=(*open_air.instances, wall))


class Run:
    """A tracer and the frames it fills."""

    def __init__(self, world, board=None, **options):
        self.tracer = PathTracer(world, RenderOptions(**{"first_hit_rays": 8, "sampler": "sobol"} | options), board)
        shape = (len(self.tracer.names), self.tracer.height, self.tracer.width)
        self.frame = Frame(page_aligned(shape), self.tracer.names)

    def fill(self, index):
        before = self.tracer.paths, self.tracer.first_hit_rays
        self.tracer.fill(index, self.frame)
        self.spent = self.tracer.paths - before[0], self.tracer.first_hit_rays - before[1]
        return self.frame.copy()


def log_brightness(frame):
    return np.log(np.tensordot(LUMINANCE, frame.planes[:3], axes=1))


def interest(number, near):
    """A map in which an event is near where ``near`` is true."""
    far = np.where(near, 0.0, 0.2).astype(np.float32)
    return InterestMap(number, far, np.full_like(far, 0.2), np.zeros_like(far), np.zeros_like(far))


@pytest.mark.parametrize("sampler", ["sobol", pytest.param("pcg", marks=pytest.mark.slow)])
def test_it_is_the_picture_of_plain_paths(sampler):
    plain = hw.render(textured_world(), spp=1024, variances=True)
    steered = Run(textured_world(), spp=512, first_hit_rays=512, seed=5, sampler=sampler).fill(0)
    assert steered.names == rendered_planes(first_hit_rays=True).names
    for name in set(rendered_planes().names) - set(SAMPLES):
        error = steered.plane(name) - plain.plane(name)
        bound = 5 * np.sqrt(3 * np.nan_to_num(plain.plane(f"Variance.{name}"))) + 0.03 * np.abs(plain.plane(name))
        assert (np.abs(error) <= bound + 2e-3).mean() > 0.98, name
        assert abs(error.mean()) < 0.01 * np.abs(plain.plane(name)).mean() + 1e-4, name


def test_light_seen_directly_has_a_plane():
    dark = replace(textured_world(), environment=(0.0, 0.0, 0.0))
    only_sky = Run(textured_world(), spp=1).fill(0).plane("Emission")
    no_sky = Run(dark, spp=1).fill(0)
    sky = LUMINANCE @ (0.3, 0.4, 0.5)
    missed = no_sky.plane("Coverage") == 0
    assert missed.any()
    np.testing.assert_allclose(only_sky[missed], sky, rtol=1e-5)
    np.testing.assert_array_equal(no_sky.plane("Emission")[missed], 0)
    assert no_sky.plane("Emission").max() <= 5.0 * (1 + 1e-5)


def test_textures_are_clean_after_one_path():
    reference = hw.render(textured_world(), spp=1024)
    one = Run(textured_world(), spp=1, first_hit_rays=64).fill(0)
    plain = hw.render(textured_world(), spp=1)
    off, off_plain = (np.abs(f.plane("Albedo.G") - reference.plane("Albedo.G")).mean() for f in (one, plain))
    assert off < 0.1 * off_plain


def test_threads_and_tiles_do_not_change_a_bit():
    def planes(**options):
        board = InterestBoard()
        run = Run(moving_world(), board, spp=8, probe_spp=2, fps=10.0, **options)
        near = np.random.default_rng(3).random((10, 12)) < 0.1
        frames = []
        for k in range(4):
            frames.append(run.fill(k).planes)
            board.publish(interest(k, near))
        return np.array(frames)

    one = planes(threads=1)
    for options in ({"threads": 2, "tile_pixels": 7}, {"threads": 5, "tile_pixels": 1}):
        np.testing.assert_array_equal(planes(**options), one)


def test_paths_go_where_an_event_is_near_two_frames_later():
    board = InterestBoard()
    run = Run(walled_world(), board, spp=8, probe_spp=1)
    near = np.zeros((10, 12), bool)
    near[4, 5] = True
    far = np.zeros_like(near)
    spent = []
    for k, where in enumerate((near, far, far, far)):
        run.fill(k)
        spent.append(run.spent[0])
        board.publish(interest(k, where))
    # The first frame takes all; then nothing is known; then the mark and its eight neighbours; then none.
    assert spent == [8 * 120, 120, 120 + 9 * 7, 120]


def test_nobody_is_asked_where_all_pixels_get_the_same():
    run = Run(walled_world(), InterestBoard(), spp=2, probe_spp=2)
    for k in range(4):
        run.fill(k)
    assert run.spent[0] == 2 * 120


def test_a_rise_towards_a_threshold_is_near():
    board = InterestBoard()
    run = Run(walled_world(), board, spp=8, probe_spp=1)
    rising = interest(0, np.zeros((10, 12), bool))
    rising.change[2, 3] = 0.08
    rising.change[8, 9] = -0.08
    rising.to_on[0, 0] = np.nan
    run.fill(0)
    board.publish(rising)
    board.publish(interest(1, np.zeros((10, 12), bool)))
    run.fill(1)
    run.fill(2)
    assert run.spent[0] == 120 + (9 + 9 + 4) * 7


def test_first_hit_rays_end_where_all_see_the_same():
    run = Run(lit_world())
    run.tracer.effort = Effort(1, 1, 16)
    frame = run.fill(0)
    rays = frame.plane("Samples")
    edge = (frame.plane("Coverage") > 0) & (frame.plane("Coverage") < 1)
    # Twice as many, where a shadow's edge is seen.
    assert edge.any() and rays[edge].min() > 3 * rays.min() and 16 + 1 < rays.max() <= 2 * 16 + 1
    covered = int((frame.plane("Coverage") > 0).sum())
    assert run.spent == (covered, int(rays.sum()) - covered)


@pytest.mark.slow
@pytest.mark.parametrize("sampler", ["sobol", "pcg"])
def test_first_hits_are_the_same_whether_paths_go_on_or_not(sampler):
    few, many = (Run(textured_world(), spp=spp, first_hit_rays=8, sampler=sampler) for spp in (1, 12))
    one, other = few.fill(0), many.fill(0)
    covered = (one.plane("Coverage") > 0).sum()
    assert few.spent[0] == covered and few.spent[1] > 2 * 120
    assert many.spent == (12 * covered, few.spent[1])
    for name in set(one.names) - set(RADIANCE) - set(SAMPLES):
        np.testing.assert_array_equal(one.plane(name), other.plane(name), err_msg=name)


def test_a_change_of_effort_changes_nothing_in_a_still_scene():
    board = InterestBoard()
    run = Run(textured_world(), board, spp=64, probe_spp=64)
    first = log_brightness(run.fill(0))
    steps = [(1, 64), (2, 64), (4, 32), (8, 8), (16, 64), (32, 32), (64, 64), (16, 32), (1, 1), (64, 64)]
    efforts = [Effort(spp, probe, 8, every) for probe, spp in steps for every in (1, 3)]
    for k, effort in enumerate(efforts, start=1):
        run.tracer.effort = effort
        board.publish(interest(k - 2, np.arange(120).reshape(10, 12) % 25 == 0))
        assert np.abs(log_brightness(run.fill(k)) - first).max() < 1e-4, effort


def test_without_the_control_variate_a_change_of_samples_would_fire():
    """The step that the test above must not see: the same samples, rendered by themselves."""
    few, many = (log_brightness(Run(textured_world(), spp=spp).fill(0)) for spp in (1, 64))
    assert (np.abs(few - many) > 0.14).mean() > 0.2


def test_pixels_take_turns():
    run = Run(walled_world(), spp=4, probe_spp=2, probe_every=3)
    run.fill(0)
    turns = []
    for k in range(1, 4):
        run.fill(k)
        turns.append(run.spent[0])
    assert turns == [80, 80, 80]


def test_those_who_wait_have_neighbours_who_do_not():
    run = Run(walled_world(), spp=2, first_hit_rays=1, probe_every=2)
    run.fill(0)
    for k in (1, 2):
        traced = run.fill(k).plane("Samples") == 2 + 1
        assert (traced[:, 1:] != traced[:, :-1]).all() and (traced[1:] != traced[:-1]).all()


def test_near_an_event_nobody_waits_for_a_turn():
    board = InterestBoard()
    run = Run(walled_world(), board, spp=2, probe_spp=2, probe_every=1000)
    for k in range(3):
        run.fill(k)
        board.publish(interest(k, np.ones((10, 12), bool)))
    assert run.spent[0] == 2 * 120


def test_paths_go_where_a_surface_is_seen_alone():
    ball = hw.ball(0.5, rings=12)
    view = hw.camera(hw.look_from((0, 0, 3), (0, 0, 0)))
    ends = (-0.6, 0.0, 0.0), (0.6, 0.0, 0.0)
    across = Keyframes((0.0, 0.5, 1.0), (*ends, ends[0]), ((0.0, 0.0, 0.0, 1.0),) * 3)
    world = hw.world(ball, motions=[across], materials=(Material(color=(0.5, 0.5, 0.5)),), view=view)
    world = replace(world, environment=(0.7, 0.7, 0.7))
    run = Run(world, spp=2, probe_spp=2, probe_every=1000, fps=4.0)
    before = run.fill(0).plane("Coverage") > 0
    assert 0 < before.sum() < before.size and run.spent[0] == 2 * before.sum()
    for k in range(1, 5):
        frame = run.fill(k)
        covered = frame.plane("Coverage") > 0
        # What has just come into view, or has come back, is not left without light until its turn comes.
        assert run.spent[0] >= 2 * (covered & ~before).sum() > 0
        assert (frame.plane("R")[covered] > 0.1).all()
        before = covered


def test_no_ray_goes_between_corners_that_pass_by_all_boxes():
    """But where a lamp may be smaller than a pixel."""
    view = hw.camera(hw.look_from((0, 0, 3), (0, 0, 0)), 24, 24)
    world = hw.world(hw.ball(0.3, rings=12), motions=[LEADS], view=view, environment=(0.7, 0.7, 0.7))

    def rays(*lamps):
        frame = Run(replace(world, sphere_lights=lamps), first_hit_rays=12, spp=1).fill(0)
        sky = frame.plane("Coverage") == 0
        return frame.plane("Samples")[sky], sky

    alone, sky = rays()
    # The corner's alone; where the box begins, one more.
    assert 0.7 < sky.mean() < 1 and (alone == 1).mean() > 0.9 and (alone <= 2).all()
    behind = hw.translation(0.0, 0.0, 9.0)
    many, _ = rays(SphereLight(1.0, (1.0, 1.0, 1.0), Static(behind)))
    np.testing.assert_array_equal(many, alone)
    tiny, _ = rays(SphereLight(1e-3, (1.0, 1.0, 1.0), Static(behind)))
    assert (tiny >= 2).all()


def test_going_back_in_time_restarts():
    run = Run(walled_world(), spp=8, probe_spp=1)
    spent = []
    for index in (0, 1, 0, 1):
        run.fill(index)
        spent.append(run.spent[0])
    assert spent == [960, 120, 960, 120]


def test_light_is_neither_made_nor_lost_in_a_furnace():
    white = Material(color=(1.0, 1.0, 1.0))
    view = hw.camera(hw.look_from((0, 0, 3), (0, 0, 0)))
    world = hw.world(
        hw.ball(0.5, rings=12), motions=[STANDING], materials=(white,), view=view, environment=(0.7, 0.7, 0.7)
    )
    frame = Run(world, spp=256, first_hit_rays=32, max_depth=64, roulette_start=64).fill(0)
    assert abs(frame.plane("R").mean() / 0.7 - 1) < 2e-3


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"first_hit_rays": -1}, "`first_hit_rays` must be at least 0, got -1"),
        ({"first_hit_rays": 4, "variances": True}, "give no variances"),
        ({"probe_spp": 1}, "`probe_spp` needs `first_hit_rays` of at least 1, got 0"),
        ({"first_hit_rays": 4, "probe_spp": 1, "noise": "independent"}, "`probe_spp` needs `noise` common"),
        ({"first_hit_rays": 4, "probe_spp": 9, "spp": 8}, "`probe_spp` must be at most `spp`, which is 8, got 9"),
        ({"probe_every": 2}, "`probe_every` needs `first_hit_rays` of at least 1, got 0"),
        ({"first_hit_rays": 4, "probe_every": 0}, "`probe_every` must be at least 1, got 0"),
        ({"first_hit_rays": 4, "probe_spp": 0}, "`probe_spp` must be at least 1, got 0"),
    ],
)
def test_wrong_options_are_named(options, text):
    with pytest.raises(InputError, match=text):
        RenderOptions(**options)


@pytest.mark.parametrize("values", [(1, 2, 4, 1), (4, 0, 4, 1), (4, 1, 0, 1), (4, 1, 4, 0)])
def test_wrong_efforts_are_refused(values):
    with pytest.raises(InputError):
        Effort(*values)
