"""Paths that are kept and traced again in turn: still where all stands still, and light from the same surface alone."""

from __future__ import annotations

from dataclasses import replace

import hand_worlds as hw
import numpy as np
import pytest
import warp as wp

from clsim.frames import RADIANCE, Frame, InterestBoard, InterestMap, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.render.light_layers import ALL_AROUND, HALF, LAYERS, OTHER_HALF, REACH, Layer, Lit, draw_out, light_on
from clsim.render.turn_keeper import window_weights
from clsim.scene import Material, load_world
from clsim.scene.driven import Driven

SIZE = (16, 12)
KEPT = 8
TURNS = RenderOptions(
    spp=KEPT, probe_spp=4, probe_every=2, first_hit_rays=16, sampler="sobol", in_turn=True, fps=120, frames=8
)


def pictures(times_us, board=None, world=None, **changed):
    """Return the radiance of frames at those times, and how many paths each took, by pixel."""
    tracer = PathTracer(world or load_world("cornell", resolution=SIZE), replace(TURNS, **changed), board)
    frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
    shown, paths = [], [0]
    try:
        for index, time_us in enumerate(times_us):
            tracer.fill_at(index, time_us, frame)
            shown.append(np.stack([frame.plane(name) for name in RADIANCE]))
            paths.append(tracer.paths)
    finally:
        tracer.close()
    return np.stack(shown), np.diff(paths) / (SIZE[0] * SIZE[1])


def test_all_paths_are_traced_at_first_and_then_in_turn():
    """Without a map of interest no light is known to change: each pixel traces one path in every other frame."""
    shown, paths = pictures([0] * 6)
    assert paths[0] == KEPT and np.all(paths[1:] == 0.5)
    np.testing.assert_allclose(shown, np.broadcast_to(shown[:1], shown.shape), rtol=2e-6)


def test_to_know_light_better_changes_nothing():
    """Four times the probe's paths are traced at first; every other frame adds one to all until all are known."""
    shown, paths = pictures([0] * 20, spp=22)
    np.testing.assert_array_equal(paths, [16] + [1.5, 0.5] * 6 + [0.5] * 7)
    np.testing.assert_allclose(shown, np.broadcast_to(shown[:1], shown.shape), rtol=2e-6)


def test_paths_that_come_later_count_for_changes():
    """A block comes and stays: light is then that of a run that begins there, up to what 16 paths do not know."""
    world = load_world("cornell", resolution=SIZE)
    times_us = [0] * 10 + [1_000_000] * 200
    late = pictures(times_us, world=world, spp=64, probe_every=1, frames=len(times_us))[0][-1]
    truth = pictures([1_000_000], world=world, spp=512, probe_spp=512)[0][0]
    first = pictures([1_000_000], world=world, spp=64)[0][0]
    dark = 0.01
    error, known = (
        np.abs(np.log((each + dark).sum(axis=0) / (truth + dark).sum(axis=0))).mean() for each in (late, first)
    )
    assert error < 1.3 * known < 0.1


def test_paths_that_met_nothing_before_find_the_light_of_what_comes():
    """A wall comes where nothing was, and stays: each path counts for what it finds, as in a run that begins there."""
    wall = hw.quad((-3, -3, 0), (6, 0, 0), (0, 6, 0))
    floor = hw.quad((-3, -3, 4), (6, 0, 0), (0, 0, -4))
    lamp = hw.quad((-2, 3, 0), (4, 0, 0), (0, 0, 4), material=1)
    comes = Driven(hw.IDENTITY)
    for time_s, depth_m in ((0.0, 50.0), (0.1, 0.0)):
        comes.set(time_s, ((0.0, 0.0, depth_m), (0.0, 0.0, 0.0, 1.0), 1.0))
    world = hw.world(
        wall,
        floor,
        lamp,
        materials=(hw.GREY, Material(color=(0.0, 0.0, 0.0), emission=(5.0, 5.0, 5.0))),
        view=hw.camera(hw.look_from((0, 0, 4), (0, 0, 0)), *SIZE),
        motions=[comes, hw.IDENTITY, hw.IDENTITY],
    )
    times_us = [0] * 4 + [100_000] * 40
    late, first = (pictures(each, world=world)[0][-1] for each in (times_us, times_us[4:5]))
    np.testing.assert_allclose(late, first, rtol=1e-4)


def test_light_that_changes_is_traced_more():
    """Where a map tells of change, and around it, ``probe_spp`` paths are traced two frames later."""
    board = InterestBoard()
    half, change = np.full(SIZE[::-1], 0.2, np.float32), np.zeros(SIZE[::-1], np.float32)
    change[5, 5] = -0.0101
    for number in range(2):
        board.publish(InterestMap(number, half, half, change, np.zeros_like(change)))
    tracer_paths = pictures([0] * 3, board)[1]
    area = SIZE[0] * SIZE[1]
    # Four of the nine, or five, would have waited.
    assert tracer_paths[2] * area == pytest.approx(area / 2 + 9 * 4 - 4.5, abs=0.5)


