"""The film against NumPy: means and variances of the mean of samples that are given."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from clsim.frames import rendered_planes
from clsim.render.camera.film import Moments, Sample, make_film
from clsim.render.device.devices import start_warp

PIXELS, SAMPLES, BATCH = 5, 24, 4
NAMES = rendered_planes(variances=True).names
WEIGHTS = (0.2126, 0.7152, 0.0722)


def filmed(batched, radiance, features, hits):
    """Return the planes of pixels, ``[n, PIXELS]``; features are albedo, normal and depth, one after the other."""
    start_warp()
    add, merge, store = make_film(True, batched)

    @wp.kernel(module="unique", enable_backward=False)
    def film(
        radiance: wp.array2d(dtype=wp.vec3),
        features: wp.array3d(dtype=float),
        hits: wp.array2d(dtype=bool),
        weights: wp.vec3,
        out_planes: wp.array2d(dtype=float),
        out_bits: wp.array2d(dtype=wp.uint32),
    ):
        pixel = wp.tid()
        moments = Moments()
        batch = Moments()
        for k in range(radiance.shape[1]):
            sample = Sample()
            sample.radiance = radiance[pixel, k]
            sample.hit = hits[pixel, k]
            sample.albedo = wp.vec3(features[pixel, k, 0], features[pixel, k, 1], features[pixel, k, 2])
            sample.normal = wp.vec3(features[pixel, k, 3], features[pixel, k, 4], features[pixel, k, 5])
            sample.depth = features[pixel, k, 6]
            if wp.static(batched):
                batch = add(batch, sample, weights)
                if (k + 1) % wp.static(BATCH) == 0:
                    moments = merge(moments, batch, weights)
                    batch = Moments()
            else:
                moments = add(moments, sample, weights)
        store(moments, pixel, out_planes, out_bits)

    planes = wp.zeros((len(NAMES), PIXELS), dtype=float, device="cpu")
    bits = wp.array(ptr=planes.ptr, shape=planes.shape, dtype=wp.uint32, device="cpu")
    given = [wp.array(radiance, dtype=wp.vec3, device="cpu"), wp.array(features, dtype=float, device="cpu")]
    hits = wp.array(hits, dtype=bool, device="cpu")
    wp.launch(film, PIXELS, inputs=[*given, hits, wp.vec3(*WEIGHTS)], outputs=[planes, bits], device="cpu")
    return dict(zip(NAMES, planes.numpy().astype(float), strict=True))


def of_the_mean(values, counts):
    """Return mean and variance of the mean of parts that stand for so many samples; the variance of one is unknown."""
    counts = np.asarray(counts, float)[:, None]
    mean = (values * counts).sum(axis=0) / counts.sum()
    spread = (counts * (values - mean) ** 2).sum(axis=0)
    return mean, spread / counts.sum() / (len(values) - 1) if len(values) > 1 else np.full_like(mean, np.nan)


@pytest.mark.parametrize("batched", [False, True])
def test_means_and_their_variances_are_those_of_the_samples(batched):
    """Of radiance over all samples, of features over those that hit; where samples are batched, of the batches."""
    rng = np.random.default_rng(4)
    radiance = rng.exponential(2.0, (PIXELS, SAMPLES, 3)).astype(np.float32)
    features = rng.normal(3.0, 1.0, (PIXELS, SAMPLES, 7)).astype(np.float32)
    hits = rng.random((PIXELS, SAMPLES)) < 0.6
    hits[0], hits[1], hits[2, 1:] = True, False, False
    hits[2, 0], hits[3, :BATCH] = True, False
    found = filmed(batched, radiance, features, hits)
    size = BATCH if batched else 1
    for pixel in range(PIXELS):
        parts = [(k, k + size) for k in range(0, SAMPLES, size)]
        everything = np.column_stack([radiance[pixel], radiance[pixel] @ WEIGHTS, hits[pixel]]).astype(float)
        mean, variance = of_the_mean(np.array([everything[a:b].mean(axis=0) for a, b in parts]), [size] * len(parts))
        wanted = dict(zip((*"RGB", "Luminance", "Coverage"), zip(mean, variance, strict=True), strict=True))
        hit = [features[pixel, a:b][hits[pixel, a:b]].astype(float) for a, b in parts if hits[pixel, a:b].any()]
        names = ("Albedo.R", "Albedo.G", "Albedo.B", "Nx", "Ny", "Nz", "Depth")
        mean, variance = np.zeros(7), np.full(7, np.nan)
        if hit:
            mean, variance = of_the_mean(np.array([each.mean(axis=0) for each in hit]), [len(each) for each in hit])
        wanted.update(zip(names, zip(mean, variance, strict=True), strict=True))
        for name, (mean, variance) in wanted.items():
            if name != "Luminance":
                assert found[name][pixel] == pytest.approx(mean, rel=1e-5, abs=1e-5), (name, pixel)
            assert found[f"Variance.{name}"][pixel] == pytest.approx(variance, rel=1e-3, abs=1e-7, nan_ok=True), name
        assert found["Samples"][pixel] == SAMPLES
