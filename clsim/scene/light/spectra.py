"""From spectra to linear Rec. 709, and what metals and glasses are made of."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.scene.world import Vec3

F64 = npt.NDArray[np.float64]
XYZ_TO_RGB = np.array(
    [[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]]
)

METALS: dict[str, tuple[Vec3, Vec3]] = {
    "a-C": ((2.9441, 2.2271, 1.9682), (0.8875, 0.7993, 0.8153)),
    "Ag": ((0.1553, 0.1167, 0.1384), (4.8284, 3.1222, 2.1469)),
    "Al": ((1.6575, 0.8804, 0.5212), (9.2238, 6.2695, 4.8370)),
    "AlAs": ((3.6053, 3.2329, 2.2163), (0.0007, 0.0000, 0.0075)),
    "AlSb": ((0.0000, 4.1394, 4.6693), (0.0000, 0.0940, 1.3006)),
    "Au": ((0.1430, 0.3753, 1.4420), (3.9830, 2.3856, 1.6034)),
    "Be": ((4.1850, 3.1850, 2.7841), (3.8355, 3.0101, 2.8690)),
    "Cr": ((4.3697, 2.9165, 1.6549), (5.2066, 4.2313, 3.7547)),
    "CsI": ((2.1449, 1.7023, 1.6624), (0.0000, 0.0000, 0.0000)),
    "Cu": ((0.2010, 0.9237, 1.1022), (3.9133, 2.4530, 2.1421)),
    "Cu2O": ((3.5518, 2.9499, 2.7519), (0.1142, 0.1939, 0.6061)),
    "CuO": ((3.2475, 2.4478, 2.2102), (0.5211, 0.5700, 0.7222)),
    "CuZn": ((0.4440, 0.5270, 1.0940), (3.6950, 2.7650, 1.8290)),
    "d-C": ((2.7087, 2.3188, 2.2289), (0.0000, 0.0000, 0.0000)),
    "Hg": ((2.3989, 1.4400, 0.9096), (6.3276, 4.3719, 3.4218)),
    "HgTe": ((4.7790, 3.2312, 2.6599), (1.6316, 1.5808, 1.7293)),
    "Ir": ((3.0863, 2.0822, 1.6179), (5.5922, 4.0671, 3.2673)),
    "K": ((0.0640, 0.0464, 0.0382), (2.1042, 1.3489, 0.9131)),
    "Li": ((0.2658, 0.1956, 0.2210), (3.5402, 2.3111, 1.6686)),
    "MgO": ((2.0896, 1.6507, 1.5949), (0.0000, 0.0000, 0.0000)),
    "Mo": ((4.4840, 3.5251, 2.7763), (4.1114, 3.4208, 3.1507)),
    "Na_palik": ((0.0603, 0.0561, 0.0620), (3.1793, 2.1125, 1.5790)),
    "Nb": ((3.4201, 2.7901, 2.3956), (3.4414, 2.7377, 2.5798)),
    "Ni_palik": ((2.3673, 1.6634, 1.4671), (4.4988, 3.0502, 2.3454)),
    "Rh": ((2.5858, 1.8602, 1.5543), (6.7823, 4.7030, 3.9761)),
    "Se": ((4.0583, 2.8429, 2.8209), (0.7540, 0.6384, 0.5218)),
    "SiC": ((3.1723, 2.5260, 2.4794), (0.0000, 0.0000, 0.0000)),
    "SnTe": ((4.5242, 1.9816, 1.2816), (0.0000, 0.0000, 0.0000)),
    "Ta": ((2.0627, 2.3929, 2.6279), (2.4084, 1.7415, 1.9470)),
    "Te": ((7.3902, 4.4821, 2.6371), (3.2560, 3.5271, 3.2921)),
    "ThF4": ((1.8307, 1.4422, 1.3876), (0.0000, 0.0000, 0.0000)),
    "TiC": ((3.7005, 2.8374, 2.5823), (3.2656, 2.3516, 2.1728)),
    "TiN": ((1.6485, 1.1505, 1.3798), (3.3683, 1.9435, 1.1021)),
    "TiO2": ((3.4566, 2.8017, 2.9052), (0.0001, 0.0000, 0.0007)),
    "V_palik": ((4.2776, 3.5129, 2.7611), (3.4913, 2.8895, 3.1115)),
    "VC": ((3.6576, 2.7527, 2.5327), (3.0683, 2.1987, 1.9632)),
    "VN": ((2.8656, 2.1192, 1.9401), (3.0322, 2.0561, 1.6163)),
    "W": ((4.3708, 3.3003, 2.9984), (3.5006, 2.6049, 2.2732)),
}
"""Refractive index and extinction coefficient in R, G, B of metals and some crystals, by their usual names in files."""

GLASSES: dict[str, float] = {
    "vacuum": 1.0,
    "helium": 1.000036,
    "hydrogen": 1.000132,
    "air": 1.000277,
    "carbon dioxide": 1.00045,
    "water ice": 1.31,
    "water": 1.333,
    "acetone": 1.36,
    "ethanol": 1.361,
    "carbon tetrachloride": 1.461,
    "glycerol": 1.4729,
    "benzene": 1.501,
    "silicone oil": 1.52045,
    "bromine": 1.661,
    "fused quartz": 1.458,
    "pyrex": 1.47,
    "acrylic glass": 1.49,
    "polypropylene": 1.49,
    "bk7": 1.5046,
    "sodium chloride": 1.544,
    "amber": 1.55,
    "pet": 1.575,
    "diamond": 2.419,
}
"""Refractive indices by the names that Mitsuba gives them."""


def matching_functions(wavelengths_nm: npt.ArrayLike) -> F64:
    """Return the CIE 1931 colour matching functions ``[n, 3]`` (fit of Wyman, Sloan and Shirley, JCGT 2013)."""
    w = np.asarray(wavelengths_nm, np.float64)

    def lobe(peak: float, below: float, above: float) -> F64:
        value: F64 = np.exp(-0.5 * ((w - peak) * np.where(w < peak, below, above)) ** 2)
        return value

    x = 0.362 * lobe(442.0, 0.0624, 0.0374) + 1.056 * lobe(599.8, 0.0264, 0.0323) - 0.065 * lobe(501.1, 0.0490, 0.0382)
    y = 0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322)
    z = 1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725)
    return np.stack([x, y, z], axis=-1)


GRID = np.arange(360.0, 831.0, 1.0)
"""The wavelengths [nm] over which spectra are summed."""
_D65 = """
46.6383 52.0891 49.9755 54.6482 82.7549 91.4860 93.4318 86.6823 104.865 117.008 117.812 114.861
115.923 108.811 109.354 107.802 104.790 107.689 104.405 104.046 100.000 96.3342 95.7880 88.6856
90.0062 89.5991 87.6987 83.2886 83.6992 80.0268 80.2146 82.2778 78.2842 69.7213 71.6091 74.3490
61.6040 69.8856 75.0870 63.5927 46.4182 66.8054 63.3828 64.3040 59.4519 51.9590 57.4406 60.3125
"""
D65 = np.interp(GRID, np.arange(360.0, 831.0, 10.0), [float(word) for word in _D65.split()])
"""Daylight, the white of Rec. 709 (CIE standard illuminant D65)."""


def rgb_of_light(wavelengths_nm: npt.ArrayLike, values: npt.ArrayLike) -> Vec3:
    """Return the colour of light whose spectrum is given at wavelengths; never negative.

    A constant 1 has luminance 1 and is redder than Rec. 709's white. Beyond the wavelengths it is dark.
    """
    return _rgb(wavelengths_nm, values, np.ones_like(GRID))


def rgb_of_reflectance(wavelengths_nm: npt.ArrayLike, values: npt.ArrayLike) -> Vec3:
    """Return the colour of a reflectance given at wavelengths, seen by daylight; never negative, and 1 is white."""
    white = _rgb(GRID, np.ones_like(GRID), D65)
    r, g, b = (x / y for x, y in zip(_rgb(wavelengths_nm, values, D65), white, strict=True))
    return r, g, b


def _rgb(wavelengths_nm: npt.ArrayLike, values: npt.ArrayLike, light: F64) -> Vec3:
    """Return the colour of a spectrum times a light, of luminance 1 where the spectrum is 1."""
    sampled = np.interp(
        GRID, np.asarray(wavelengths_nm, np.float64), np.asarray(values, np.float64), left=0.0, right=0.0
    )
    curves = matching_functions(GRID) * light[:, None]
    r, g, b = np.maximum(XYZ_TO_RGB @ ((curves * sampled[:, None]).sum(axis=0) / curves[:, 1].sum()), 0.0).tolist()
    return r, g, b


ILLUMINANTS: dict[str, tuple[float, float]] = {
    "stdillum-A": (0.44757, 0.40745),
    "stdillum-D50": (0.34567, 0.35850),
    "illum-acesD60": (0.32168, 0.33767),
    "stdillum-F1": (0.31310, 0.33727),
    "stdillum-F2": (0.37208, 0.37529),
    "stdillum-F3": (0.40910, 0.39430),
    "stdillum-F4": (0.44018, 0.40329),
    "stdillum-F5": (0.31379, 0.34531),
    "stdillum-F6": (0.37790, 0.38835),
    "stdillum-F7": (0.31292, 0.32933),
    "stdillum-F8": (0.34588, 0.35875),
    "stdillum-F9": (0.37417, 0.37281),
    "stdillum-F10": (0.34609, 0.35986),
    "stdillum-F11": (0.38052, 0.37713),
    "stdillum-F12": (0.43695, 0.40441),
}
"""Chromaticities x and y of usual lamps (CIE 015) by the names that pbrt gives them; D65 is Rec. 709's own white."""


def chromaticity_rgb(x: float, y: float) -> Vec3:
    """Return the colour of a light of luminance 1 and that chromaticity."""
    r, g, b = np.maximum(XYZ_TO_RGB @ (x / y, 1.0, (1.0 - x - y) / y), 0.0).tolist()
    return r, g, b


EQUAL_ENERGY = rgb_of_light(GRID, np.ones_like(GRID))
"""The colour of light that is as strong at all wavelengths."""


def blackbody_rgb(temperature_k: float) -> Vec3:
    """Return the colour of a black body of luminance 1."""
    r, g, b = blackbody_radiance(temperature_k)
    luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b
    return r / luminance, g / luminance, b / luminance


def blackbody_radiance(temperature_k: float) -> Vec3:
    """Return a black body's radiance [W·sr⁻¹·m⁻²·nm⁻¹] by Planck's law."""
    first, second = 1.191042972e20, 1.438776877e7  # 2hc² and hc/k, for wavelengths in nm and radiance per nm
    return rgb_of_light(GRID, first / GRID**5 / np.expm1(np.minimum(second / (GRID * temperature_k), 700.0)))
