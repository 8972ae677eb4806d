"""How many samples pixels get: graded by what a decision needs, and silent whatever the grades."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from clsim.errors import Error
from clsim.frames import InterestBoard, InterestMap
from clsim.render import Effort, RenderCancelled
from clsim.render.primary.effort import SURE, PrimarySetup, primary_rays_for
from clsim.render.primary.steered import GRADES
from tests.render.primary.test_steered import Run, log_brightness, textured_world, walled_world
from tests.render.test_tracer import lit_world, moving_world

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("ordinary")]  # kernels of their own are compiled

C = 0.2
SHAPE = (10, 12)


def quiet(number):
    """A map in which the level changes a little and is sure to stay within the thresholds."""
    half, change, error = (np.full(SHAPE, value, dtype=np.float32) for value in (C, C / 10, 1e-6))
    return InterestMap(number, half, half.copy(), change, error)


def at(interest, y, x, *, distance=0.0, change=0.0, error=0.0):
    """Put a pixel's level at a distance from the ON threshold, once its change is drawn out by two and a half steps."""
    interest.to_on[y, x] = distance + 2.5 * change
    interest.to_off[y, x] = 2 * C - interest.to_on[y, x]
    interest.change[y, x], interest.stderr[y, x] = change, error
    return interest


def paths_after(interest, spp=16, probe_spp=1, every=1):
    """The paths of each pixel in the frame that goes by that map: all samples but its one primary ray."""
    board = InterestBoard()
    run = Run(walled_world(), board, spp=spp, probe_spp=probe_spp, probe_every=every, first_hit_rays=1)
    for k in range(2):
        run.fill(k)
        board.publish(interest if k == 0 else quiet(k))
    paths = run.fill(2).plane("Samples") - 1
    assert run.spent == (paths.sum(), paths.size)
    return paths


@pytest.mark.parametrize(
    ("share", "grade"), [(0.9, 0), (1.1, 1), (1.9**0.5, 1), (2.1**0.5, 2), (2.1, 3), (8.1**0.5, 4), (50.0, 4)]
)
def test_variance_is_halved_until_the_decision_is_safe(share, grade):
    """The error at which a decision is safe is the distance; n times the samples have an n-th of the variance."""
    distance = 0.03
    paths = paths_after(at(quiet(0), 4, 5, distance=distance, change=0.02, error=share * distance / SURE))
    assert paths[4, 5] == 2**grade
    # Half of it around the pixel, a quarter around those, the probe elsewhere.
    assert paths[5, 6] == max(1, 2 ** (grade - 1)) and paths[4, 7] == paths[2, 3] == max(1, 2 ** max(0, grade - 2))
    assert paths[4, 8] == paths[1, 5] == 1


def test_no_more_than_all():
    """12 is no power of 2 of the probe, 200 beyond the last grade."""
    for spp, probe_spp, inner in ((12, 2, 8), (200, 1, 2 ** (GRADES - 2))):
        paths = paths_after(at(quiet(0), 4, 5, change=0.02, error=1.0), spp, probe_spp)
        assert paths[4, 5] == spp and paths[4, 4] == inner


def test_a_sure_event_is_timed_no_better_than_to_a_quarter_of_a_step():
    """Moving by .08 a step, a level passes the threshold within a quarter of a step up to an error of .02."""
    small, large = (at(quiet(0), 4, 5, distance=-0.05, change=0.08, error=e / SURE) for e in (0.018, 0.0201))
    assert paths_after(small)[4, 5] == 1 and paths_after(large)[4, 5] == 2
    assert paths_after(at(quiet(0), 4, 5, distance=-0.05, change=0.08, error=0.0401 / SURE))[4, 5] == 8


def test_errors_cancel_where_nothing_changes():
    """At a tenth of the change that brings out all of an error, a tenth of it: .1 at a distance of nearly .2."""
    for change, grade in ((0.0, 0), (0.001, 1), (-0.001, 1), (0.01, 4), (-0.01, 4)):
        interest = quiet(0)
        interest.change[4, 5], interest.stderr[4, 5] = change, 1.0
        assert paths_after(interest)[4, 5] == 2**grade, change


def test_where_no_error_is_known_the_zone_decides():
    for error in (0.0, np.nan):
        far = at(quiet(0), 4, 5, distance=0.11 * C, change=0.02, error=error)
        near = at(quiet(0), 4, 5, distance=0.09 * C, change=0.02, error=error)
        assert (paths_after(far) == 1).all()
        paths = paths_after(near)
        assert (paths[3:6, 4:7] == 16).all() and paths.sum() == 120 + 9 * 15


