"""Paths that are kept and traced again in turn: still where all stands still, and light from the same surface alone."""

from __future__ import annotations

from dataclasses import replace

import hand_worlds as hw
import numpy as np
import pytest
import warp as wp

from clsim.frames import RADIANCE, Frame, InterestBoard, InterestMap, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.render.light_layers import (
    ALL_AROUND,
    HALF,
    LAYERS,
    OTHER_HALF,
    Layer,
    Lit,
    Row,
    draw_out,
    light_on,
    move_layer,
    put_on,
    sum_rows,
)
from clsim.render.turn_keeper import weights_around
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


@pytest.mark.parametrize("fps", [60, 120, 480])
def test_light_that_changes_is_traced_more(fps):
    """Where a map tells that a sixth of a second is enough for an event, and around, two frames later, at any rate."""
    board = InterestBoard()
    half, change = np.full(SIZE[::-1], 0.2, np.float32), np.zeros(SIZE[::-1], np.float32)
    change[5, 5], change[5, 11] = -0.2 * 6.1 / fps, 0.2 * 5.9 / fps
    for number in range(2):
        board.publish(InterestMap(number, half, half, change, np.zeros_like(change)))
    tracer_paths = pictures([k * 1_000_000 // fps for k in range(3)], board)[1]
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


SIDE = 13


@wp.kernel
def sum_up(layers: wp.array2d(dtype=Layer), weights: wp.array(dtype=float), turn: int, rows: wp.array2d(dtype=Row)):
    """Draw out each pixel's light, and sum it along rows."""
    for pixel in range(layers.shape[0]):
        draw_out(layers, pixel, turn)
    for pixel in range(layers.shape[0]):
        sum_rows(layers, weights, pixel, wp.static(SIDE), rows)


@wp.kernel
def ask(
    layers: wp.array2d(dtype=Layer),
    rows: wp.array2d(dtype=Row),
    weights: wp.array(dtype=float),
    lit: Lit,
    pixel: int,
    out: wp.array(dtype=wp.vec3),
):
    """Find the light on one thing, by all windows."""
    for by in range(3):
        out[by] = light_on(layers, rows, weights, by, pixel, wp.static(SIDE), lit, 0.01)


def asked(values, turn, kept, normal, x):
    """Return the light on a thing of that normal at column ``x`` of the middle row, by all windows ``[3, 3]``."""
    layers = wp.array(values, dtype=Layer, device="cpu")
    rows = wp.zeros((SIDE * SIDE, LAYERS), dtype=Row, device="cpu")
    weights = wp.array(weights_around(kept), dtype=wp.float32, device="cpu")
    lit = Lit()
    lit.position, lit.normal, lit.depth = wp.vec3(0.0, 0.0, 0.0), wp.vec3(*normal), 1.0
    out = wp.zeros(3, dtype=wp.vec3, device="cpu")
    wp.launch(sum_up, dim=1, inputs=[layers, weights, turn, rows], device="cpu")
    wp.launch(ask, dim=1, inputs=[layers, rows, weights, lit, SIDE // 2 * SIDE + x, out], device="cpu")
    return out.numpy()


UP, AHEAD = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("x", [6, 1])
@pytest.mark.parametrize("kept", [8, 64])
def test_a_thing_is_lit_by_paths_that_began_on_its_surface(kept, x):
    """Against the sums in float64: two surfaces at right angles, some pixels without paths, light that changes.

    A row counts where the pixel of the thing's column knows the surface.
    """
    rng = np.random.default_rng(3)
    turn = 40
    values = wp.zeros((SIDE * SIDE, LAYERS), dtype=Layer, device="cpu").numpy()
    for pixel in range(SIDE * SIDE):
        for k, normal in enumerate((UP, AHEAD)):
            count = int(rng.integers(0, 4))
            place = rng.normal(size=3) * (1 - normal) * 0.2
            values[pixel, k]["count"], values[pixel, k]["frames"] = count, count * int(rng.integers(0, turn))
            values[pixel, k]["total"], values[pixel, k]["rate"] = rng.random(3) * count, rng.normal(size=3) * 0.02
            values[pixel, k]["position"], values[pixel, k]["normal"] = place, normal
            values[pixel, k]["weight"], values[pixel, k]["footprint_m"] = 0.5 * count, 0.01
    out = asked(values, turn, kept, UP, x)

    reach = 5 if kept == 8 else 3
    for by in (ALL_AROUND, HALF, OTHER_HALF):
        total, weight = np.zeros(3), 0.0
        for dy in range(-reach, reach + 1):
            for dx in range(max(-reach, -x), reach + 1):
                white = (dx + dy) % 2 == 0
                row = (SIDE // 2 + dy) * SIDE + x
                if values[row, 0]["count"] == 0 or by == (OTHER_HALF if white else HALF):
                    continue
                layer = values[row + dx, 0]
                share = np.exp(-(dx * dx + dy * dy) / (2 * (reach / 2) ** 2))
                known = layer["total"].astype(np.float64)
                drawn = known + layer["rate"] * float(turn * layer["count"] - layer["frames"])
                total += share * layer["weight"] * np.maximum(drawn, 0.2 * known) / max(layer["count"], 1)
                weight += share * layer["weight"]
        np.testing.assert_allclose(out[by], total / weight, rtol=1e-5)


@pytest.mark.parametrize("nearest", [1, 3, 4])
def test_a_thing_that_no_path_of_its_column_met_is_lit_as_in_the_nearest_columns(nearest):
    """To the left of the thing is a wall that it belongs to; where that is too far, the pixel's own paths count."""
    values = wp.zeros((SIDE * SIDE, LAYERS), dtype=Layer, device="cpu").numpy()
    x = SIDE // 2
    for pixel in range(SIDE * SIDE):
        wall = pixel % SIDE <= x - nearest
        values[pixel, 0]["count"], values[pixel, 0]["weight"], values[pixel, 0]["footprint_m"] = 2, 2, 0.01
        values[pixel, 0]["total"] = 2 * (pixel % SIDE) if wall else 200.0
        values[pixel, 0]["normal"] = UP if wall else AHEAD
    # What is known of the wall's last column is the mean of those columns that reach it, three on its left.
    columns = np.arange(x - nearest - 3, x - nearest + 1)
    share = np.exp(-((columns - columns[-1]) ** 2) / (2 * 1.5**2))
    expected = 100.0 if nearest > 3 else np.sum(share * columns) / np.sum(share)
    np.testing.assert_allclose(asked(values, 0, 64, UP, x)[ALL_AROUND], expected, rtol=1e-5)


@wp.kernel
def move(layers: wp.array2d(dtype=Layer), height: float, normal: wp.vec3):
    """Show a pixel's surface at that height."""
    move_layer(layers, 0, wp.vec3(0.5, height, 0.0), normal, 0.1)


@pytest.mark.parametrize(
    ("height", "normal", "expected"),
    [
        (0.3, UP, (0.3, 1.0)),  # three pixels from the one, and seven from the other
        (0.8, UP, (0.0, 0.8)),
        (1.5, UP, (0.0, 1.0)),
        (0.1, AHEAD, (0.0, 1.0)),
    ],
)
def test_a_layer_goes_where_its_surface_goes(height, normal, expected):
    """It is the nearest one within four pixels, if it is turned alike."""
    values = wp.zeros((1, LAYERS), dtype=Layer, device="cpu").numpy()
    for k in range(LAYERS):
        values[0, k]["count"], values[0, k]["normal"], values[0, k]["position"] = 1, UP, (0.0, k, 0.0)
    layers = wp.array(values, dtype=Layer, device="cpu")
    wp.launch(move, dim=1, inputs=[layers, height, wp.vec3(*normal)], device="cpu")
    np.testing.assert_allclose(layers.numpy()["position"][0, :, 1], expected)


def test_a_wall_that_comes_nearer_is_lit_by_its_own_paths():
    """It goes a pixel's width toward the camera in each frame, and few paths are traced: light is that of all paths."""
    nears = Driven(hw.IDENTITY)
    for time_s, depth_m in ((0.0, 0.0), (0.2, 1.0)):
        nears.set(time_s, ((0.0, 0.0, depth_m), (0.0, 0.0, 0.0, 1.0), 1.0))
    world = hw.world(
        hw.quad((-4, -4, -2), (8, 0, 0), (0, 8, 0)),
        hw.quad((-4, -4, 4.5), (0, 8, 0), (8, 0, 0)),
        hw.quad((-0.5, 4, 1), (1, 0, 0), (0, 0, 1), material=1),
        materials=(hw.GREY, Material(color=(0.0, 0.0, 0.0), emission=(50.0, 50.0, 50.0))),
        view=hw.camera(hw.look_from((0, 0, 4), (0, 0, 0)), *SIZE),
        motions=[nears, hw.IDENTITY, hw.IDENTITY],
    )
    times_us = [8333 * k for k in range(24)]
    few, _ = pictures(times_us, world=world, spp=32, probe_spp=8, probe_every=8, frames=24)
    for k in (8, 16, 23):
        now = pictures([times_us[k]], world=world, spp=32, probe_spp=8)[0][0]
        assert np.abs(np.log(few[k].sum(axis=0) / now.sum(axis=0))).max() < 0.1


@wp.kernel
def add_paths(layers: wp.array2d(dtype=Layer), light: wp.array(dtype=float), late: int, out: wp.array(dtype=float)):
    """Trace one of eight paths in each frame; from the frame ``late`` on, in every fourth, another one comes."""
    marks = wp.zeros(shape=64, dtype=wp.int32)
    found = wp.zeros(shape=64, dtype=wp.float32)
    kept = int(8)  # noqa: UP018, RUF046  Warp: a variable that changes must be born by a call
    for turn in range(light.shape[0]):
        now = wp.vec3(light[turn])
        comes = turn >= late and turn % 4 == 0
        for s in range(kept + 1):
            joins = comes and s == kept
            if joins or (turn == 0 and s < kept) or (turn > 0 and s == turn % kept):
                marks[s] = put_on(
                    layers, 0, marks[s], wp.vec3(found[s]), now, wp.vec3(), wp.vec3(0.0, 1.0, 0.0), 0.01, turn, 64,
                    1.0, joins,
                )  # fmt: skip
                found[s] = now[0]
        if comes:
            kept += 1
        draw_out(layers, 0, turn)
        out[turn] = layers[0, 0].now[0] + layers[0, 1].now[0]


def test_paths_that_come_later_take_nothing_from_a_change():
    """While light changes steadily, what is known keeps step, however many paths come to know it meanwhile."""
    frames, late = 500, 300
    light = 1.0 + 0.01 * np.arange(frames)
    layers = wp.zeros((1, LAYERS), dtype=Layer, device="cpu")
    out = wp.zeros(frames, dtype=wp.float32, device="cpu")
    given = wp.array(light, dtype=wp.float32, device="cpu")
    wp.launch(add_paths, dim=1, inputs=[layers, given, late, out], device="cpu")
    np.testing.assert_allclose(out.numpy()[late:], light[late:], atol=1e-3)
