"""Coats in cached light: in white light from all around, what they reflect is known in closed form, or integrated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.scene import CheckerTexture, Material
from tests.render import hand_worlds as hw
from tests.render.primary.test_steered import LUMINANCE, Run

pytestmark = [pytest.mark.usefixtures("ordinary"), pytest.mark.slow]

EYE, WIDTH, HEIGHT, FOV_DEG = np.array([0.0, 2.0, 5.0]), 24, 18, 40.0
INDEX = 1.5
COAT_ALPHA = 0.3
DARK = 0.02
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


def plastic(cosine, colors, nonlinear):
    """Return what both colours of a smooth plastic send back of white light: the coat, and the base below."""
    inner, coat = inner_reflectance(), fresnel(cosine, INDEX)
    below = [c * (1 - inner) / (1 - inner * (c if nonlinear else 1.0)) for c in colors]
    return [coat + (1 - coat) * each for each in below]


def everywhere():
    """Return the directions of half a hemisphere, and what each stands for of all [sr], twice that."""
    theta, phi = np.meshgrid((np.arange(400) + 0.5) / 400 * np.pi / 2, (np.arange(400) + 0.5) / 400 * np.pi)
    to = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    return to, 2 * np.sin(theta) * (np.pi / 2 / 400) * (np.pi / 400)


def principled(cosine, colors, alpha):
    """The same of a rough dielectric of glTF, by quadrature over where light comes from (appendix B of glTF 2.0)."""
    angles = np.linspace(cosine.min(), cosine.max(), 9)
    to, solid = everywhere()

    def schlick(c):
        return 0.04 + 0.96 * (1 - c) ** 5

    def hidden(c):
        return (np.sqrt(1 + alpha**2 * (1 / c**2 - 1)) - 1) / 2

    reflected, entering = [], []
    for each in angles:
        out = np.array([np.sqrt(1 - each**2), 0, each])[:, None, None]
        half = (to + out) / np.linalg.norm(to + out, axis=0)
        facets = alpha**2 / (np.pi * ((alpha**2 - 1) * half[2] ** 2 + 1) ** 2)
        lobe = facets / (1 + hidden(each) + hidden(to[2])) / (4 * each)
        reflected.append(np.sum(lobe * schlick((half * out).sum(axis=0)) * solid))
        entering.append(np.sum((1 - schlick(np.minimum(each, to[2]))) * to[2] / np.pi * solid))
    return [np.interp(cosine, angles, reflected) + c * np.interp(cosine, angles, entering) for c in colors]


def disney(cosine, colors, alpha):
    """The same of Disney's model with half a sheen and a clear coat (Burley 2012 and 2015), by quadrature."""
    angles = np.linspace(cosine.min(), cosine.max(), 9)
    to, solid = everywhere()

    def grazing(c):
        return (1 - c) ** 5

    def seen(c, a):
        return 2 / (1 + np.sqrt(1 + a**2 * (1 / c**2 - 1)))

    reflected, base = [], []
    for each in angles:
        out = np.array([np.sqrt(1 - each**2), 0, each])[:, None, None]
        half = (to + out) / np.linalg.norm(to + out, axis=0)
        between = (half * out).sum(axis=0)
        facets = alpha**2 / (np.pi * ((alpha**2 - 1) * half[2] ** 2 + 1) ** 2)
        lobe = fresnel(between, INDEX) * facets * seen(each, alpha) * seen(to[2], alpha) / (4 * each)
        gloss = COAT_ALPHA**2
        coat = (gloss - 1) / (np.pi * np.log(gloss) * (1 + (gloss - 1) * half[2] ** 2))
        coat = 0.25 * coat * seen(each, 0.25) * seen(to[2], 0.25) * (0.04 + 0.96 * grazing(between)) * to[2]
        sheen = 0.5 * grazing(between) * to[2]
        reflected.append(np.sum((lobe + coat + sheen) * solid))
        retro = 2 * np.sqrt(alpha) * between**2
        i, o = grazing(to[2]), grazing(each)
        diffuse = (1 - i / 2) * (1 - o / 2) + retro * (i + o + i * o * (retro - 1))
        base.append(np.sum(diffuse * to[2] / np.pi * solid))
    return [np.interp(cosine, angles, reflected) + c * np.interp(cosine, angles, base) for c in colors]


