"""Scattering models by themselves: energy, reciprocity, densities and the numbers of the literature."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from clsim.scene import Material
from tests.render.bsdf.hand_bsdf import Lone, from_angles

WHITE = (1.0, 1.0, 1.0)
GOLD = {"eta": (0.143, 0.375, 1.442), "k": (3.983, 2.386, 1.603)}

ROUGH = {
    "diffuse": Material(color=(0.8, 0.5, 0.2)),
    "conductor .3": Material(kind="conductor", color=(0.9, 0.6, 0.3), alpha=0.3),
    "conductor .05": Material(kind="conductor", color=(0.9, 0.6, 0.3), alpha=0.05),
    "conductor gold": Material(kind="conductor", alpha=0.2, **GOLD),
    "dielectric .4": Material(kind="dielectric", color=WHITE, alpha=0.4),
    "dielectric .15": Material(kind="dielectric", color=(0.9, 0.8, 0.7), alpha=0.15, ior=1.8),
    "conductor beckmann": Material(kind="conductor", color=(0.9, 0.6, 0.3), alpha=0.3, distribution="beckmann"),
    "dielectric beckmann": Material(kind="dielectric", color=WHITE, alpha=0.4, distribution="beckmann"),
    "plastic smooth": Material(kind="plastic", color=(0.8, 0.5, 0.2)),
    "plastic .2": Material(kind="plastic", color=(0.8, 0.5, 0.2), alpha=0.2, nonlinear=True),
    "principled": Material(kind="principled", color=(0.8, 0.5, 0.2), alpha=0.25),
    "principled metal": Material(kind="principled", color=(0.8, 0.5, 0.2), alpha=0.1, metallic=0.7),
    "principled coat": Material(
        kind="principled", color=(0.8, 0.5, 0.2), alpha=0.5, clearcoat=0.8, clearcoat_alpha=0.04, metallic=0.3
    ),
    "principled pane": Material(kind="principled", color=(0.8, 0.5, 0.2), alpha=0.2, transmission=0.6),
    "disney": Material(
        kind="disney",
        color=(0.8, 0.5, 0.2),
        alpha=0.2,
        stretch=1.6,
        metallic=0.3,
        transmission=0.5,
        specular_tint=0.4,
        sheen=0.8,
        sheen_tint=0.5,
        flatness=0.3,
        clearcoat=0.7,
        clearcoat_alpha=0.1,
    ),
}
SLOW = ("conductor beckmann", "dielectric beckmann", "disney")
ROWS = [pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else []) for name in ROUGH]
NARROW = ("conductor .05", "principled coat", "principled metal")
MIRRORS = {
    "conductor": Material(kind="conductor", color=(0.9, 0.6, 0.3)),
    "dielectric": Material(kind="dielectric", color=WHITE),
    "thin-dielectric": Material(kind="thin-dielectric", color=WHITE),
    "principled metal": Material(kind="principled", color=(0.9, 0.6, 0.3), metallic=1.0, clearcoat=1.0),
    "principled pane": Material(kind="principled", color=WHITE, transmission=1.0),
}
ANGLES = (0.0, 0.6, 1.2, 1.5)


leggauss = cache(np.polynomial.legendre.leggauss)
"""Places and weights, which take longer to find than what is integrated with them."""


@cache
def grid(low=-1.0, cosines=256, azimuths=256):
    """Directions and solid angles of a Gauss–Legendre grid in the cosine, finer towards the horizon, by azimuth."""
    x, w = leggauss(cosines)
    parts = [(0.0, 1.0)] if low == 0 else [(-1.0, 0.0), (0.0, 1.0)]
    z = np.concatenate([a + (b - a) * (x + 1) / 2 for a, b in parts])
    wz = np.concatenate([w * (b - a) / 2 for a, b in parts])
    phi = (np.arange(azimuths) + 0.5) * 2 * np.pi / azimuths
    directions = from_angles(np.arccos(z)[:, None], phi)
    return directions, np.broadcast_to(wz[:, None] * 2 * np.pi / azimuths, directions.shape[:2])


def smooth_share(lone, wo, front=True):
    """Share of the samples that mirrors take."""
    return lone.draw(wo, 20000, front)[3].mean()


@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize("name", ROWS)
def test_densities_integrate_to_the_share_of_samples_that_exist(name, front):
    lone = Lone(ROUGH[name])
    directions, solid = grid()
    for theta in ANGLES[:3]:
        wo = from_angles(theta)
        _, _, pdf, delta = lone.draw(wo, 1 << 17, front)
        drawn = ((pdf > 0) & ~delta).mean()
        total = (lone.evaluate(wo, directions, front)[1] * solid).sum()
        assert total == pytest.approx(drawn, abs=0.006), theta
        assert total > 0.02


@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize("name", ROWS)
def test_samples_are_distributed_as_their_density_says(name, front):
    """A chi² test over cells of cosine and azimuth, with the expected counts integrated within each cell."""
    lone = Lone(ROUGH[name])
    count, rows, columns = 1 << 16, 24, 12
    fine = 64 if name in NARROW else 12
    for theta in (0.3, 1.1):
        wo = from_angles(theta, 0.4)
        direction, _, pdf, delta = lone.draw(wo, count, front, seed=int(theta * 10))
        kept = direction[(pdf > 0) & ~delta]
        cell_z = np.clip(((kept[:, 2] + 1) / 2 * rows).astype(int), 0, rows - 1)
        cell_phi = ((np.arctan2(kept[:, 1], kept[:, 0]) / (2 * np.pi)) % 1.0 * columns).astype(int) % columns
        observed = np.bincount(cell_z * columns + cell_phi, minlength=rows * columns)
        x, w = leggauss(fine)
        z = ((np.arange(rows)[:, None] + (x + 1) / 2) * 2 / rows - 1).ravel()
        phi = ((np.arange(columns)[:, None] + (x + 1) / 2) * 2 * np.pi / columns).ravel()
        density = lone.evaluate(wo, from_angles(np.arccos(z)[:, None], phi), front)[1]
        weights = np.outer(np.tile(w, rows), np.tile(w, columns)) * (np.pi / (rows * columns))
        expected = (density * weights).reshape(rows, fine, columns, fine).sum(axis=(1, 3)).ravel() * count
        # Cells with little expected are one; what was not drawn at all is another.
        many = expected > 8
        o = np.append(observed[many], [observed[~many].sum(), count - len(kept)])
        e = np.append(expected[many], [expected[~many].sum(), count - expected.sum()])
        used = e > 1
        # Integrals within cells are good to a per cent: their error counts as variance.
        chi2 = ((o - e)[used] ** 2 / (e + (0.012 * e) ** 2)[used]).sum()
        assert stats.chi2.sf(chi2, used.sum() - 1) > 1e-4, (theta, chi2, used.sum())


@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize("name", ROWS)
def test_the_weight_of_a_sample_is_value_over_density(name, front):
    lone = Lone(ROUGH[name])
    for theta in ANGLES:
        wo = from_angles(theta, 2.0)
        direction, weight, pdf, delta = lone.draw(wo, 4096, front)
        kept = (pdf > 1e-3) & ~delta & (np.abs(direction[:, 2]) > 1e-3)
        value, density = lone.evaluate(wo, direction[kept], front)
        np.testing.assert_allclose(density, pdf[kept], rtol=2e-2)
        np.testing.assert_allclose(weight[kept] * density[:, None], value, rtol=2e-2, atol=1e-5)
        assert np.median(np.abs(density / pdf[kept] - 1)) < 1e-4
        np.testing.assert_allclose(np.linalg.norm(direction[kept], axis=1), 1.0, rtol=1e-5)


@pytest.mark.parametrize("name", ROWS)
def test_reflection_is_reciprocal(name):
    """f(wo, wi) = f(wi, wo); across an interface f / η² is (Veach 1997, eq. 5.14)."""
    rng = np.random.default_rng(3)
    lone = Lone(ROUGH[name])
    a, b = (from_angles(np.arccos(rng.uniform(0.05, 1, 500)), rng.uniform(0, 6.28, 500)) for _ in range(2))
    there = lone.evaluate(a, b)[0] / b[:, 2:]
    back = lone.evaluate(b, a)[0] / a[:, 2:]
    np.testing.assert_allclose(there, back, rtol=2e-3, atol=1e-6)
    below = b * (1, 1, -1)
    there = lone.evaluate(a, below)[0] / b[:, 2:]
    # Seen from the other side, the frame is turned over.
    back = lone.evaluate(below * (1, 1, -1), a * (1, 1, -1), front=False)[0] / a[:, 2:]
    eta2 = ROUGH[name].ior ** 2 if ROUGH[name].kind in ("dielectric", "disney") else 1.0
    np.testing.assert_allclose(there * eta2, back, rtol=5e-3, atol=1e-5)
    assert (there > 0).any() == (ROUGH[name].kind == "dielectric" or ROUGH[name].transmission > 0)


def furnace(lone, wo, front=True, count=1 << 17):
    """What a point returns of light from everywhere, and its standard error; η² undone by the caller."""
    direction, weight, _, _ = lone.draw(wo, count, front)
    return direction, weight


WHITES = {name: replace(material, color=WHITE, specular_color=WHITE) for name, material in (ROUGH | MIRRORS).items()}


@pytest.mark.parametrize("alpha", [0.0, 0.02, 0.3, 1.0])
@pytest.mark.parametrize("kind", ["diffuse", "conductor", "dielectric", "thin-dielectric", "plastic", "principled"])
def test_energy_is_never_gained(kind, alpha):
    """The whitest material of each kind, with every lobe that it can have."""
    variants = [Material(kind=kind, color=WHITE, alpha=alpha)]
    if kind == "plastic":
        variants.append(replace(variants[0], nonlinear=True))
    if kind == "principled":
        coat = {"clearcoat": 1.0, "clearcoat_alpha": 0.3}
        variants += [replace(variants[0], **extra) for extra in (coat, {"metallic": 0.5}, {"transmission": 1.0})]
        variants += [replace(variants[0], clearcoat=1.0, metallic=1.0), replace(variants[0], transmission=0.5, **coat)]
    for material in variants:
        lone = Lone(material)
        for front in (True, False):
            for theta in ANGLES:
                direction, weight = furnace(lone, from_angles(theta), front, 1 << 15)
                eta = material.ior if front else 1 / material.ior
                scale = np.where((kind == "dielectric") & (direction[:, 2] < 0), eta**2, 1.0)
                energy = weight.mean(axis=1) * scale
                error = energy.std() / np.sqrt(len(energy))
                assert energy.mean() < 1 + 4 * error + 2e-5, (material, front, theta)


@pytest.mark.parametrize("ior", [1.2, 1.5, 2.5])
def test_a_black_dielectric_returns_the_fresnel_reflection_of_gltf(ior):
    """Head-on f·cos = F0·D/4, with D = 1/(π·α²) and F0 = min(((n − 1)/(n + 1))²·specular color, 1) of each channel."""
    specular = (0.5, 2.0, 20.0)
    black = Lone(Material(kind="principled", color=(0, 0, 0), alpha=0.25, ior=ior, specular_color=specular))
    value, _ = black.evaluate((0, 0, 1), (0, 0, 1))
    wanted = np.minimum(((ior - 1) / (ior + 1)) ** 2 * np.array(specular), 1) / (4 * np.pi * 0.25**2)
    np.testing.assert_allclose(value, wanted, rtol=1e-4)


@pytest.mark.parametrize("kind", ["dielectric", "thin-dielectric", "conductor"])
def test_lossless_mirrors_lose_nothing(kind):
    lone = Lone(Material(kind=kind, color=WHITE))
    for front in (True, False):
        for theta in ANGLES:
            direction, weight, _, delta = lone.draw(from_angles(theta), 1 << 14, front)
            eta = 1.0 if kind != "dielectric" else 1.5 if front else 1 / 1.5
            assert delta.all()
            energy = weight[:, 0] * np.where(direction[:, 2] < 0, eta**2, 1.0)
            np.testing.assert_allclose(energy, 1.0, rtol=1e-5)


def exact_ggx_albedo(alpha, theta, correlated, fresnel=lambda c: 1.0):
    """∫ D·G·F / (4 cos) over the reflecting hemisphere, in float64 over the visible microfacets."""
    n = 200  # 400 would change the result by 5e-5 at most
    x, w = leggauss(n)
    z, wz = (x + 1) / 2, w / 2
    phi = (np.arange(2 * n) + 0.5) * np.pi / n
    # Half vectors by tan θ = α·tan(t), which spreads the lobe over the grid.
    t, wt = z * np.pi / 2, wz * np.pi / 2
    tan = alpha * np.tan(t)
    cos = 1 / np.sqrt(1 + tan**2)
    h = np.stack(
        [(tan * cos)[:, None] * np.cos(phi), (tan * cos)[:, None] * np.sin(phi), np.repeat(cos[:, None], 2 * n, 1)], -1
    )
    # dω = sin θ dθ dφ with dθ = cos²θ · α / cos²t dt
    solid = (tan * cos * cos**2 * alpha / np.cos(t) ** 2 * wt)[:, None] * (np.pi / n)
    d = 1 / (np.pi * alpha**2 * cos**4 * (1 + tan**2 / alpha**2) ** 2)
    wo = from_angles(theta)
    dot = h @ wo
    wi = 2 * dot[..., None] * h - wo
    valid = (wi[..., 2] > 0) & (dot > 0)
    lam = lambda c: (np.sqrt(1 + alpha**2 * (1 - c**2) / c**2) - 1) / 2  # noqa: E731
    ci = np.where(valid, np.clip(wi[..., 2], 1e-9, 1.0), 1.0)
    g = 1 / (1 + lam(wo[2]) + lam(ci)) if correlated else 1 / ((1 + lam(wo[2])) * (1 + lam(ci)))
    # dωi = 4 (wo·h) dωh
    return np.where(valid, d[:, None] * g * fresnel(dot) * dot / wo[2] * solid, 0.0).sum()


def test_disneys_white_glass_is_glass():
    """Also where the surface as a whole would reflect all and some of its microfacets do not."""
    glass = Material(kind="dielectric", color=WHITE, alpha=0.4)
    # Stretched by next to nothing, so that it shares the kernel of the other tests.
    both = Lone(replace(glass, kind="disney", transmission=1.0, stretch=1.0001)), Lone(glass)
    for front in (True, False):
        for theta in ANGLES:
            means = [lone.draw(from_angles(theta), 1 << 16, front)[1][:, 0] for lone in both]
            error = np.sqrt(sum(weight.var() for weight in means) / (1 << 16))
            assert abs(means[0].mean() - means[1].mean()) < 4 * error + 1e-4, (front, theta)


def test_metal_brushed_along_u_is_metal_brushed_along_v_turned_round():
    along, across = (Lone(Material(kind="conductor", color=WHITE, alpha=0.3, stretch=k)) for k in (2.0, 0.5))
    wo, wi = from_angles(0.7, 0.3), from_angles(np.array([0.2, 0.9, 1.1]), np.array([1.0, 4.0, 2.0]))
    turned = [np.stack([-w[..., 1], w[..., 0], w[..., 2]], axis=-1) for w in (wo, wi)]
    (value, density), (other, other_density) = along.evaluate(wo, wi), across.evaluate(*turned)
    np.testing.assert_allclose(other, value, rtol=1e-4)
    np.testing.assert_allclose(other_density, density, rtol=1e-4)
    assert (abs(across.evaluate(wo, wi)[0] / value - 1) > 0.05).all()


@pytest.mark.parametrize("alpha", [0.05, 0.3, 0.8])
@pytest.mark.parametrize("kind", ["conductor", "principled"])
def test_white_metal_loses_what_single_scattering_loses(kind, alpha):
    lone = Lone(Material(kind=kind, color=WHITE, alpha=alpha, metallic=1.0))
    for theta in (0.0, 0.8, 1.3):
        _, weight = furnace(lone, from_angles(theta), count=1 << 17)
        error = weight[:, 0].std() / np.sqrt(len(weight))
        exact = exact_ggx_albedo(alpha, theta, correlated=kind == "principled")
        assert abs(weight[:, 0].mean() - exact) < 4 * error + 2e-4, (theta, exact)
    assert exact < 0.999


def test_fresnel_at_normal_incidence_and_total_reflection():
    """R = ((n − 1) / (n + 1))² and |(η − 1 + ik) / (η + 1 + ik)|²; beyond the critical angle everything returns."""
    glass = Lone(Material(kind="dielectric", color=WHITE, ior=1.5))
    direction, _, _, _ = glass.draw(from_angles(0.0), 1 << 17)
    assert (direction[:, 2] > 0).mean() == pytest.approx(0.04, abs=0.002)
    direction, _, _, _ = glass.draw(from_angles(np.arcsin(1 / 1.5) + 1e-3), 1000, front=False)
    assert (direction[:, 2] > 0).all()
    gold = Lone(Material(kind="conductor", **GOLD))
    index = np.array(GOLD["eta"]) + 1j * np.array(GOLD["k"])
    _, weight, _, _ = gold.draw(from_angles(0.0), 1)
    np.testing.assert_allclose(weight[0], np.abs((index - 1) / (index + 1)) ** 2, rtol=1e-5)


def test_fresnel_of_a_metal_under_an_angle():
    """The complex Fresnel equations themselves, in complex128."""
    index = np.array(GOLD["eta"]) + 1j * np.array(GOLD["k"])
    gold = Lone(Material(kind="conductor", **GOLD))
    for theta in ANGLES:
        c = np.cos(theta)
        root = np.sqrt(index**2 - np.sin(theta) ** 2)
        s, p = (c - root) / (c + root), (index**2 * c - root) / (index**2 * c + root)
        _, weight, _, _ = gold.draw(from_angles(theta), 1)
        np.testing.assert_allclose(weight[0], (np.abs(s) ** 2 + np.abs(p) ** 2) / 2, rtol=1e-4)


def test_snell_and_the_pane():
    glass = Lone(Material(kind="dielectric", color=WHITE, ior=1.5))
    direction, weight, _, _ = glass.draw(from_angles(0.7), 2000)
    through = direction[direction[:, 2] < 0]
    np.testing.assert_allclose(np.hypot(through[:, 0], through[:, 1]), np.sin(0.7) / 1.5, rtol=1e-5)
    np.testing.assert_allclose(weight[direction[:, 2] < 0], 1 / 1.5**2, rtol=1e-5)
    pane = Lone(Material(kind="thin-dielectric", color=WHITE, ior=1.5))
    direction, _, _, _ = pane.draw(from_angles(0.0), 1 << 17)
    assert (direction[:, 2] > 0).mean() == pytest.approx(0.08 / 1.04, abs=0.003)
    inside = np.arcsin(np.sin(1.2) / 1.5)
    once = (np.sin(1.2 - inside) / np.sin(1.2 + inside)) ** 2 / 2 + (
        np.tan(1.2 - inside) / np.tan(1.2 + inside)
    ) ** 2 / 2
    for front in (True, False):
        direction, _, _, _ = pane.draw(from_angles(1.2), 1 << 17, front)
        assert (direction[:, 2] > 0).mean() == pytest.approx(2 * once / (1 + once), abs=0.005)
    wo = from_angles(0.9)
    direction, _, _, _ = pane.draw(wo, 500)
    through = direction[direction[:, 2] < 0]
    np.testing.assert_allclose(through, np.broadcast_to(-wo, through.shape), atol=1e-6)


@pytest.mark.parametrize("name", ["conductor", "dielectric", "plastic", "principled"])
def test_narrow_lobes_tend_to_mirrors(name):
    """The energy and mean direction of α = 0.002 are those of the perfect mirror."""
    base = {
        "conductor": Material(kind="conductor", color=(0.9, 0.6, 0.3)),
        "dielectric": Material(kind="dielectric", color=WHITE),
        "plastic": Material(kind="plastic", color=(0.3, 0.2, 0.1)),
        "principled": Material(kind="principled", color=(0.3, 0.2, 0.1), metallic=0.5),
    }[name]
    for theta in (0.2, 1.0):
        wo = from_angles(theta)
        results = []
        for alpha in (0.0, 0.002):
            direction, weight, _, _ = Lone(replace(base, alpha=alpha)).draw(wo, 1 << 15)
            results.append((weight.mean(axis=0), (direction * weight[:, :1]).mean(axis=0)))
            error = np.sqrt(weight.var(axis=0).max() + 1) / np.sqrt(1 << 15)
        np.testing.assert_allclose(results[0][0], results[1][0], atol=5 * error)
        np.testing.assert_allclose(results[0][1], results[1][1], atol=5 * error)


@pytest.mark.parametrize("name", ROWS)
def test_values_stay_finite_at_the_edges(name):
    """Grazing directions, straight down, the mirror direction of the narrowest lobe."""
    edge = np.array([from_angles(t) for t in (0.0, 1e-4, 1.2, np.pi / 2 - 1e-6)])
    lone = Lone(replace(ROUGH[name], alpha=0.001))
    for wo in edge:
        for wi in np.concatenate([edge, edge * (-1, 1, 1), edge * (-1, 1, -1), edge * (1, 1, -1)]):
            value, pdf = lone.evaluate(wo, wi)
            assert np.isfinite(value).all() and np.isfinite(pdf) and (value >= 0).all() and pdf >= 0
        direction, weight, pdf, _ = lone.draw(wo, 256)
        assert np.isfinite(direction).all() and np.isfinite(weight).all() and np.isfinite(pdf).all()
        assert (weight >= 0).all()


@pytest.mark.parametrize("name", ["conductor .3", "conductor gold", "dielectric .15", "plastic .2"])
def test_a_specular_colour_multiplies_what_is_reflected_and_nothing_else(name):
    tint = np.array((0.9, 0.5, 0.1))
    plain, tinted, none = (
        Lone(replace(ROUGH[name], specular_color=tuple(colour))) for colour in (WHITE, tint.tolist(), (0.0, 0.0, 0.0))
    )
    wo, wi = from_angles(0.5), from_angles(np.linspace(0.1, 3.0, 40), np.linspace(2.5, 3.8, 40))
    whole, coloured, rest = (each.evaluate(wo, wi)[0] for each in (plain, tinted, none))
    np.testing.assert_allclose(coloured, rest + tint * (whole - rest), rtol=1e-5, atol=1e-7)
    reflects, passes = whole[wi[:, 2] > 0] - rest[wi[:, 2] > 0], whole[wi[:, 2] < 0] - rest[wi[:, 2] < 0]
    assert reflects.max() > 0.02 and not passes.any()


@pytest.mark.parametrize("name", ["conductor", "dielectric", "thin-dielectric"])
def test_a_specular_colour_multiplies_what_mirrors_reflect_and_nothing_else(name):
    tint = np.array((0.9, 0.5, 0.1))
    plain, tinted = (Lone(replace(MIRRORS[name], specular_color=tuple(c))) for c in (WHITE, tint.tolist()))
    wo = from_angles(1.2)
    direction, weight, *_ = plain.draw(wo, 1000)
    also, coloured, *_ = tinted.draw(wo, 1000)
    np.testing.assert_array_equal(also, direction)
    np.testing.assert_allclose(coloured, weight * np.where(direction[:, 2:] > 0, tint, 1.0), rtol=1e-5)
    assert (direction[:, 2] > 0).any()
