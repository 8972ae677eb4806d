"""What first-hit rays saw is kept while nothing that moves comes near: never longer, whatever a ray leads through."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from clsim.frames import Frame, page_aligned
from clsim.render import RenderOptions, SceneData, View
from clsim.render.geometry import Geometry
from clsim.render.guard_keeper import Guards
from clsim.render.guards import meets_guard
from clsim.scene import Material, load_world
from clsim.scene.driven import Driven

SIZE = (24, 18)
TURNS = RenderOptions(
    spp=4, probe_spp=1, probe_every=4, first_hit_rays=16, sampler="sobol", in_turn=True, fps=120, frames=40
)


def cornell(tall=None, speed=1.0):
    """The bundled box; its tall block may be of another material, its short one faster."""
    world = load_world("cornell", resolution=SIZE)
    block = next(i for i, each in enumerate(world.instances) if each.motion.duration_s > 0)
    instances = list(world.instances)
    motion = instances[block].motion
    times_s = tuple(time_s / speed for time_s in motion.times_s)
    instances[block] = replace(instances[block], motion=replace(motion, times_s=times_s))
    if tall is not None:
        vertices = [world.meshes[each.mesh].vertices @ each.motion.pose(0)[:3, :3].T for each in instances]
        at = next(i for i, v in enumerate(vertices) if np.isclose(np.ptp(v[:, 1]), 1.2))
        mesh = world.meshes[instances[at].mesh]
        meshes = list(world.meshes)
        meshes[instances[at].mesh] = replace(mesh, material_ids=np.full_like(mesh.material_ids, len(world.materials)))
        world = replace(world, meshes=tuple(meshes), materials=(*world.materials, tall))
    return replace(world, instances=tuple(instances))


def frames_of(world, *, keep, times_us=None, **changed):
    """Return all planes but the count of samples, and how many first-hit rays each frame took."""
    data = SceneData(world)
    view = View(data, replace(TURNS, **changed))
    frame = Frame(page_aligned((len(view.names), view.height, view.width)), view.names)
    shown, rays = [], [0]
    for index, time_us in enumerate(times_us or [round(k / 120 * 1e6) for k in range(TURNS.frames)]):
        if not keep:
            data.guards.generation += 1
        view.fill_at(index, time_us, frame)
        shown.append(np.stack([frame.plane(name) for name in view.names if name != "Samples"]))
        rays.append(view.first_hit_rays)
    view.close()
    return np.stack(shown), np.diff(rays)


@pytest.mark.parametrize(
    "world",
    [
        pytest.param(cornell(), id="matt"),
        pytest.param(cornell(speed=25.0), id="fast"),
        pytest.param(
            cornell(Material(kind="conductor", alpha=0.0, color=(0.9, 0.9, 0.9))), id="mirror", marks=pytest.mark.slow
        ),
        pytest.param(cornell(Material(kind="dielectric", ior=1.5, alpha=0.0)), id="glass", marks=pytest.mark.slow),
    ],
)
def test_what_is_kept_is_what_would_be_seen(world):
    """Bit for bit, beside a run whose guards are others in each frame, so that nothing is kept."""
    kept, rays = frames_of(world, keep=True)
    anew, all_rays = frames_of(world, keep=False)
    np.testing.assert_array_equal(kept, anew)
    assert np.any(anew[0] != anew[-1])
    assert rays.sum() < 0.7 * all_rays.sum()


def test_what_is_moved_from_outside_is_seen():
    """The block goes where nobody foresaw it, and stands still at times; pictures come at uneven times."""
    world = cornell()
    block = next(i for i, each in enumerate(world.instances) if each.motion.duration_s > 0)
    motion = Driven(world.instances[block].motion)
    rng = np.random.default_rng(5)
    for k in range(12):
        place = (float(rng.uniform(-0.6, 0.6)), 0.28, 0.4) if k % 4 else (0.0, 0.28, 0.4)
        motion.set(0.02 * k + 0.01, (place, (0.0, 0.0, 0.0, 1.0), 1.0))
    instances = list(world.instances)
    instances[block] = replace(instances[block], motion=motion)
    world = replace(world, instances=tuple(instances))
    times_us = sorted(int(t) for t in rng.uniform(0, 250_000, 30))
    np.testing.assert_array_equal(
        frames_of(world, keep=True, times_us=times_us)[0], frames_of(world, keep=False, times_us=times_us)[0]
    )


def test_other_rays_see_for_themselves():
    """Where the number of first-hit rays changes, nothing is kept of what others saw."""
    data = SceneData(cornell())
    view = View(data, TURNS)
    frame = Frame(page_aligned((len(view.names), view.height, view.width)), view.names)
    taken = []
    for index, rays in enumerate((16, 16, 32, 32, 16)):
        view.effort = replace(view.effort, first_hit_rays=rays)
        before = view.first_hit_rays
        view.fill_at(index, 0, frame)
        taken.append(view.first_hit_rays - before)
    view.close()
    assert taken[1] < 0.5 * taken[0] and taken[2] > taken[0] and taken[3] < 0.5 * taken[2] and taken[4] == taken[0]


@wp.kernel
def ask(geometry: Geometry, rays: wp.array2d(dtype=wp.vec3), far: wp.array(dtype=float), out: wp.array(dtype=int)):
    """Ask for each ray whether it leads through a guard."""
    i = wp.tid()
    out[i] = wp.where(meets_guard(geometry, rays[i, 0], rays[i, 1], far[i]), 1, 0)


def test_a_ray_meets_a_guard_where_it_has_a_point_in_it():
    """Against points along rays, some of which are parallel to axes, begin in a box or end before it."""
    rng = np.random.default_rng(1)
    geometry = Geometry()
    guards = Guards(3, geometry, "cpu")
    lowers = rng.uniform(-1, 0.5, (3, 3))
    guards.follow(lowers, lowers + rng.uniform(0.1, 0.8, (3, 3)))
    boxes = geometry.guards.numpy().reshape(3, 2, 3)
    count = 4000
    starts, ends = rng.uniform(-2, 2, (count, 3)), rng.uniform(-2, 2, (count, 3))
    ends[:500, :2], ends[500:900, 1] = starts[:500, :2], starts[500:900, 1]
    length = np.linalg.norm(ends - starts, axis=1)
    rays = np.stack([starts, (ends - starts) / length[:, None]], axis=1)
    out = wp.zeros(count, dtype=wp.int32, device="cpu")
    inputs = [geometry, wp.array(rays, dtype=wp.vec3, device="cpu"), wp.array(length, dtype=float, device="cpu"), out]
    wp.launch(ask, dim=count, inputs=inputs, device="cpu")
    along = starts[:, None] + np.linspace(0, 1, 801)[:, None] * (ends - starts)[:, None]
    deep = np.zeros(count)
    for low, high in boxes:
        deep = np.maximum(deep, np.minimum(along - low, high - along).min(axis=2).max(axis=1))
    met = out.numpy() == 1
    assert met[deep > 0].all() and not met[deep < -0.01].any() and 0.05 < met.mean() < 0.95


def test_guards_hold_until_something_leaves_its_box():
    """Steady motion in n steps takes few generations; a thing that stands still takes one."""
    guards = Guards(2, Geometry(), "cpu")
    lowers, step = np.array([[0.0, 0, 0], [5.0, 0, 0]]), np.array([[0.02, 0, 0], [0, 0, 0]])
    found = []
    for k in range(64):
        guards.follow(lowers + k * step, lowers + k * step + 0.5)
        found.append(guards.generation)
    assert found[0] == 1 and 3 <= found[-1] <= 7
    still = Guards(1, Geometry(), "cpu")
    for _ in range(5):
        still.follow(lowers[:1], lowers[:1] + 1)
    assert still.generation == 1


def test_many_things_share_guards():
    """A box of several holds them all; none is forgotten."""
    rng = np.random.default_rng(2)
    lowers = rng.uniform(-3, 3, (100, 3))
    geometry = Geometry()
    Guards(100, geometry, "cpu").follow(lowers, lowers + 0.1)
    boxes = geometry.guards.numpy().reshape(-1, 2, 3)
    assert geometry.guard_count == len(boxes) < 100
    inside = (lowers[:, None] >= boxes[:, 0]) & (lowers[:, None] + 0.1 <= boxes[:, 1])
    assert inside.all(axis=2).any(axis=1).all()
