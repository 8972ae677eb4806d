"""glTF's layers on a surface that clsim has no lobe for, as what they look like from above."""

from __future__ import annotations

import math

from clsim.scene.world import Vec3

_WAVES_NM = (650.0, 550.0, 450.0)
"""Wavelengths that stand for R, G and B."""
_MOST = 0.9999


def roughness_between(alpha: float, strength: float) -> float:
    """Return the roughness α that is the geometric mean of those along and across brushed grooves.

    Along them it is α + (1 − α)·strength² (KHR_materials_anisotropy).
    """
    return math.sqrt(alpha * (alpha + (1.0 - alpha) * strength**2))


def reflected_by_film(bare: Vec3, share: float, film_ior: float, thickness_nm: float) -> Vec3:
    """Return what a surface under a thin film reflects of light from above, of each colour (KHR_materials_iridescence).

    That is Airy's sum of what goes to and fro between the two faces of the film.

    Args:
        bare: what the surface reflects without it, 0 … 1.
        share: of the surface that has the film.
        film_ior: its index of refraction.
        thickness_nm: its thickness [nm].
    """
    outer = (1.0 - film_ior) / (1.0 + film_ior)
    found = []
    for reflected, wave_nm in zip(bare, _WAVES_NM, strict=True):
        root = math.sqrt(min(max(reflected, 0.0), _MOST))
        below = (1.0 + root) / (1.0 - root)
        inner = (film_ior - below) / (film_ior + below)
        shift = 2.0 * outer * inner * math.cos(4.0 * math.pi * film_ior * thickness_nm / wave_nm)
        film = (outer**2 + inner**2 + shift) / (1.0 + (outer * inner) ** 2 + shift)
        found.append(reflected + (film - reflected) * share)
    r, g, b = found
    return r, g, b
