"""Owen-scrambled Sobol points: their stratification, their independence, and what frames say of their variance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from scipy.stats import qmc

from clsim.errors import InputError
from clsim.render import RenderOptions
from clsim.render.device.devices import start_warp
from clsim.render.sampling import sampling, sobol
from clsim.render.sampling.sampling import stream_state
from clsim.scene import Camera, Material, SphereLight, Static
from tests.render import hand_worlds as hw

pytestmark = pytest.mark.usefixtures("any_lights")
# Those that render compile kernels of their own.
slow = pytest.mark.slow

SEEDS, PIXELS, POINTS, DIMENSIONS = 4, 32, 64, 4


@wp.kernel(module="unique", enable_backward=False)
def draw(states: wp.array(dtype=wp.uint64), out_pairs: wp.array4d(dtype=wp.vec2)):
    seed, pixel, i, d = wp.tid()
    stream = sampling.Stream()
    stream.scrambling = sampling.stream_key(sampling.absorb(sampling.absorb(states[seed], pixel), -1))
    stream.reversed_index = sobol.reverse_bits(wp.uint32(i))
    out_pairs[seed, pixel, i, d] = sobol.sobol2(stream, d)


@wp.kernel(module="unique", enable_backward=False)
def draw_plain(out_points: wp.array2d(dtype=wp.uint32)):
    i = wp.tid()
    out_points[i, 0] = sobol.reverse_bits(wp.uint32(i))
    out_points[i, 1] = sobol.reverse_bits(sobol.pascal(wp.uint32(i)))


@pytest.fixture(scope="module")
def points():
    """Points ``[seed, pixel, index, dimension pair, 2]``."""
    start_warp()
    states = wp.array([stream_state(seed, None) for seed in range(SEEDS)], dtype=wp.uint64, device="cpu")
    pairs = wp.zeros((SEEDS, PIXELS, POINTS, DIMENSIONS), dtype=wp.vec2, device="cpu")
    wp.launch(draw, pairs.shape, inputs=[states], outputs=[pairs], device="cpu")
    return pairs.numpy().astype(np.float64)


def test_unscrambled_points_are_those_of_sobol():
    """As sets: SciPy takes each run of 2^m points in the order of Gray's code."""
    start_warp()
    out = wp.zeros((4096, 2), dtype=wp.uint32, device="cpu")
    wp.launch(draw_plain, 4096, outputs=[out], device="cpu")
    ours = out.numpy().astype(np.float64) / 2**32
    expected = qmc.Sobol(2, scramble=False, bits=32).random(4096)
    for n in (1, 2, 64, 1024, 4096):
        np.testing.assert_array_equal(*(p[:n][np.lexsort(p[:n].T)] for p in (ours, expected)))


@pytest.mark.parametrize("m", [0, 1, 3, 6])
def test_every_run_of_points_fills_every_dyadic_box(points, m):
    """A (0, 2)-sequence: 2^m points in a row have one in each box of area 2^-m, whatever its shape."""
    n = 2**m
    for first in range(0, POINTS, n):
        run = points[:, :, first : first + n]
        for k in range(m + 1):
            x = np.floor(run[..., 0] * 2**k) * 2 ** (m - k) + np.floor(run[..., 1] * 2 ** (m - k))
            assert np.all(np.sort(x, axis=2) == np.arange(n)[None, None, :, None])


def test_points_are_uniform_and_unrelated_across_seeds_pixels_and_dimensions(points):
    assert points.min() >= 0 and points.max() < 1
    np.testing.assert_array_equal(points * 2**24, np.round(points * 2**24))
    u = points[:, :, :16] - 0.5
    sets = u[:, :, 0]  # the first point of each set is uniform, and independent from set to set
    assert abs(sets.mean() * np.sqrt(12 * sets.size)) < 4.5
    for axis in (0, 1, 2):
        z = (sets * np.roll(sets, 1, axis=axis)).mean() * 12 * np.sqrt(sets.size)
        assert abs(z) < 4.5, axis
    # Padded dimensions are paired at random: within a set of 16, products average to 0 nearly as random ones do. Nested
    # shuffling keeps neighbours 2i, 2i + 1 together, whose leading bits differ in both dimensions: where leading bits
    # make 3/4 of a variance, that is √(1 + (3/4)²) = 1.25 times the spread of random pairs.
    products = (u * np.roll(u, 1, axis=3))[..., 0].mean(axis=2)
    spread = products.std() * np.sqrt(16) * 12
    assert abs(products.mean()) * 12 * np.sqrt(products.size * 16) < 4.5
    assert 1.1 < spread < 1.4
    assert len(np.unique(points[..., 0, 0])) > 0.99 * points[..., 0, 0].size


def lit_world(width=16, height=12):
    return hw.world(
        hw.quad((-2, -0.5, 2), (4, 0, 0), (0, 0, -4)),
        hw.ball(0.5, rings=8),
        materials=(Material(color=(0.5, 0.5, 0.5)),),
        sphere_lights=(SphereLight(0.3, (5.0, 5.0, 5.0), Static(hw.translation(0.9, 1.5, 0.6))),),
        environment=(0.3, 0.3, 0.3),
        view=hw.camera(hw.look_from((0.5, 1, 3), (0, 0, 0)), width, height),
    )


