"""Random streams: disjoint, uncorrelated, uniform; and the sampling routines against their densities."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from clsim.render.device.devices import start_warp
from clsim.render.sampling import sampling
from clsim.render.sampling.sampling import stream_state

SEEDS, PIXELS, SAMPLES, DIMENSIONS = 10, 64, 16, 8


@wp.kernel(module="unique", enable_backward=False)
def draw(
    states: wp.array(dtype=wp.uint64),
    out_words: wp.array4d(dtype=wp.uint64),
    out_pairs: wp.array4d(dtype=wp.vec2),
):
    seed, pixel, i, d = wp.tid()
    key = sampling.stream_key(sampling.absorb(sampling.absorb(states[seed], pixel), i))
    out_words[seed, pixel, i, d] = sampling.stream_word(key, d)
    out_pairs[seed, pixel, i, d] = sampling.uniform2(key, d)


@wp.kernel(module="unique", enable_backward=False)
def draw_directions(
    pairs: wp.array(dtype=wp.vec2),
    normal: wp.vec3,
    out_cosine: wp.array(dtype=wp.vec3),
    out_cone: wp.array(dtype=wp.vec3),
    out_triangle: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    out_cosine[i] = sampling.cosine_hemisphere(normal, pairs[i])
    out_cone[i] = sampling.cone(normal, 0.3, pairs[i])
    out_triangle[i] = sampling.uniform_triangle(pairs[i])


@wp.kernel(module="unique", enable_backward=False)
def turn(turns: wp.array(dtype=float), out: wp.array(dtype=wp.vec2)):
    i = wp.tid()
    out[i] = sampling.around(turns[i])


@wp.kernel(module="unique", enable_backward=False)
def turn_back(sides: wp.array(dtype=wp.vec2), out: wp.array(dtype=float)):
    i = wp.tid()
    out[i] = sampling.angle_of(sides[i][1], sides[i][0])


@pytest.fixture(scope="module")
def streams():
    """Words and pairs ``[seed, pixel, sample, dimension]``."""
    start_warp()
    shape = (SEEDS, PIXELS, SAMPLES, DIMENSIONS)
    states = wp.array([stream_state(seed, None) for seed in range(SEEDS)], dtype=wp.uint64, device="cpu")
    words = wp.zeros(shape, dtype=wp.uint64, device="cpu")
    pairs = wp.zeros(shape, dtype=wp.vec2, device="cpu")
    wp.launch(draw, shape, inputs=[states], outputs=[words, pairs], device="cpu")
    return words.numpy(), pairs.numpy()


def test_no_word_occurs_twice_in_any_stream_of_any_seed(streams):
    words, _ = streams
    assert len(np.unique(words)) == words.size


def test_streams_of_neighbouring_seeds_pixels_and_samples_are_uncorrelated(streams):
    """Shifts by one along every axis and each diagonal of seed and sample, the trap of adding seeds to counters."""
    _, pairs = streams
    u = pairs.reshape(SEEDS, PIXELS, SAMPLES, -1).astype(np.float64) - 0.5
    for shift in ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (1, 0, -1, 0), (1, -1, 0, 0), (0, 1, -1, 0)):
        other = np.roll(u, shift, axis=(0, 1, 2, 3))
        z = (u * other).mean() * 12 * np.sqrt(u.size)
        assert abs(z) < 4.5, (shift, z)


def test_numbers_are_uniform_in_the_half_open_interval(streams):
    _, pairs = streams
    u = pairs.reshape(-1)
    assert u.min() >= 0 and u.max() < 1
    counts, _ = np.histogram(u, bins=64, range=(0, 1))
    chi2 = ((counts - u.size / 64) ** 2 / (u.size / 64)).sum()
    assert chi2 < 63 + 5 * np.sqrt(2 * 63)


def test_every_frame_has_its_own_state_only_when_asked():
    states = {stream_state(seed, frame) for seed in range(10) for frame in (None, *range(100))}
    assert len(states) == 10 * 101


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.6, -0.48, 0.64), (1e-4, 0.0, -1.0)])
def test_directions_follow_their_densities(streams, normal):
    _, pairs = streams
    pairs = pairs.reshape(-1, 2)
    normal = np.array(normal) / np.linalg.norm(normal)
    out = [wp.zeros(len(pairs), dtype=wp.vec3, device="cpu") for _ in range(3)]
    inputs = [wp.array(pairs, dtype=wp.vec2, device="cpu"), wp.vec3(*normal)]
    wp.launch(draw_directions, len(pairs), inputs=inputs, outputs=out, device="cpu")
    cosine, cone, weights = (a.numpy().astype(np.float64) for a in out)
    for directions in (cosine, cone):
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)
        side = directions - np.outer(directions @ normal, normal)
        assert np.all(np.abs(side.mean(axis=0)) < 4.5 / np.sqrt(len(pairs)))
    # cos² is uniform under the cosine law, cos is uniform within a cone.
    for uniform in ((cosine @ normal) ** 2, (cone @ normal - 0.7) / 0.3, 1 - (1 - weights[:, 0]) ** 2):
        assert uniform.min() > -1e-5 and uniform.max() < 1 + 1e-5
        assert abs(uniform.mean() - 0.5) < 4.5 * np.sqrt(1 / 12 / len(pairs))
        assert abs((uniform**2).mean() - 1 / 3) < 4.5 * np.sqrt(4 / 45 / len(pairs))
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    assert np.all(np.abs(weights.mean(axis=0) - 1 / 3) < 4.5 * np.sqrt(1 / 18 / len(pairs)))


def test_cosine_and_sine_of_turns():
    """Against float64, at all quarters and eighths and their neighbours too; small angles keep their relative error."""
    eighths = np.arange(9, dtype=np.float32) / np.float32(8)
    near = [np.nextafter(eighths, np.float32(side)) for side in (0, 1)]
    small = np.float32(10.0) ** -np.arange(3, 30, dtype=np.float32)
    turns = np.concatenate([eighths, *near, np.linspace(0, 1.5, 150_001, dtype=np.float32), small])
    start_warp()
    out = wp.zeros(len(turns), dtype=wp.vec2, device="cpu")
    wp.launch(turn, len(turns), inputs=[wp.array(turns, dtype=float, device="cpu")], outputs=[out], device="cpu")
    angles = 2 * np.pi * turns.astype(np.float64)
    np.testing.assert_allclose(out.numpy(), np.stack([np.cos(angles), np.sin(angles)], axis=1), atol=1.5e-7, rtol=0)
    np.testing.assert_allclose(out.numpy()[-len(small) :, 1], angles[-len(small) :], rtol=3e-5)


def test_angles_of_sines_and_cosines():
    """Against float64, on axes, diagonals and next to them, at any length; small angles keep their relative error."""
    angles = np.concatenate([np.linspace(0, np.pi, 100_001), np.arange(9) * np.pi / 8 * (1 - 1e-7)])
    lengths = np.resize([1.0, 1e-12, 3e7], len(angles))
    sides = (np.stack([np.cos(angles), np.abs(np.sin(angles))], axis=1) * lengths[:, None]).astype(np.float32)
    small = np.float32(10.0) ** -np.arange(1, 30, dtype=np.float32)
    sides = np.concatenate([sides, np.stack([np.ones_like(small), small], axis=1), [(0, 0), (1, 0), (-1, 0), (0, 1)]])
    start_warp()
    out = wp.zeros(len(sides), dtype=float, device="cpu")
    wp.launch(turn_back, len(sides), inputs=[wp.array(sides, dtype=wp.vec2, device="cpu")], outputs=[out], device="cpu")
    expected = np.arctan2(sides[:, 1].astype(np.float64), sides[:, 0].astype(np.float64))
    np.testing.assert_allclose(out.numpy(), expected, atol=3e-7, rtol=0)
    tiny = slice(-len(small) - 4, -4)
    np.testing.assert_allclose(out.numpy()[tiny], expected[tiny], rtol=3e-7)