def truth(colors, sent_back):
    """Return the radiance of each pixel, ``[3, H, W]``; ``sent_back(cosine, pair)`` tells that of both colours."""
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
    found = []
    for pair in np.transpose(colors):
        radiance = np.where(first, *sent_back(cosine, pair))
        found.append(radiance.reshape(HEIGHT, FINE, WIDTH, FINE).mean(axis=(1, 3)))
    return np.array(found)


@pytest.mark.parametrize(
    "kind", ["plastic", "nonlinear", "principled", "disney", "principled near a blend", "blend of plastic"]
)
def test_a_coat_over_a_checkerboard_in_white_light_is_the_closed_form(kind):
    """Squares of high contrast, larger than pixels and smaller. White comes back whole; Disney's adds some."""
    colors = (1.0, 0.9, 0.95), (0.05, 0.1, 0.95)
    board = CheckerTexture(*colors, scale=SCALE)
    if kind.startswith("principled"):
        coated = Material(kind="principled", color=(1.0, 1.0, 1.0), ior=1.5, alpha=0.5, texture=0)
    elif kind == "disney":
        coat = {"sheen": 0.5, "clearcoat": 1.0, "clearcoat_alpha": COAT_ALPHA}
        coated = Material(kind="disney", color=(1.0, 1.0, 1.0), ior=INDEX, alpha=0.5, texture=0, **coat)
    else:
        coated = Material(kind="plastic", color=(1.0, 1.0, 1.0), ior=INDEX, nonlinear=kind == "nonlinear", texture=0)
    floor = hw.quad((-SIDE_M / 2, 0, SIDE_M / 2), (SIDE_M, 0, 0), (0, 0, -SIDE_M))
    materials, meshes = (coated,), (floor,)
    # Which material of a blend a path meets is chance.
    blended = kind == "blend of plastic"
    if blended:
        materials = replace(coated, blend_with=1, blend_share=0.5), Material(color=(DARK,) * 3)
    elif "blend" in kind:
        materials = coated, Material(blend_with=2, blend_share=0.5), Material(kind="plastic")
        meshes = floor, hw.quad((-1, -1, 1), (2, 0, 0), (0, 0, -2), 1)
    view = hw.camera(hw.look_from(EYE, (0, 0, 0)), WIDTH, HEIGHT, FOV_DEG)
    world = hw.world(*meshes, materials=materials, textures=(board,), view=view, environment=(1.0, 1.0, 1.0))
    cached = Run(world, light_cache=True, spp=128 if blended else 16, probe_spp=4, first_hit_rays=32).fill(0).planes[:3]
    if kind.startswith("principled"):
        true = truth(colors, lambda cosine, pair: principled(cosine, pair, 0.5))
    elif kind == "disney":
        true = truth(colors, lambda cosine, pair: disney(cosine, pair, 0.5))
    else:
        true = truth(colors, lambda cosine, pair: plastic(cosine, pair, kind == "nonlinear"))
    if blended:
        true = (true + DARK) / 2
    assert 0.03 < true[0].min() < 0.5 < true[0].max() < (1.2 if kind == "disney" else 1.01)
    # Each channel in all, and each pixel but for the noise of the light.
    np.testing.assert_allclose(cached.mean(axis=(1, 2)), true.mean(axis=(1, 2)), rtol=0.004)
    relative = np.tensordot(LUMINANCE, cached, 1) / np.tensordot(LUMINANCE, true, 1)
    # Of a few pixels few rays tell how much of which colour they show; seen at a flat angle, cells are wide.
    far_off = {"plastic": 0.03, "nonlinear": 0.03, "blend of plastic": 0.12}.get(kind, 0.06)
    assert np.quantile(np.abs(relative - 1), 0.99) < far_off, relative
    assert np.abs(relative - 1).mean() < (0.02 if blended else 0.01), relative