@slow
def test_pictures_keep_what_holds_for_independent_samples():
    """Neither threads nor tiles nor variances change a bit; frames share their noise unless asked; seeds differ."""
    scene = lit_world()
    one = hw.render(scene, spp=8, sampler="sobol").planes
    np.testing.assert_array_equal(hw.render(scene, spp=8, sampler="sobol", threads=3, tile_pixels=7).planes, one)
    np.testing.assert_array_equal(hw.render(scene, spp=8, sampler="sobol", variances=False).planes, one[:12])
    np.testing.assert_array_equal(hw.render(scene, 1, spp=8, sampler="sobol").planes, one)
    own = hw.render(scene, 1, spp=8, sampler="sobol", noise="independent").planes[:3]
    other = hw.render(scene, spp=8, sampler="sobol", seed=1).planes[:3]
    assert (own != one[:3]).mean() > 0.5 and (other != one[:3]).mean() > 0.5


@slow
def test_a_sample_is_the_same_whatever_their_number():
    """Two samples a, b have the mean (a + b) / 2 and its standard error |a − b| / 2: so the first alone gives a."""
    first, both = (hw.render(lit_world(), spp=spp, sampler="sobol") for spp in (1, 2))
    valid = both.plane("Coverage") == 1
    off = np.abs(first.plane("G") - both.plane("G"))[valid]
    np.testing.assert_allclose(off, np.sqrt(both.plane("Variance.G"))[valid], rtol=1e-3, atol=1e-5)
    # Sample 8 alone is what 9 samples have more than 8: no radiance is negative.
    few, more = (hw.render(lit_world(), spp=spp, sampler="sobol").planes[:3].astype(np.float64) * spp for spp in (8, 9))
    assert (more - few).min() > -1e-4
    assert np.isnan(first.plane("Variance.G")).all()


@slow
@pytest.mark.parametrize("spp", [6, 16])
def test_variances_are_honest_and_smaller(spp):
    """Over seeds; 6 samples leave batches of unequal size."""
    scene = lit_world()
    frames = {
        sampler: [hw.render(scene, spp=spp, seed=seed, sampler=sampler, threads=2) for seed in range(80)]
        for sampler in ("pcg", "sobol")
    }
    actual = {
        sampler: {name: np.var([f.plane(name) for f in found], axis=0, ddof=1) for name in ("G", "Depth", "Coverage")}
        for sampler, found in frames.items()
    }
    full = np.min([f.plane("Coverage") for f in frames["sobol"]], axis=0) > 0.5  # two batches at least
    for name in ("G", "Depth", "Coverage"):
        said = np.mean([f.plane(f"Variance.{name}")[full] for f in frames["sobol"]], axis=0)
        # Unequal batches are weighted as if their variances fell with their size, but they fall faster.
        most = 1.15 if spp % 4 == 0 else 1.3
        assert 0.85 < said.sum() / actual["sobol"][name][full].sum() < most, name
    if spp == 16:
        assert actual["pcg"]["G"].mean() > 1.5 * actual["sobol"]["G"].mean()
    means = [np.mean([f.plane("G") for f in frames[sampler]]) for sampler in ("pcg", "sobol")]
    errors = [np.sqrt(actual[sampler]["G"].sum() / 80) / 192 for sampler in ("pcg", "sobol")]
    assert abs(means[0] - means[1]) < 4 * np.hypot(*errors)


@slow
def test_an_exposure_is_stratified():
    """16 samples of a moving strip, 4 batches of 4 times each: quieter than independent times."""

    class Glide:
        duration_s = 10.0

        def pose(self, time_s):
            return hw.translation(time_s - 0.75, 0, 0)

    strip = hw.quad((-0.25, -1, -1), (0.5, 0, 0), (0, 2, 0))
    view = Camera(32, 2, 90.0, hw.IDENTITY, shutter_s=0.5)
    scene = hw.world(strip, materials=(Material(emission=(1, 1, 1)),), view=view, motions=[Glide()], fps=1.0)
    variance = {
        sampler: np.var(
            [hw.render(scene, 1, spp=16, seed=s, sampler=sampler, max_depth=1).plane("G") for s in range(30)], axis=0
        ).mean()
        for sampler in ("pcg", "sobol")
    }
    assert variance["sobol"] < 0.5 * variance["pcg"]


def test_an_unknown_sampler_is_named():
    with pytest.raises(InputError, match="`sampler` must be one of pcg, sobol, got 'halton'"):
        RenderOptions(sampler="halton")
    assert replace(RenderOptions(), sampler="sobol").sampler == "sobol"


@slow
@pytest.mark.parametrize("variances", [pytest.param(False, marks=pytest.mark.slow), True])
def test_features_at_silhouettes_are_those_of_what_is_hit(variances):
    """Samples are averaged over those that hit, batch by batch, however few of a batch do."""
    square = hw.quad((-0.33, -0.41, -2), (0.7, 0.1, 0), (-0.1, 0.8, 0))
    scene = hw.world(square, materials=(hw.GREY,), view=hw.camera(width=24, height=24))
    frame = hw.render(scene, spp=10, max_depth=1, sampler="sobol", variances=variances)
    coverage = frame.plane("Coverage")
    assert ((coverage > 0) & (coverage < 1)).sum() >= 40
    hit = coverage > 0
    for name, expected in zip(("Albedo.R", "Albedo.G", "Albedo.B", "Nz"), (*hw.GREY.color, 1.0), strict=True):
        np.testing.assert_allclose(frame.plane(name)[hit], expected, rtol=1e-5)
    assert frame.plane("Depth")[hit].min() >= 2.0 - 1e-5 and frame.plane("Depth")[hit].max() < 2.2
    # Means of parts that are weighted by their hits: what a frame of all samples at once would say.
    np.testing.assert_allclose(coverage * 10, np.rint(coverage * 10), atol=1e-5)
