"""What a coat lets through, against the laws of Snell and Fresnel; no kernel runs here."""

import numpy as np
import pytest
from scipy.special import erf

from clsim.render.surfaces import plastic_tables
from clsim.render.surfaces.plastic_tables import STACK_SIZE, TABLE_SIZE, coat, coats


@pytest.mark.parametrize("ior", [1.1, 1.33, 1.5, 2.4])
def test_a_smooth_coat_lets_through_what_fresnel_says_at_each_angle(ior: float) -> None:
    """By angles: sin²(i − t) / sin²(i + t) is reflected of one polarisation, tan² / tan² of the other."""
    passing, _ = coat(0.0, ior)
    cosines = np.linspace(0.0, 1.0, TABLE_SIZE)
    i = np.arccos(cosines[1:-1])
    t = np.arcsin(np.sin(i) / ior)
    across, along = (np.sin(i - t) / np.sin(i + t)) ** 2, (np.tan(i - t) / np.tan(i + t)) ** 2
    np.testing.assert_allclose(passing[1:-1], 1.0 - (across + along) / 2, atol=1e-6)
    assert passing[0] == pytest.approx(0.0, abs=1e-4)
    assert passing[-1] == pytest.approx(1.0 - ((ior - 1) / (ior + 1)) ** 2)


@pytest.mark.parametrize("ior", [1.1, 1.33, 1.5, 2.4])
def test_as_much_diffuse_light_leaves_a_coat_as_enters_it(ior: float) -> None:
    """Radiance is ior² as large inside: (1 − inner) · ior² = 1 − outer, or a dark room would not stay even."""
    passing, inner = coat(0.0, ior)
    cosines = np.linspace(0.0, 1.0, TABLE_SIZE)
    each = 2.0 * cosines * passing
    entering = float((each[1:] + each[:-1]).mean() / 2)
    assert (1.0 - inner) * ior**2 == pytest.approx(entering, rel=0.005)


def shadowing(cosine: np.ndarray, alpha: float, distribution: str) -> np.ndarray:
    """Smith's for one direction: Walter et al., Microfacet Models for Refraction, EGSR 2007."""
    tangent = np.sqrt(1.0 - cosine**2) / cosine
    if distribution == "ggx":
        return np.asarray(2.0 / (1.0 + np.sqrt(1.0 + (alpha * tangent) ** 2)))
    a = 1.0 / np.maximum(alpha * tangent, 1e-9)
    return np.asarray(2.0 / (1.0 + erf(a) + np.exp(-(a**2)) / (a * np.sqrt(np.pi))))


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_a_rough_coat_lets_through_what_its_facets_do(distribution: str) -> None:
    """Summed over the slopes of all facets, as far as a direction sees them."""
    alpha, ior = 0.4, 1.5
    passing, _ = coat(alpha, ior, distribution)
    cos, phi = np.meshgrid((np.arange(400) + 0.5) / 400, (np.arange(200) + 0.5) * np.pi / 200)
    facet = np.stack([np.sqrt(1 - cos**2) * np.cos(phi), np.sqrt(1 - cos**2) * np.sin(phi), cos])
    tan2 = 1 / cos**2 - 1
    density = np.exp(-tan2 / alpha**2) if distribution == "beckmann" else 1 / (1 + tan2 / alpha**2) ** 2
    density /= np.pi * alpha**2 * cos**4
    for k in (12, 32, 60):
        mu = k / (TABLE_SIZE - 1)
        seen = np.maximum(facet[0] * np.sqrt(1 - mu**2) + facet[2] * mu, 0.0)
        bent = np.sqrt(1 - (1 - seen**2) / ior**2)
        across, along = (seen - ior * bent) / (seen + ior * bent), (ior * seen - bent) / (ior * seen + bent)
        down = mu / ior - (seen / ior - bent) * facet[2]
        through = (1 - (across**2 + along**2) / 2) * (down > 0)
        both = shadowing(np.array(mu), alpha, distribution) * shadowing(np.clip(down, 1e-6, 1), alpha, distribution)
        expected = (density * seen / mu * through * both).sum() * 2 * np.pi / 200 / 400
        assert passing[k] == pytest.approx(expected, rel=0.01)


def test_a_stack_of_coats_goes_in_even_steps_of_perceptual_roughness(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plastic_tables, "coat", lambda alpha, *_: (np.full(TABLE_SIZE, alpha), alpha))
    passing, inner = coats(0.25, 1.5)
    expected = (0.5 * np.arange(STACK_SIZE) / (STACK_SIZE - 1)) ** 2
    np.testing.assert_allclose(passing[:, 0], expected)
    np.testing.assert_allclose(inner, expected)