def test_a_camera_that_is_moved_sees_what_one_sees_that_was_there_before():
    """No path that is kept tells of a pixel that shows something else; where the camera stands again they are kept."""
    world = load_world("cornell", resolution=SIZE)
    moved = Driven(world.camera.motion)
    for time_s, place_m in ((0.0, (0.0, 1.0, 3.35)), (0.02, (0.2, 1.1, 3.2))):
        moved.set(time_s, (place_m, (0.0, 0.0, 0.0, 1.0), 1.0))
    world = replace(world, camera=replace(world.camera, motion=moved))
    shown, paths = pictures([0, 8333, 16667, 25000, 33333], world=world)
    for k in range(4):
        np.testing.assert_array_equal(shown[k], pictures([8333 * k + k // 2], world=world)[0][0])
    assert np.all(paths[:4] == KEPT) and paths[4] < KEPT


@pytest.mark.slow
def test_light_is_that_of_as_many_paths_as_are_kept():
    """Nothing is lost, and nothing counted twice: the mean picture is that of paths which nobody keeps."""
    kept, _ = pictures([0], spp=64)
    plain = replace(TURNS, spp=256, probe_spp=None, probe_every=1, in_turn=False)
    tracer = PathTracer(load_world("cornell", resolution=SIZE), plain)
    frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
    tracer.fill(0, frame)
    tracer.close()
    truth = np.stack([frame.plane(name) for name in RADIANCE])
    np.testing.assert_allclose(kept[0].mean(axis=(1, 2)), truth.mean(axis=(1, 2)), rtol=0.01)


def test_pictures_do_not_depend_on_threads_and_tiles():
    """A block that moves: bit for bit the same."""
    times_us = [8333 * k for k in range(5)]
    one, _ = pictures(times_us, threads=1)
    other, _ = pictures(times_us, threads=2, tile_pixels=7)
    np.testing.assert_array_equal(one, other)


@wp.kernel
def ask(
    layers: wp.array2d(dtype=Layer), windows: wp.array2d(dtype=float), lit: Lit, turn: int, out: wp.array(dtype=wp.vec3)
):
    """Draw out each pixel's light, and find that on one thing in the middle, by all windows."""
    for pixel in range(layers.shape[0]):
        draw_out(layers, pixel, turn)
    for by in range(3):
        out[by] = light_on(layers, windows, by, layers.shape[0] // 2, 9, lit, 0.01)


@pytest.mark.parametrize("by", [ALL_AROUND, HALF, OTHER_HALF])
def test_a_thing_is_lit_by_paths_that_began_on_its_surface(by):
    """Against the sums in float64: two surfaces at right angles, some pixels without paths, light that changes."""
    rng = np.random.default_rng(3)
    side, turn = 9, 40
    layers = wp.zeros((side * side, LAYERS), dtype=Layer, device="cpu")
    values = layers.numpy()
    up, ahead = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    for pixel in range(side * side):
        for k, normal in enumerate((up, ahead)):
            count = int(rng.integers(0, 4))
            place = rng.normal(size=3) * (1 - normal) * 0.2
            values[pixel, k]["count"], values[pixel, k]["frames"] = count, count * int(rng.integers(0, turn))
            values[pixel, k]["total"], values[pixel, k]["rate"] = rng.random(3) * count, rng.normal(size=3) * 0.02
            values[pixel, k]["position"], values[pixel, k]["normal"] = place, normal
            values[pixel, k]["weight"] = 0.5 * count
    layers = wp.array(values, dtype=Layer, device="cpu")
    lit = Lit()
    lit.position, lit.normal, lit.depth = wp.vec3(0.0, 0.0, 0.0), wp.vec3(*up), 1.0
    out = wp.zeros(3, dtype=wp.vec3, device="cpu")
    windows = wp.array(window_weights(), dtype=wp.float32, device="cpu")
    wp.launch(ask, dim=1, inputs=[layers, windows, lit, turn, out], device="cpu")

    total, weight = np.zeros(3), 0.0
    for dy in range(-REACH, REACH + 1):
        for dx in range(-REACH, REACH + 1):
            white = (dx + dy) % 2 == 0
            if dx * dx + dy * dy > REACH**2 + 1 or by == (OTHER_HALF if white else HALF):
                continue
            layer = values[(4 + dy) * side + 4 + dx, 0]
            share = np.exp(-(dx * dx + dy * dy) / (2 * (REACH / 2) ** 2))
            known = layer["total"].astype(np.float64)
            drawn = known + layer["rate"] * float(turn * layer["count"] - layer["frames"])
            total += share * layer["weight"] * np.maximum(drawn, 0.2 * known) / max(layer["count"], 1)
            weight += share * layer["weight"]
    np.testing.assert_allclose(out.numpy()[by], total / weight, rtol=1e-5)
