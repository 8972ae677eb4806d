"""Light that follows what moves: a function of where all is, right in its change, and silent where nothing moves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

from clsim.frames import RADIANCE, Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.render.accel.upload_geometry import Places, into_boxes
from clsim.render.cache import cell_table
from clsim.render.cache.light_cache import Followed
from clsim.render.cache.path_store import Movement, PathStore
from clsim.render.cache.stored_paths import FOLLOWED_SUMS, StoredPath, build_storing
from clsim.render.cache.trails import Moved, trail_crosses
from clsim.scene import Camera, Instance, Material, Mesh, SphereLight, Static, load_world, shapes
from clsim.scene.driven import Driven
from clsim.scene.modulation import Pwm
from tests.render import hand_worlds as hw

pytestmark = pytest.mark.usefixtures("ordinary")

SIZE = (24, 18)
OPTIONS = RenderOptions(
    spp=8, probe_spp=1, probe_every=1000, first_hit_rays=16, sampler="sobol", light_cache=True, fps=120, frames=8
)
STAYS = (0.0, 0.0, 0.0, 1.0)


def pictures(world, times_us, **changed):
    """Return the radiance of frames at those times ``[frames, 3, H, W]``, and how many paths each took."""
    tracer = PathTracer(world, replace(OPTIONS, **changed))
    frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
    shown, paths = [], [0]
    try:
        for index, time_us in enumerate(times_us):
            tracer.fill_at(index, time_us, frame)
            shown.append(np.stack([frame.plane(name) for name in RADIANCE]))
            paths.append(tracer.paths)
    finally:
        tracer.close()
    return np.stack(shown), np.diff(paths)


def driven(first, poses):
    """Return a motion through positions at times [s]."""
    motion = Driven(first)
    for time_s, position in poses:
        motion.set(time_s, (position, STAYS, 1.0))
    return motion


def room(box, lamp=hw.IDENTITY, environment=(0.0, 0.0, 0.0), radiance=(40.0, 40.0, 40.0)):
    """A floor and two walls in the light of a small sphere, in which a box moves."""
    floor = hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4))
    back = hw.quad((-2, 0, -2), (4, 0, 0), (0, 4, 0))
    side = hw.quad((-2, 0, 2), (0, 0, -4), (0, 4, 0), material=1)
    cube = hw.box((-0.4, -0.4, -0.4), (0.4, 0.4, 0.4))
    return hw.world(
        floor,
        back,
        side,
        cube,
        materials=(hw.GREY, Material(color=(0.7, 0.1, 0.1))),
        view=hw.camera(hw.look_from((0.6, 1.6, 4.5), (0, 0.7, -0.5)), *SIZE),
        motions=[hw.IDENTITY, hw.IDENTITY, hw.IDENTITY, box],
        sphere_lights=(SphereLight(0.2, radiance, lamp),),
        environment=environment,
    )


def there_and_back():
    places = ((0.0, (0.4, 0.4, 0.0)), (0.1, (0.4, 0.4, 0.0)), (0.2, (-0.3, 0.4, 0.4)), (0.3, (0.4, 0.4, 0.0)))
    return driven(hw.IDENTITY, places)


@dataclass(frozen=True)
class Shifts:
    """A mesh whose corners go where a motion takes it."""

    rest: Mesh
    motion: Driven
    duration_s: float = 1.0

    def vertices_at(self, time_s):
        return (self.rest.vertices + self.motion.pose(time_s)[:3, 3]).astype(np.float32), None


def lamp_at(x=1.2):
    return Static(hw.translation(x, 3.0, 1.0))


def test_what_moves_and_comes_back_finds_the_same_light():
    """To a rounding, once nothing is learnt between: light is known by where all is, not by what was before."""
    times_us = [100_000, 200_000] * 4
    shown, _ = pictures(room(there_and_back(), lamp_at()), times_us, spp=64)
    np.testing.assert_allclose(shown[-1], shown[-3], rtol=1e-6)
    np.testing.assert_allclose(shown[-2], shown[-4], rtol=1e-6)
    assert np.abs(shown[-1] - shown[-2]).max() > 0.05


@pytest.mark.parametrize("times", [2.0**-30, 2.0**20])
@pytest.mark.parametrize("box", [Static(hw.translation(0.4, 0.4, 0.0)), there_and_back()])
def test_light_in_other_units_gives_the_same_picture(times, box):
    """To the bit, for powers of two, if what the sensor sees is in these units too: bright ones, and dark ones."""
    shown = []
    for by in (1.0, times):
        lit = room(box, lamp_at(), (0.3 * by,) * 3, (40.0 * by, 30.0 * by, 20.0 * by))
        scene = replace(lit, sensor=replace(lit.sensor, scale=1.0 / by))
        shown.append(pictures(scene, [0, 50_000, 110_000, 200_000], max_depth=4)[0] / by)
    np.testing.assert_array_equal(*shown)


def test_no_path_is_traced_where_nothing_has_moved():
    """And few where a box has, for most paths do not come near it."""
    world = room(there_and_back(), lamp_at())
    _, paths = pictures(world, [0, 50_000, 100_000, 200_000])
    # A few pixels do not know enough yet.
    assert max(paths[1], paths[2]) < 0.01 * paths[0]
    assert 0.01 * paths[0] < paths[3] < 0.5 * paths[0]


@pytest.mark.slow  # a kernel of its own is compiled
def test_light_follows_what_deforms_as_it_does_what_moves():
    world, moves = room(hw.IDENTITY, lamp_at()), there_and_back()
    rest = world.meshes[3]
    shifting = replace(world, meshes=(*world.meshes[:3], replace(rest, deformation=Shifts(rest, moves))))
    times_us = [100_000, 200_000, 200_000]
    shown, expected = (pictures(each, times_us, spp=64)[0] for each in (shifting, room(moves, lamp_at())))
    assert np.abs(shown[2] - expected[2]).mean() < 0.02 * np.abs(expected[2] - expected[0]).mean()


def test_the_order_in_which_paths_are_stored_changes_nothing(monkeypatch):
    """On a GPU threads store them in another order each time; runs are alike to the bit all the same."""
    lamp = driven(hw.translation(1.2, 3.0, 1.0), ((0.0, (1.2, 3.0, 1.0)), (0.1, (-1.2, 3.0, 1.0))))
    world = room(there_and_back(), lamp)
    times_us = range(0, 50_000, 10_000)
    shown, _ = pictures(world, times_us, follow_every=4)
    rng, choose = np.random.default_rng(0), PathStore._choose
    shuffled = []

    def choose_in_any_order(store, *given):
        first, count = store.stored, choose(store, *given)
        if count <= len(store._paths):
            rows = store._paths.numpy()
            rows[first:count] = rng.permutation(rows[first:count])
            shuffled.append(count - first)
        return count

    monkeypatch.setattr(PathStore, "_choose", choose_in_any_order)
    again, _ = pictures(world, times_us, follow_every=4)
    assert max(shuffled) > 100
    np.testing.assert_array_equal(again, shown)


@pytest.mark.slow
def test_light_changes_as_it_does_by_many_paths():
    """A box that comes into a room shades and lights it; against pictures of 4,096 paths."""
    comes = driven(hw.IDENTITY, ((0.0, (0.9, 0.4, -1.2)), (0.1, (0.0, 0.4, 0.2))))
    world = room(comes, lamp_at(), environment=(0.3, 0.3, 0.3))
    shown, _ = pictures(world, [0, 100_000], stored_paths=512, spp=32)
    truth, _ = pictures(
        world, [0, 100_000], light_cache=False, probe_spp=None, probe_every=1, first_hit_rays=0, spp=4096
    )
    shown, truth = (np.log(each.mean(axis=1) + 0.02) for each in (shown, truth))
    change, true_change = shown[1] - shown[0], truth[1] - truth[0]
    error = np.abs(change - true_change)
    assert np.quantile(np.abs(true_change), 0.75) > 0.02
    assert np.median(error) < 0.015 and np.quantile(error, 0.8) < 0.05


def test_the_error_of_a_change_is_that_of_the_ratio_of_two_sums():
    """Of 60 paths in one cell, whose light is found twice; against the formula in float64."""
    rng = np.random.default_rng(3)
    first, then = rng.exponential(1.0, (2, 60, 3))
    rows = np.zeros(60, StoredPath.numpy_dtype())
    rows["rows"], rows["base"], rows["limit"] = (0, -1, -1, -1), 1.0, 1e20
    paths = wp.array(rows, dtype=StoredPath, device="cpu")
    sums = wp.zeros((1, FOLLOWED_SUMS), dtype=wp.int64, device="cpu")
    followed = wp.zeros(1, dtype=Followed, device="cpu")
    traced = wp.ones(60, dtype=wp.int32, device="cpu")
    for joining, light in ((True, first), (False, 0.5 * (first + then))):
        found = wp.array(light.astype(np.float32), dtype=wp.vec3, device="cpu")
        of = [0, joining, False]
        wp.launch(build_storing().add_paths, 60, [*of, 1.0, paths, found, traced, sums, followed], device="cpu")
        wp.launch(build_storing().average_paths, 60, [*of, 1, paths, traced, sums, followed], device="cpu")
        before, now = first.mean(axis=1), light.mean(axis=1)
        ratio = now.sum() / before.sum()
        expected = np.sqrt(np.square(now - ratio * before).sum()) / before.sum()
        assert followed.numpy()["error"][0] == pytest.approx(expected, rel=1e-3, abs=1e-3)
    assert expected > 0.03


def test_a_lamp_that_goes_out_leaves_no_light_behind():
    world = room(hw.IDENTITY, lamp_at())
    lamp = replace(world.sphere_lights[0], modulation=Pwm(5.0, 0.5))
    shown, _ = pictures(replace(world, sphere_lights=(lamp,)), [10_000, 60_000, 110_000, 160_000])
    bright = shown.mean(axis=(1, 2, 3))
    assert np.all(bright[:2] > 0.01) and np.all(bright[2:] < 1e-4 * bright.max())


@pytest.mark.parametrize("blinks", [False, True])
def test_paths_have_limits_unless_lamps_change_their_brightness(monkeypatch, blinks):
    """Then all paths find more or less at once, and that is no luck of one of them."""
    store, limits = PathStore.store, []

    def store_and_note(paths, *given):
        store(paths, *given)
        limits[:] = paths.unit * paths._paths.numpy()["limit"][: paths.stored]

    monkeypatch.setattr(PathStore, "store", store_and_note)
    world = room(hw.IDENTITY if blinks else there_and_back(), lamp_at())
    lamp = replace(world.sphere_lights[0], modulation=Pwm(5.0, 0.5) if blinks else None)
    shown, _ = pictures(replace(world, sphere_lights=(lamp,)), [10_000, 60_000])
    finite = np.array(limits)[np.array(limits) < 1e9]
    assert len(limits) > 100 and (len(finite) == 0 if blinks else len(finite) > 0.9 * len(limits))
    if not blinks:
        # Ten times what surfaces reflect, about: indirect light alone is in cells here.
        assert 0.05 * shown.mean() < np.median(finite) < 20 * shown.mean()


def test_a_lamp_that_moves_is_followed_in_turn():
    """A sixth of the paths in each frame; when it stands still all are traced once more, and then none."""
    moves = driven(hw.IDENTITY, [(k / 120, (1.2 - 0.05 * min(k, 8), 3.0, 1.0)) for k in range(24)])
    world = room(driven(hw.IDENTITY, ((0.0, (0.4, 0.4, 0.0)),)), moves)
    times_us = [round(k * 1e6 / 120) for k in range(24)]
    shown, paths = pictures(world, times_us)
    stored = pictures(world, times_us, follow_every=1)[1][2]
    assert paths[2] == pytest.approx(stored / 6, rel=0.05)
    assert paths[9] == pytest.approx(stored, rel=0.05)
    assert paths[10:].sum() < 0.01 * stored
    at_once, _ = pictures(world, times_us, follow_every=1)
    np.testing.assert_allclose(shown[-1], at_once[-1], rtol=2e-4, atol=1e-5)
    # Paths whose turn it is not go on as they did before.
    assert np.abs(shown[5:9] - at_once[5:9]).mean() < 2e-3 * at_once[5:9].mean()


def test_how_many_paths_are_stored_goes_by_whether_lamps_move():
    """All of them change with a lamp that moves, and few with a box; a setting of the other kind changes nothing."""
    moves = driven(hw.IDENTITY, ((0.0, (1.2, 3.0, 1.0)), (0.1, (-1.2, 3.0, 1.0))))
    for lamp, counts, other in ((moves, "lamp_paths", "stored_paths"), (lamp_at(), "stored_paths", "lamp_paths")):
        world = room(there_and_back(), lamp)
        many, few, same = (
            pictures(world, [100_000, 150_000], spp=64, follow_every=1, **{counts: 128, other: 128} | changed)[1][1]
            for changed in ({}, {counts: 16}, {other: 16})
        )
        assert same == many and 0 < few < 0.5 * many


@pytest.mark.parametrize("threads", [1, 3])
def test_threads_change_nothing(threads):
    world = room(there_and_back(), lamp_at())
    times_us = [100_000, 150_000, 200_000]
    shown, _ = pictures(world, times_us, threads=threads, probe_every=2)
    np.testing.assert_array_equal(shown, pictures(world, times_us, threads=2, probe_every=2)[0])


def test_what_a_camera_has_left_behind_is_forgotten(monkeypatch):
    """It drives past a long wall with a box: paths are stored of what it sees, and not of all that it ever saw."""
    walls = hw.quad((-9, 0, 2), (138, 0, 0), (0, 0, -4)), hw.quad((-9, 0, -2), (138, 0, 0), (0, 4, 0))
    box = hw.box((-0.4, 0.0, -0.4), (0.4, 0.8, 0.4))
    times_s = np.arange(40) / 120
    view, ahead = (driven(hw.IDENTITY, [(t, (360 * t, *at)) for t in times_s]) for at in ((1.2, 4.0), (0.0, 0.0)))
    lamp = SphereLight(9.0, (40.0, 40.0, 40.0), Static(hw.translation(60.0, 90.0, 90.0)))
    world = hw.world(
        *walls, box, motions=[hw.IDENTITY, hw.IDENTITY, ahead], sphere_lights=(lamp,), view=Camera(12, 9, 40.0, view)
    )
    stored = []
    follow = PathStore.follow
    monkeypatch.setattr(PathStore, "follow", lambda self, table: (stored.append(self.stored), follow(self, table)))

    def drive():
        stored.clear()
        shown, _ = pictures(world, np.round(times_s * 1e6).astype(int).tolist(), probe_every=2)
        return shown, stored[-1], max(stored)

    shown, everything, _ = drive()
    monkeypatch.setattr(cell_table, "_REMEMBERED", 6)
    monkeypatch.setattr(cell_table, "_ROUNDS_REMEMBERED", 3)
    forgetful, _, most = drive()
    assert most < 0.7 * everything
    lit = shown.mean(axis=1) > 0
    assert lit.mean() > 0.5
    np.testing.assert_allclose(forgetful.mean(axis=1)[lit], shown.mean(axis=1)[lit], rtol=0.1)


@wp.kernel(enable_backward=False)
def ask(
    trails: wp.array2d(dtype=wp.vec3),
    places: int,
    moved: Moved,
    out: wp.array(dtype=int),
):
    out[0] = wp.where(trail_crosses(trails, 0, places, moved), 1, 0)


@given(st.integers(0, 2**32 - 1))
def test_trails_cross_the_boxes_that_points_along_them_lie_in(seed):
    """Against ten thousand points on each way, for turned boxes a little larger and a little smaller."""
    rng = np.random.default_rng(seed)
    places, boxes = int(rng.integers(1, 5)), rng.uniform(-1, 1, (2, 3))
    trail = rng.uniform(-2, 2, (16, 3)).astype(np.float32)
    lower, upper = boxes.min(axis=0), boxes.max(axis=0)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.uniform(-0.5, 0.5, 3)
    ways = [(trail[2 * i], trail[2 * i + 1]) for i in range(places)]
    ways += [(trail[2 * i], trail[2 * i + 2]) for i in range(places - 1)]
    share = np.linspace(0, 1, 10_000)[:, None]

    def inside(points):
        return (points - pose[:3, 3]) @ pose[:3, :3]

    def crosses(room_m):
        return any(
            bool(
                np.any(
                    np.all((p := inside(a + (b - a) * share)) >= lower - room_m, axis=1)
                    & np.all(p <= upper + room_m, axis=1)
                )
            )
            for a, b in ways
        )

    out = wp.zeros(1, dtype=wp.int32, device="cpu")
    corners = np.array([[x, y, z] for x, y, z in np.ndindex(2, 2, 2)]) * (upper - lower) + lower
    corners = corners @ pose[:3, :3].T + pose[:3, 3]
    around = np.array([[corners.min(axis=0) - 1e-5, corners.max(axis=0) + 1e-5]])
    # One that is where all of the trail is, and another that stands there: only the first counts.
    far = Places(
        0.0,
        2,
        np.array([0, 1]),
        np.zeros(2, bool),
        np.stack([np.eye(4) * 2, np.eye(4)]),
        np.array([[[8.0] * 3, [9.0] * 3], [[-3.0] * 3, [3.0] * 3]]),
        into_boxes(np.stack([np.eye(4)] * 2), np.array([[8.0] * 3, [-3.0] * 3]), np.array([[9.0] * 3, [3.0] * 3])),
    )
    movement = Movement(far, "cpu")
    here = replace(
        far,
        poses=np.stack([pose, np.eye(4)]),
        boxes=np.concatenate([around, far.boxes[1:]]),
        into_boxes=np.concatenate([into_boxes(pose[None], lower[None], upper[None]), far.into_boxes[1:]]),
    )
    assert movement.to(here)
    wp.launch(ask, 1, [wp.array(trail[None], dtype=wp.vec3, device="cpu"), places, movement.moved, out], device="cpu")
    found = bool(out.numpy()[0])
    assert found or not crosses(-1e-3)
    assert not found or crosses(1e-3)


def test_what_nobody_sees_changes_nothing():
    """A speck that moves far behind a wall leaves the picture of a round thing as it is, but for roundings."""
    world = load_world("two-boxes", resolution=SIZE)
    ball = Instance(len(world.meshes), Static(hw.translation(0.1, 0.6, 1.2)), "ball")
    world = replace(world, meshes=(*world.meshes, shapes.sphere(0.5, 12)), instances=(*world.instances, ball))
    speck = Instance(len(world.meshes), driven(hw.IDENTITY, ((0.0, (0, 0, -300.0)), (1.0, (1.0, 0, -300.0)))), "speck")
    more = replace(world, meshes=(*world.meshes, shapes.box((0.01,) * 3)), instances=(*world.instances, speck))
    times_us = [0, 8333, 16667, 25000]
    without, with_it = (pictures(each, times_us, probe_every=16)[0] for each in (world, more))
    change = np.abs(np.log((with_it + 1e-3).sum(axis=1) / (without + 1e-3).sum(axis=1)))
    assert np.quantile(change, 0.99) < 1e-4
