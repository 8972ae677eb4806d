"""What a rough dielectric coat lets through and reflects inwards, integrated on the host."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from clsim.scene.world import Distribution

F64 = npt.NDArray[np.float64]
TABLE_SIZE = 64
"""Entries of a table, at equal steps of the cosine from 0 to 1; the kernel interpolates linearly."""
STACK_SIZE = 16
"""Tables of a coat whose roughness is textured, at equal steps of perceptual roughness; the kernel interpolates."""
_SMOOTH = 1e-3


@lru_cache(maxsize=256)
def coat(alpha: float, ior: float, distribution: Distribution = "ggx") -> tuple[F64, float]:
    """Return the transmittance from outside [TABLE_SIZE] and the mean reflectance of diffuse light from inside.

    Args:
        alpha: roughness; smooth below 0.001.
        ior: index of the coat over that around it.
        distribution: of its microfacets.
    """
    cosines = np.maximum(np.linspace(0.0, 1.0, TABLE_SIZE), 1e-6)
    passing = _directional(cosines, alpha, ior, distribution, through=True)
    if alpha >= _SMOOTH:
        # 2·∫ R(μ)·μ dμ as Mitsuba sums it, so that its scenes keep their colours: 1/64 too low.
        return passing, float(
            2.0 * np.mean(cosines * _directional(cosines, alpha, 1.0 / ior, distribution, through=False))
        )
    # The reflectance from inside has a kink where total reflection begins.
    nodes, weights = np.polynomial.legendre.leggauss(96)
    critical = np.sqrt(max(1.0 - 1.0 / ior**2, 0.0)) if ior > 1 else 0.5
    inner = 0.0
    for low, high in ((0.0, critical), (critical, 1.0)):
        mu = low + (high - low) * 0.5 * (nodes + 1.0)
        back = _directional(mu, alpha, 1.0 / ior, distribution, through=False)
        inner += float(np.sum(weights * 0.5 * (high - low) * 2.0 * mu * back))
    return passing, inner


def coats(alpha: float, ior: float, distribution: Distribution = "ggx") -> tuple[F64, F64]:
    """Return ``coat`` [STACK_SIZE, TABLE_SIZE] and [STACK_SIZE] for √α from 0 to that of ``alpha``."""
    roughness = np.sqrt(alpha) * np.linspace(0.0, 1.0, STACK_SIZE)
    found = [coat(float(r * r), ior, distribution) for r in roughness]
    return np.array([passing for passing, _ in found]), np.array([inner for _, inner in found])


def _directional(mu: F64, alpha: float, eta: float, distribution: Distribution, *, through: bool) -> F64:
    """Return the share that is refracted (or reflected) of light from each cosine, over the visible microfacets."""
    if alpha < _SMOOTH:
        reflectance, _ = _fresnel(mu, eta)
        return 1.0 - reflectance if through else reflectance
    count = 48 if eta > 1 else 96
    x, w = np.polynomial.legendre.leggauss(count)
    u0, u1 = (a.ravel() for a in np.meshgrid(0.5 * (x + 1.0), 0.5 * (x + 1.0)))
    weight = np.outer(w, w).ravel() * 0.25
    result = np.empty_like(mu)
    for i, cosine in enumerate(mu):
        wo = np.array([np.sqrt(1.0 - cosine**2), 0.0, cosine])
        h = _visible_normals(wo, alpha, u0, u1)
        out_h = h @ wo
        reflectance, cos_t = _fresnel(out_h, eta)
        if through:
            wi_z = (out_h / eta - cos_t) * h[:, 2] - wo[2] / eta
            share = np.where(wi_z < 0, 1.0 - reflectance, 0.0)
        else:
            wi_z = 2.0 * out_h * h[:, 2] - wo[2]
            share = np.where(wi_z > 0, reflectance, 0.0)
        shadowing = _ggx_g1(wi_z, alpha)
        if distribution == "beckmann":
            # The normals drawn are GGX's.
            tan2 = (1.0 - h[:, 2] ** 2) / (alpha * h[:, 2]) ** 2
            shadowing = np.exp(-tan2) * (1.0 + tan2) ** 2 * _beckmann_g1(wi_z, alpha)
            shadowing *= _beckmann_g1(cosine, alpha) / _ggx_g1(cosine, alpha)
        result[i] = np.sum(weight * share * shadowing)
    return result


def _tan2(cosine: npt.ArrayLike) -> F64:
    c2 = np.square(np.asarray(cosine, np.float64))
    return np.asarray(np.maximum(1.0 - c2, 0.0) / np.maximum(c2, 1e-12))


def _ggx_g1(cosine: npt.ArrayLike, alpha: float) -> F64:
    """``microfacet.smith_g1`` for many cosines."""
    return np.asarray(2.0 / (1.0 + np.sqrt(1.0 + alpha**2 * _tan2(cosine))))


def _beckmann_g1(cosine: npt.ArrayLike, alpha: float) -> F64:
    """``microfacet.beckmann_g1`` for many cosines."""
    a = 1.0 / np.sqrt(np.maximum(alpha**2 * _tan2(cosine), 1e-20))
    rough = np.minimum(a, 1.6)
    fit = (3.535 * rough + 2.181 * rough**2) / (1.0 + 2.276 * rough + 2.577 * rough**2)
    return np.where(a < 1.6, fit, 1.0)


def _visible_normals(wo: F64, alpha: float, u0: F64, u1: F64) -> F64:
    """``microfacet.sample_visible_normal`` for many pairs of numbers."""
    stretched = np.array([alpha * wo[0], alpha * wo[1], wo[2]])
    stretched /= np.linalg.norm(stretched)
    z = (1.0 - u1) * (1.0 + stretched[2]) - stretched[2]
    radius = np.sqrt(np.maximum(1.0 - z**2, 0.0))
    phi = 2.0 * np.pi * u0
    h = np.stack([radius * np.cos(phi), radius * np.sin(phi), z], axis=-1) + stretched
    h *= (alpha, alpha, 1.0)
    return np.asarray(h / np.linalg.norm(h, axis=-1, keepdims=True))


def _fresnel(cos_i: F64, eta: float) -> tuple[F64, F64]:
    """``microfacet.fresnel_dielectric`` for many cosines."""
    cos_t = np.sqrt(np.maximum(1.0 - (1.0 - cos_i**2) / eta**2, 0.0))
    across = (cos_i - eta * cos_t) / (cos_i + eta * cos_t)
    along = (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    return np.where(cos_t > 0, 0.5 * (across**2 + along**2), 1.0), cos_t
