"""Kalibr's ``imu.yaml``: how noisy an inertial sensor is."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path

from clsim.errors import InputError
from clsim.truth.record import ImuNoise
from clsim.values import read_text

_MAX_BYTES = 1 << 20


def read_imu_noise(name: str) -> ImuNoise:
    """Read the four densities from a file of lines ``key: number``; other keys are left alone.

    Raises:
        InputError: the file cannot be read, or a density is missing or no number.
    """
    text = read_text(Path(name), _MAX_BYTES, "Kalibr's imu.yaml", f"`imu_noise` {name}")
    lines = (line.split("#")[0].partition(":") for line in text.splitlines())
    told = {key.strip(): value.strip() for key, colon, value in lines if colon}
    found = {}
    for field in fields(ImuNoise):
        try:
            found[field.name] = float(told[field.name])
        except KeyError:
            raise InputError(f"`imu_noise` {name}: has no {field.name}, expected Kalibr's imu.yaml") from None
        except ValueError:
            raise InputError(f"`imu_noise` {name}: {field.name} is {told[field.name]!r}, expected a number") from None
        if not (math.isfinite(found[field.name]) and found[field.name] >= 0):
            raise InputError(f"`imu_noise` {name}: {field.name} is {told[field.name]}, expected 0 or more")
    return ImuNoise(**found)
