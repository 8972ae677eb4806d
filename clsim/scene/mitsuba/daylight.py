"""Mitsuba's skies and suns: ``sunsky``, and version 0.6's ``sky`` and ``sun``."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np

from clsim.errors import InputError
from clsim.scene.light.daylight import SUN_DEG, Daylight, sun_at
from clsim.scene.mitsuba.values import Color
from clsim.scene.mitsuba.xml import Plugin
from clsim.scene.motion import Matrix

KINDS = ("sunsky", "sky", "sun")
_LATER_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From +y up to +z up, as skies have it since version 3; before, they had +y up."""
_SMALLEST_DEG = 1e-3
"""A sun without size is one that small."""
_TOKYO = {"latitude": 35.6894, "longitude": 139.6917, "timezone": 9.0}
_DATE = {"year": 2010.0, "month": 7.0, "day": 10.0}
_TIME = {"hour": 15.0, "minute": 0.0, "second": 0.0}


def read_daylight(emitter: Plugin, turn: Matrix, legacy: bool) -> tuple[Daylight, Matrix]:
    """Return the day that an emitter describes, and the 3×3 rotation from its frame, +y up, to the world.

    Args:
        emitter: of one of ``KINDS``.
        turn: the rotation of its ``to_world``.
        legacy: whether the file is of version 0.6 or older, which has a darker ground and Preetham's sun.

    Raises:
        InputError: the date, the direction to the sun or the ground's reflectance is none.
    """
    to_world = turn if legacy else turn @ _LATER_UP
    albedo = emitter.values.get("albedo")
    usual = 0.2 if legacy else 0.3
    ground = float(np.mean(albedo.rgb)) if isinstance(albedo, Color) else emitter.get("albedo", usual)
    if "sun_direction" in emitter.values:
        direction = emitter.get("sun_direction", np.zeros(3))
        length = float(np.linalg.norm(direction))
        if not length > 0:
            raise InputError(f"{emitter.place}: sun_direction has no length")
        x, y, z = (to_world.T @ (direction / length)).tolist()
    else:
        place, date, time = (
            {name: emitter.get(name, value) for name, value in values.items()} for values in (_TOKYO, _DATE, _TIME)
        )
        try:
            year, month, day = map(int, date.values())
            hours, minutes, seconds = time.values()
            clock = datetime(year, month, day) + timedelta(hours=hours, minutes=minutes, seconds=seconds)
            x, y, z = sun_at(place["latitude"], place["longitude"], clock, place["timezone"])
        except (ValueError, OverflowError) as error:
            reason = "it is not in the years 1 to 9999" if isinstance(error, OverflowError) else error
            raise InputError(f"{emitter.place}: there is no such date and time: {reason}") from None
        if not legacy:  # since version 3 the south is along +x, and the west along +y
            x, y, z = z, y, x
    return Daylight((x, y, z), emitter.get("turbidity", 3.0), ground, preetham=legacy), to_world


def scales(emitter: Plugin) -> tuple[float, float]:
    """Return by how much the sky and the sun are brighter than they are; 0 where there is none.

    ``scale``, which version 0.6 has, is of what has no scale of its own.
    """
    scale = emitter.get("scale", 1.0)
    sky, sun = emitter.get("sky_scale", scale), emitter.get("sun_scale", scale)
    return (0.0 if emitter.type == "sun" else sky), (0.0 if emitter.type == "sky" else sun)


def sun_deg(emitter: Plugin) -> float:
    """Return the angle under which the sun is seen; another one than the true one changes nothing of its power.

    Raises:
        InputError: it is no angle from 0 to 180°.
    """
    seen: float = emitter.get("sun_aperture", SUN_DEG) * emitter.get("sun_radius_scale", 1.0)
    if not 0 <= seen <= 180:
        raise InputError(f"{emitter.place}: the sun is seen under {seen:g}°, expected an angle from 0 to 180")
    return max(seen, _SMALLEST_DEG)
