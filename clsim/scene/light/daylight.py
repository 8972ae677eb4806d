"""Clear skies and the sun, from where the sun stands and how hazy the air is.

The sky is Hosek and Wilkie's, "An Analytic Model for Full Spectral Sky-Dome Radiance", SIGGRAPH 2012, with parameters
that `tools/accuracy/fit_sky.py` fits to what Mitsuba 3 returns; the sun's radiance is measured there too. Where the
sun stands at a place and time is after Blanco-Muriel et al., "Computing the Solar Vector", Solar Energy 70(5), 2001.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import cache
from importlib.resources import as_file, files

import numpy as np
import numpy.typing as npt

from clsim.scene.light import preetham
from clsim.scene.motion import Matrix, Static, compose
from clsim.scene.world import F32, SphereLight, Vec3

F64 = npt.NDArray[np.float64]

ROWS = 512
"""Rows of the picture of a sky: .35° each."""
SUN_DEG = 0.5358
"""Angle under which the sun is seen."""
TURBIDITIES = np.arange(1.0, 11.0)
HEIGHTS = np.linspace(0.0, 1.0, 13)
"""Cube roots of the sun's height over the horizon, in right angles."""
_FAR_OFF = 1e4
"""Distance of the sun in sizes of the scene: its rays are parallel to 1e-4."""
ALBEDOS = np.array([0.0, 0.2, 0.3, 0.5, 1.0])
"""Reflectances of the ground."""


@dataclass(frozen=True)
class Daylight:
    """A clear day.

    Attributes:
        to_sun: unit direction to the sun, +y up.
        turbidity: how hazy the air is, 1 … 10: 2 very clear, 3 clear, 6 warm and moist, 10 hazy.
        ground: reflectance of the ground, which lights the sky; 0 … 1.
        preetham: whether the sun is Preetham's, as in Mitsuba 0.6.
    """

    to_sun: Vec3
    turbidity: float = 3.0
    ground: float = 0.3
    preetham: bool = False

    @property
    def is_night(self) -> bool:
        """Whether the sun is below the horizon, where the model of the sky ends."""
        return self.to_sun[1] < 0


def dome(parameters: F64, cosine: F64, gamma: F64) -> F64:
    """Return the radiance of a sky (eq. 8 and 9 of the paper).

    Args:
        parameters: A to I.
        cosine: of the angle to the zenith, from 0.
        gamma: angle to the sun [rad].
    """
    a, b, c, d, e, f, g, h, i = parameters
    towards = np.cos(gamma)
    glow = (1 + towards**2) / np.maximum(1 + h * h - 2 * h * towards, 1e-6) ** 1.5
    high = np.sqrt(np.maximum(cosine, 0.0))
    around = c + d * np.exp(e * gamma) + f * towards**2 + g * glow + i * high
    return np.asarray((1 + a * np.exp(b / (cosine + 0.01))) * around, np.float64)


