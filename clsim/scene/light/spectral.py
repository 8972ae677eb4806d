"""How much of R, G and B a pixel sees: as eyes do, as silicon does, or as somebody says."""

from __future__ import annotations

import math

from clsim.scene.world import Mosaic, Sensor, Spectral, Vec3

WEIGHTS: dict[str, Vec3] = {"luminance": (0.2126, 0.7152, 0.0722), "silicon": (0.304, 0.359, 0.337)}
"""``luminance`` is Rec. 709's.

``silicon`` is the share of the photons of daylight (CIE D65) that 3 µm of silicon absorb, a photodiode's depth, in
three bands of visible light: 580 to 700 nm for R, 490 to 580 nm for G, 400 to 490 nm for B. Absorption is from Schinke
et al., "Uncertainty analysis for the coefficient of band-to-band absorption of crystalline silicon", 2015.
"""


def are_weights(spectral: Spectral) -> bool:
    """Tell whether that is a name, or weights of R, G and B that are not negative, and not all 0."""
    if isinstance(spectral, str):
        return spectral in WEIGHTS
    return min(spectral) >= 0 and 0 < sum(spectral) < math.inf


def spectral_weights(spectral: Spectral) -> Vec3:
    """Return the weights of R, G and B, whose sum is 1: white of radiance 1 is as bright to every pixel."""
    if isinstance(spectral, str):
        return WEIGHTS[spectral]
    red, green, blue = (weight / sum(spectral) for weight in spectral)
    return red, green, blue


def mosaic_of(pattern: str, red: Vec3, green: Vec3, blue: Vec3) -> Mosaic:
    """Return what pixels behind a pattern of filters, such as RGGB, see; each filter's weights add up to 1."""
    filters = {"R": spectral_weights(red), "G": spectral_weights(green), "B": spectral_weights(blue)}
    first, second, third, fourth = (filters[colour] for colour in pattern)
    return first, second, third, fourth


def seen_by_pixels(sensor: Sensor) -> Mosaic:
    """Return the weights of R, G and B of the pixels of each square of four; all are alike without filters."""
    if sensor.mosaic is not None:
        return sensor.mosaic
    return (spectral_weights(sensor.spectral),) * 4