def test_pixels_without_a_reference_get_all():
    interest = quiet(0)
    for plane in (interest.to_on, interest.to_off, interest.change, interest.stderr):
        plane[0, 0] = np.nan
    paths = paths_after(interest)
    assert (paths[:2, :2] == 16).all() and paths.sum() == 120 + 4 * 15


@pytest.mark.parametrize(("spp", "error", "inner", "outer"), [(2, 0.1, 2, 1), (2, 1e-6, 2, 2), (8, 0.06, 8, 4)])
def test_near_an_event_nobody_waits_for_a_turn(spp, error, inner, outer):
    """Whether or not more than the probe is needed, or to be had."""
    paths = paths_after(at(quiet(0), 4, 5, distance=0.09 * C, change=0.02, error=error), spp, 2, every=1000)
    assert paths[4, 5] == inner and (paths[3:6, 4:7] >= 2).all() and paths[3, 4] == max(2, outer)
    assert paths[1, 1] == paths[9, 9] == 0


def random_map(number, rng):
    """Any grade anywhere."""
    interest = quiet(number)
    interest.change[:] = 0.02
    interest.stderr[:] = C / 2 * 2.0 ** rng.uniform(-16, 1, SHAPE)
    interest.stderr[rng.random(SHAPE) < 0.1] = 0
    return interest


def test_grades_change_nothing_in_a_still_scene():
    """With numbers of paths that change while pixels wait for their turn, too."""
    rng, board = np.random.default_rng(5), InterestBoard()
    run = Run(textured_world(), board, spp=64, probe_spp=1)
    first, grades = log_brightness(run.fill(0)), set()
    efforts = [Effort(64, 1, 8)] * 6 + [
        Effort(spp, probe, 8, every)
        for probe, spp, every in ((2, 64, 3), (1, 48, 3), (1, 48, 3), (3, 24, 3), (3, 24, 1), (16, 64, 4), (64, 64, 4))
    ]
    for k, effort in enumerate(efforts, start=1):
        run.tracer.effort = effort
        board.publish(random_map(k - 2, rng))
        frame = run.fill(k)
        assert np.abs(log_brightness(frame) - first).max() < 1e-4, effort
        grades |= set(np.unique(frame.plane("Samples")))
    assert len(grades) > 6


def test_threads_and_tiles_do_not_change_a_bit_of_graded_pictures():
    def planes(**options):
        rng, board = np.random.default_rng(3), InterestBoard()
        run = Run(moving_world(), board, spp=16, probe_spp=1, fps=10.0, **options)
        frames = []
        for k in range(5):
            frames.append(run.fill(k).planes)
            board.publish(random_map(k, rng))
        return np.array(frames)

    one = planes(threads=1)
    np.testing.assert_array_equal(planes(threads=1), one)
    np.testing.assert_array_equal(planes(threads=2, tile_pixels=7), one)


@pytest.mark.parametrize(
    ("spp", "probe_spp", "top"), [(8, 8, 0), (8, 4, 1), (8, 1, 3), (9, 1, 4), (12, 2, 3), (1024, 1, GRADES - 1)]
)
def test_the_top_grade_has_all_paths(spp, probe_spp, top):
    assert Effort(spp, probe_spp, 1).top == top


def test_a_fill_that_waits_for_a_map_can_be_cancelled():
    run = Run(lit_world(), InterestBoard("wait"), spp=4, probe_spp=1)
    run.fill(0)
    run.fill(1)
    raised = []

    def work():
        try:
            run.fill(2)
        except RenderCancelled as error:
            raised.append(error)

    worker = threading.Thread(target=work, daemon=True)
    worker.start()
    worker.join(0.2)
    assert worker.is_alive()
    run.tracer.cancel()
    worker.join(10)
    assert not worker.is_alive() and len(raised) == 1


def test_a_map_that_the_same_thread_has_not_published_is_told_of():
    run = Run(lit_world(), InterestBoard(), spp=4, probe_spp=1)
    run.fill(0)
    run.fill(1)
    with pytest.raises(Error, match=r"frame 2 takes the interest map of frame 0"):
        run.fill(2)


def test_part_lit_pixels_get_a_power_of_two_of_rays_and_twice_as_many_where_rays_are_few() -> None:
    primary_setup = PrimarySetup((0.01, 0.0), sharp=True, lamps=True)
    found = [primary_rays_for(rays, primary_setup).in_shadow for rays in (1, 3, 8, 12, 16, 64, 100, 256)]
    assert found == [2, 4, 16, 16, 32, 32, 32, 128]
    assert primary_rays_for(64, primary_setup, cached=True).in_shadow == 32
