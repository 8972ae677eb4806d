"""The sun of Preetham, Shirley and Smits, "A Practical Analytic Model for Daylight", SIGGRAPH 1999, appendix A.1.

Mitsuba 0.6 has this sun. In hazy air, and low over the horizon, it is up to several times weaker than Mitsuba 3's.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.scene.light.spectra import rgb_of_light
from clsim.scene.world import Vec3

F64 = npt.NDArray[np.float64]
_WAVELENGTHS_NM = np.arange(380.0, 751.0, 10.0)
_OUTSIDE = """
16559.0 16233.7 21127.5 25888.2 25829.1 24232.3 26760.5 29658.3 30545.4 30057.5 30663.7 28830.4 28712.1
27825.0 27100.6 27233.6 26361.3 25503.8 25060.2 25311.6 25355.9 25134.2 24631.5 24173.2 23685.3 23212.1
22827.7 22339.8 21970.2 21526.7 21097.9 20728.3 20240.4 19870.8 19427.2 19072.4 18628.9 18259.2
"""
"""The sun's radiance outside the air [W·sr⁻¹·m⁻²·nm⁻¹]."""
_OZONE = """
.0008 .0012 .0015 .0018 .0022 .0025 .0028 .003 .006 .009 .014 .021 .030 .040 .048 .063 .075 .085 .103
.120 .120 .115 .125 .120 .105 .090 .079 .067 .057 .048 .036 .028 .023 .018 .014 .011 .010 .009
"""
_VAPOUR = {700.0: 0.024, 710.0: 0.0125, 720.0: 1.0, 730.0: 0.87, 740.0: 0.061, 750.0: 0.001}
_OZONE_CM, _VAPOUR_CM = 0.35, 2.0
"""How much of each there is over the ground."""


def air_mass(height_rad: npt.ArrayLike) -> F64:
    """Return the way of light through the air, as a multiple of that from the zenith (Kasten, 1966).

    Args:
        height_rad: over the horizon.
    """
    return np.asarray(1.0 / (np.sin(height_rad) + 0.15 * (np.degrees(height_rad) + 3.885) ** -1.253), np.float64)


def sun_radiance(height_rad: float, turbidity: float) -> Vec3:
    """Return the radiance of the sun's disk through the air [W·sr⁻¹·m⁻²·nm⁻¹], the mean over what eyes see.

    Args:
        height_rad: of the sun over the horizon.
        turbidity: how hazy the air is, from 1 on; below, there is no haze.
    """
    outside, ozone = (np.array([float(word) for word in table.split()]) for table in (_OUTSIDE, _OZONE))
    vapour = np.array([_VAPOUR.get(wavelength, 0.0) for wavelength in _WAVELENGTHS_NM]) * _VAPOUR_CM
    mass = air_mass(height_rad)
    um = _WAVELENGTHS_NM / 1000.0
    haze = (0.04608365822050 * max(turbidity, 1.0) - 0.04586025928522) * um**-1.3
    depth = mass * (0.008735 * um**-4.08 + haze + ozone * _OZONE_CM)
    depth += 0.2385 * vapour * mass / (1.0 + 20.07 * vapour * mass) ** 0.45
    return rgb_of_light(_WAVELENGTHS_NM, outside * np.exp(-depth))
