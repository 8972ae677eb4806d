"""The errors of pixels are white noise: they know nothing of their neighbours', of other seeds' or other frames'.

Errors are against the same picture of far more paths, in units of each pixel's own standard error. A mean of their
products that is not 0 within its statistical error tells of random numbers that are used twice.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from clsim.scene import Material, SphereLight, Static
from tests.render import hand_worlds as hw

pytestmark = [pytest.mark.usefixtures("any_lights"), pytest.mark.slow]

SPP = 16
RENDERS = 12
LAGS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0), (1, 2), (3, 0), (0, 5))
LAMP = Material(color=(0.0, 0.0, 0.0), emission=(9.0, 8.0, 7.0))
SCENE = hw.world(
    hw.quad((-3, -0.6, 3), (6, 0, 0), (0, 0, -6)),
    hw.ball(0.6, rings=8),
    hw.quad((-0.7, 1.5, -0.7), (1.4, 0, 0), (0, 0, 1.4), material=1),
    materials=(hw.GREY, LAMP),
    view=hw.camera(hw.look_from((0.3, 1.3, 1.8), (0, -0.4, 0)), 32, 24, fov_deg=45),
    sphere_lights=(SphereLight(0.2, (6.0, 5.0, 4.0), Static(hw.translation(-1.2, 0.8, 0.6))),),
    environment=(0.2, 0.3, 0.4),
)


@pytest.fixture(scope="module")
def truth():
    return hw.render(SCENE, spp=16384, seed=1234567, threads=2).plane("G").astype(float)


@pytest.fixture(scope="module", params=["seeds", "frames", "sobol"])
def errors(request, truth):
    """Errors ``[renders, height, width]`` of unit variance; every sampler, seed and frame has its own noise."""
    options = {"sampler": "sobol"} if request.param == "sobol" else {}
    if request.param == "frames":
        frames = [hw.render(SCENE, index, spp=SPP, noise="independent") for index in range(RENDERS)]
    else:
        frames = [hw.render(SCENE, spp=SPP, seed=seed, **options) for seed in range(RENDERS)]
    differences = np.array([frame.plane("G") for frame in frames]) - truth
    # A pixel's own estimate of its variance goes with its error, which would weaken large ones: take that of all.
    scale = np.sqrt((differences**2).mean(axis=0))
    assert np.median(scale / truth) > 0.02
    return differences / scale


def z_score(products):
    """The mean of products in standard errors of the mean."""
    return products.mean() / (products.std() / np.sqrt(products.size))


@pytest.mark.parametrize("lag", LAGS, ids=str)
def test_neighbouring_pixels_err_independently(errors, lag):
    down, right = lag
    height, width = errors.shape[1:]
    here = errors[:, : height - down, max(0, -right) : width - max(0, right)]
    there = errors[:, down:, max(0, right) : width + min(0, right)]
    assert abs(z_score(here * there)) < 4
    assert abs((here * there).mean()) < 0.05


def test_a_pixel_errs_independently_in_every_render(errors):
    """Errors of the truth itself, common to all renders, are a thousandth of them."""
    products = np.concatenate([errors[i] * errors[j] for i, j in combinations(range(RENDERS), 2)])
    assert abs(z_score(products)) < 4
    assert abs(products.mean()) < 0.02
