"""Kalibr's ``imu.yaml``: how noisy an inertial sensor is."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path

from clsim.errors import InputError
from clsim.truth.record import ImuNoise

_MAX_BYTES = 1 << 20


def read_imu_noise(name: str) -> ImuNoise:
    """Read the four densities from a file of lines ``key: number``; other keys are left alone.

    Raises:
        InputError: the file cannot be read, or a density is missing or no number.
    """
    path = Path(name)
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"`imu_noise` {name}: is larger than {_MAX_BYTES >> 20} MiB, expected Kalibr's imu.yaml")
        text = path.read_text("utf-8")
    except OSError as error:
        raise InputError(f"`imu_noise` {name}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"`imu_noise` {name}: is not UTF-8 text (byte {error.start})") from None
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
