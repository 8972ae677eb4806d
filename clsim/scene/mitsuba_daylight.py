"""Mitsuba's skies and suns: ``sunsky``, and version 0.6's ``sky`` and ``sun``."""

from __future__ import annotations

from datetime import datetime

import numpy as np

from clsim.errors import InputError
from clsim.scene.daylight import SUN_DEG, Daylight, sun_at
from clsim.scene.mitsuba_values import Color
from clsim.scene.mitsuba_xml import Plugin
from clsim.scene.motion import Matrix

KINDS = ("sunsky", "sky", "sun")
_LATER_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From +y up to +z up, as skies have it since version 3; before, they had +y up."""
_TOKYO = {"latitude": 35.6894, "longitude": 139.6917, "timezone": 9.0}
_THEN = {"year": 2010, "month": 7, "day": 10, "hour": 15, "minute": 0, "second": 0}


def read_daylight(emitter: Plugin, turn: Matrix, legacy: bool) -> tuple[Daylight, Matrix]:
    """Return the day that an emitter describes, and the 3×3 rotation from its frame, +y up, to the world.

    Args:
        emitter: of one of ``KINDS``.
        turn: the rotation of its ``to_world``.
        legacy: whether the file is of version 0.6.

    Raises:
        InputError: the date or the direction to the sun is none.
    """
    to_world = turn if legacy else turn @ _LATER_UP
    turbidity, ground = emitter.get("turbidity", 3.0), emitter.values.get("albedo", 0.3)
    if isinstance(ground, Color):
        ground = float(np.mean(ground.rgb))
    direction = emitter.values.get("sun_direction")
    if direction is not None:
        length = float(np.linalg.norm(direction))
        if not length > 0:
            raise InputError(f"{emitter.place}: sun_direction has no length")
        x, y, z = (to_world.T @ (direction / length)).tolist()
    else:
        place = {name: emitter.get(name, value) for name, value in _TOKYO.items()}
        date = {name: int(emitter.get(name, float(value))) for name, value in _THEN.items()}
        try:
            year, month, day, hour, minute, second = date.values()
            time = datetime(year, month, day, hour, minute, second)
        except ValueError as error:
            raise InputError(f"{emitter.place}: there is no such date and time: {error}") from None
        x, y, z = sun_at(place["latitude"], place["longitude"], time, place["timezone"])
        if not legacy:  # since version 3 the south is along +x, and the west along +y
            x, y, z = z, y, x
    return Daylight((x, y, z), turbidity, float(ground)), to_world


def scales(emitter: Plugin) -> tuple[float, float]:
    """Return by how much the sky and the sun are brighter than they are; 0 where there is none."""
    scale = emitter.get("scale", 1.0)
    sky, sun = emitter.get("sky_scale", 1.0) * scale, emitter.get("sun_scale", 1.0) * scale
    return (0.0 if emitter.type == "sun" else sky), (0.0 if emitter.type == "sky" else sun)


def sun_deg(emitter: Plugin) -> float:
    """Return the angle under which the sun is seen; another one than the true one changes nothing of its power."""
    seen: float = emitter.get("sun_aperture", SUN_DEG)
    return float(seen * max(emitter.get("sun_radius_scale", 1.0), 1e-3))
