"""Microfacets that are drawn, against quadrature of the density that they are drawn with."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from clsim.render.device.devices import start_warp
from clsim.render.surfaces.microfacet import sample_visible_beckmann, sample_visible_normal

SIDE = 256


@wp.kernel(enable_backward=False)
def draw(wo: wp.vec3, alpha: float, side: int, out_ggx: wp.array(dtype=wp.vec3), out_beckmann: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    u = wp.vec2((float(i % side) + 0.5) / float(side), (float(i // side) + 0.5) / float(side))
    out_ggx[i] = sample_visible_normal(wo, alpha, u)
    out_beckmann[i] = sample_visible_beckmann(wo, alpha, u)


def moments(normals, weights):
    """Return the means of the components and of their products, over the weights."""
    products = [normals[..., a] * normals[..., b] for a, b in ((0, 0), (1, 1), (0, 1), (0, 2))]
    return np.array([np.average(each, weights=weights) for each in (*np.moveaxis(normals, -1, 0), *products)])


@pytest.mark.parametrize("theta", [0.0, 0.6, 1.2, 1.5])
@pytest.mark.parametrize("alpha", [0.1, 0.4, 1.0])
def test_visible_microfacets_have_their_moments(theta, alpha):
    """Their density is D·max(wo·h, 0), but for a factor: Walter et al., EGSR 2007, for both D."""
    start_warp()
    wo = np.array([np.sin(theta) * np.cos(0.7), np.sin(theta) * np.sin(0.7), np.cos(theta)])
    drawn = [wp.empty(SIDE**2, dtype=wp.vec3, device="cpu") for _ in range(2)]
    wp.launch(draw, SIDE**2, inputs=[wp.vec3(*wo), alpha, SIDE], outputs=drawn, device="cpu")
    # In slopes tan θ / α. Those steeper have the share (1 − q)² of D·cos θ dω, by which weights stay finite.
    q, phi = np.meshgrid((np.arange(2000) + 0.5) / 2000, (np.arange(400) + 0.5) / 400 * 2 * np.pi)
    slopes = np.sqrt(1 - (1 - q) ** 2) / (1 - q), np.sqrt(-2 * np.log1p(-q))
    for normals, slope in zip(drawn, slopes, strict=True):
        cos = 1 / np.sqrt(1 + (alpha * slope) ** 2)
        sin = alpha * slope * cos
        h = np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], axis=-1)
        wanted = moments(h, np.maximum(h @ wo, 0) / cos * (1 - q))
        found = normals.numpy().astype(float)
        np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-5)
        np.testing.assert_allclose(moments(found, None), wanted, atol=1e-3)
