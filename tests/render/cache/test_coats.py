"""Coats of plastics in cached light: in white light from all around, what they reflect is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.scene import CheckerTexture, Material
from tests.render import hand_worlds as hw
from tests.render.primary.test_steered import LUMINANCE, Run

pytestmark = [pytest.mark.usefixtures("ordinary"), pytest.mark.slow]

EYE, WIDTH, HEIGHT, FOV_DEG = np.array([0.0, 2.0, 5.0]), 24, 18, 40.0
INDEX = 1.5
SCALE, SIDE_M = 40.0, 60.0
FINE = 48
"""Places in a row and in a column of a pixel, for the truth."""


def fresnel(cosine, eta):
    """Return what a smooth surface reflects of unpolarized light; ``eta`` is the index behind over that before it."""
    inside = np.sqrt(np.maximum(1 - (1 - cosine**2) / eta**2, 0))
    across = (cosine - eta * inside) / (cosine + eta * inside)
    along = (eta * cosine - inside) / (eta * cosine + inside)
    return np.where(inside > 0, 0.5 * (across**2 + along**2), 1.0)


def inner_reflectance():
    """Return the share of diffuse light from inside that the coat sends back."""
    cosine = (np.arange(200_000) + 0.5) / 200_000
    return float(np.mean(2 * cosine * fresnel(cosine, 1 / INDEX)))


def truth(colors, nonlinear):
    """Return the radiance of each pixel, ``[3, H, W]``: the coat's mirror image of white, and the base below."""
    x = (np.arange(WIDTH * FINE) + 0.5) / (WIDTH * FINE) * 2 - 1
    y = (1 - (np.arange(HEIGHT * FINE) + 0.5) / (HEIGHT * FINE) * 2) * HEIGHT / WIDTH
    half = np.tan(np.radians(FOV_DEG / 2))
    backward = EYE / np.linalg.norm(EYE)
    upward = np.cross(backward, [1.0, 0, 0])
    ways = half * (x[None, :, None] * np.array([1.0, 0, 0]) + y[:, None, None] * upward) - backward
    hits = EYE - ways * (EYE[1] / ways[..., 1:2])
    cosine = -ways[..., 1] / np.linalg.norm(ways, axis=2)
    u, v = (hits[..., 0] + SIDE_M / 2) / SIDE_M, (SIDE_M / 2 - hits[..., 2]) / SIDE_M
    first = (np.floor(u * SCALE) + np.floor(v * SCALE)) % 2 == 0
    inner = inner_reflectance()
    coat = fresnel(cosine, INDEX)
    found = []
    for pair in np.transpose(colors):
        base = np.array([c * (1 - inner) / (1 - inner * (c if nonlinear else 1.0)) for c in pair])
        radiance = coat + (1 - coat) * np.where(first, *base)
        found.append(radiance.reshape(HEIGHT, FINE, WIDTH, FINE).mean(axis=(1, 3)))
    return np.array(found)


@pytest.mark.parametrize("nonlinear", [False, True])
def test_a_coat_over_a_checkerboard_in_white_light_is_the_closed_form(nonlinear):
    """Squares of high contrast, larger than pixels and smaller. All that is white comes back whole."""
    colors = (1.0, 0.9, 0.95), (0.05, 0.1, 0.95)
    board = CheckerTexture(*colors, scale=SCALE)
    coated = Material(kind="plastic", color=(1.0, 1.0, 1.0), ior=INDEX, nonlinear=nonlinear, texture=0)
    floor = hw.quad((-SIDE_M / 2, 0, SIDE_M / 2), (SIDE_M, 0, 0), (0, 0, -SIDE_M))
    view = hw.camera(hw.look_from(EYE, (0, 0, 0)), WIDTH, HEIGHT, FOV_DEG)
    world = hw.world(floor, materials=(coated,), textures=(board,), view=view, environment=(1.0, 1.0, 1.0))
    cached = Run(world, light_cache=True, spp=16, probe_spp=4, first_hit_rays=32).fill(0).planes[:3]
    true = truth(colors, nonlinear)
    assert 0.05 < true[0].min() < 0.5 < true[0].max() < 1.01
    # Each channel in all, and each pixel but for the noise of the light.
    np.testing.assert_allclose(cached.mean(axis=(1, 2)), true.mean(axis=(1, 2)), rtol=0.004)
    relative = np.tensordot(LUMINANCE, cached, 1) / np.tensordot(LUMINANCE, true, 1)
    assert np.abs(relative - 1).max() < 0.04 and np.abs(relative - 1).mean() < 0.01, relative