def sky(day: Daylight, rows: int = ROWS) -> F32:
    """Return the sky as a latitude-longitude picture ``[rows, 2·rows, 3]``; what lies below the horizon is black.

    Radiance is per nanometre [W·sr⁻¹·m⁻²·nm⁻¹], as in Mitsuba: the mean over wavelengths, weighted as the eye does.
    """
    theta = (np.arange(rows // 2) + 0.5) * math.pi / rows
    phi = (np.arange(2 * rows) + 0.5) * math.pi / rows
    x, z = np.sin(theta)[:, None] * np.sin(phi), -np.sin(theta)[:, None] * np.cos(phi)
    y = np.broadcast_to(np.cos(theta)[:, None], x.shape)
    towards = x * day.to_sun[0] + y * day.to_sun[1] + z * day.to_sun[2]
    gamma = np.arccos(np.clip(towards, -1.0, 1.0))
    picture = np.zeros((rows, 2 * rows, 3), np.float32)
    parameters, _ = _tables()
    ways = _between(TURBIDITIES, day.turbidity), _around(HEIGHTS, _height(day)), _between(ALBEDOS, day.ground)
    for corner in itertools.product(*ways):
        (i, share_i), (j, share_j), (k, share_k) = corner
        share = share_i * share_j * share_k
        for channel in range(3 if share else 0):
            picture[: rows // 2, :, channel] += share * dome(parameters[i, j, k, channel], y, gamma)
    return np.maximum(picture, 0.0)


def sun_radiance(day: Daylight) -> Vec3:
    """Return the mean radiance of the sun's disk seen through the air, as that of `sky`; 0 below the horizon."""
    if day.to_sun[1] <= 0:
        return 0.0, 0.0, 0.0
    if day.preetham:
        return preetham.sun_radiance(math.asin(min(day.to_sun[1], 1.0)), day.turbidity)
    _, table = _tables()
    # Air weakens light exponentially: logs are straight lines over how much air there is.
    logs = np.log(np.maximum(table, 1e-6))
    passed, at = (-preetham.air_mass(0.5 * math.pi * height**3) for height in (HEIGHTS, _height(day)))
    ways = _between(TURBIDITIES, day.turbidity), _between(passed, float(at))
    r, g, b = np.exp(sum(p * q * logs[i, j] for (i, p), (j, q) in itertools.product(*ways))).tolist()
    return r, g, b


def sun_light(
    day: Daylight, to_world: Matrix, middle_m: Vec3, radius_m: float, scale: float = 1.0, seen_deg: float = SUN_DEG
) -> SphereLight:
    """Return the sun as a sphere far away, with the power of the true one.

    Args:
        day: the day.
        to_world: 3×3 rotation from its frame to the world.
        middle_m: middle of what it lights.
        radius_m: half the size of that.
        scale: by how much it is brighter than the true one.
        seen_deg: angle under which it is seen.
    """
    share = (1 - math.cos(math.radians(SUN_DEG / 2))) / (1 - math.cos(math.radians(seen_deg / 2)))
    r, g, b = (value * scale * share for value in sun_radiance(day))
    to_sun = to_world @ np.array(day.to_sun)
    return far_sphere(to_sun, math.radians(seen_deg / 2), (r, g, b), middle_m, radius_m, "sun")


def far_sphere(
    to_sphere: F64, seen_rad: float, radiance: Vec3, middle_m: Vec3, radius_m: float, name: str = ""
) -> SphereLight:
    """Return a sphere light so far away that its rays are parallel all over what it lights.

    Args:
        to_sphere: unit direction to it.
        seen_rad: angle under which its radius is seen.
        radiance: of it.
        middle_m: middle of what it lights.
        radius_m: half the size of that.
        name: of the light.
    """
    away_m = _FAR_OFF * max(radius_m, 1e-6)
    x, y, z = (np.asarray(middle_m) + away_m * to_sphere).tolist()
    return SphereLight(away_m * math.sin(seen_rad), radiance, Static(compose((x, y, z), np.eye(3))), name)


def _height(day: Daylight) -> float:
    return float(np.cbrt(math.asin(min(max(day.to_sun[1], 0.0), 1.0)) / (0.5 * math.pi)))


def _between(places: F64, value: float) -> tuple[tuple[int, float], tuple[int, float]]:
    """Return the two places of a table around a value, and their shares."""
    value = min(max(value, float(places[0])), float(places[-1]))
    first = min(int(np.searchsorted(places, value, side="right")) - 1, len(places) - 2)
    share = (value - float(places[first])) / float(places[first + 1] - places[first])
    return (first, 1.0 - share), (first + 1, share)


def _around(places: F64, value: float) -> list[tuple[int, float]]:
    """Return the four places of a table around a value, and their shares in the cubic through them (Lagrange)."""
    first = min(max(int(np.searchsorted(places, value, side="right")) - 2, 0), len(places) - 4)
    four = places[first : first + 4]
    others = [np.delete(four, k) for k in range(4)]
    return [(first + k, float(np.prod((value - others[k]) / (four[k] - others[k])))) for k in range(4)]


@cache
def _tables() -> tuple[F64, F64]:
    """Return the sky's parameters ``[turbidity, height, ground, channel, 9]`` and the sun's radiance likewise."""
    with as_file(files("clsim.scene.light") / "daylight.npz") as path, np.load(path, allow_pickle=False) as data:
        return data["sky"].astype(np.float64), data["sun"].astype(np.float64)


def sun_at(latitude_deg: float, longitude_deg: float, time: datetime, zone_h: float = 0.0) -> Vec3:
    """Return the unit direction to the sun, from a place and local time: +x is east, +y up, −z north.

    Args:
        latitude_deg: north of the equator.
        longitude_deg: east of Greenwich.
        time: the clock's there.
        zone_h: by how much that is ahead of Greenwich.

    Raises:
        OverflowError: the time in Greenwich is before year 1 or after 9999.
    """
    utc = time - timedelta(hours=zone_h)
    days = (utc - datetime(2000, 1, 1, 12)).total_seconds() / 86400.0
    hours = utc.hour + utc.minute / 60 + utc.second / 3600
    omega = 2.1429 - 0.0010394594 * days
    mean_longitude, anomaly = 4.8950630 + 0.017202791698 * days, 6.2400600 + 0.0172019699 * days
    longitude = mean_longitude + 0.03341607 * math.sin(anomaly) + 0.00034894 * math.sin(2 * anomaly)
    longitude -= 0.0001134 + 0.0000203 * math.sin(omega)
    tilt = 0.4090928 - 6.2140e-9 * days + 0.0000396 * math.cos(omega)
    ascension = math.atan2(math.cos(tilt) * math.sin(longitude), math.cos(longitude))
    declination = math.asin(math.sin(tilt) * math.sin(longitude))
    sidereal_h = 6.6974243242 + 0.0657098283 * days + hours
    angle = math.radians(15 * sidereal_h + longitude_deg) - ascension
    latitude = math.radians(latitude_deg)
    height = math.cos(latitude) * math.cos(angle) * math.cos(declination) + math.sin(declination) * math.sin(latitude)
    zenith = math.acos(min(max(height, -1.0), 1.0))
    azimuth = math.atan2(
        -math.sin(angle), math.tan(declination) * math.cos(latitude) - math.sin(latitude) * math.cos(angle)
    )
    zenith += 6371.01 / 149597890 * math.sin(zenith)  # parallax
    return math.sin(azimuth) * math.sin(zenith), math.cos(zenith), -math.cos(azimuth) * math.sin(zenith)
