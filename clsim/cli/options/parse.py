"""Option values that need more than a number: durations, resolutions, thresholds."""

from __future__ import annotations

import re

from clsim.errors import InputError

_DURATION = re.compile(r"(?P<value>[0-9.eE+-]+)\s*(?P<unit>us|µs|ms|s|min)?")
_SECONDS = {"us": 1e-6, "µs": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, None: 1.0}


def duration_s(text: str, option: str = "--duration") -> float:
    """Return the seconds of ``2s``, ``500ms``, ``1.5min`` or ``2``."""
    match = _DURATION.fullmatch(text.strip())
    value = _number(match["value"]) if match else None
    if match is None or value is None or not 0 < value < float("inf"):
        raise InputError(f"{option} must be a positive time such as 2s or 500ms, got {text!r}")
    return value * _SECONDS[match["unit"]]


def windows_us(text: str, option: str) -> tuple[int, ...]:
    """Return the microseconds of ``0.3ms,1ms,3ms``, each once, smallest first."""
    found = sorted({round(1e6 * duration_s(part, option)) for part in text.split(",")})
    if found[0] < 1:
        raise InputError(f"{option} must be times of at least 1us, got {text!r}")
    return tuple(found)


def resolution(text: str) -> tuple[int, int]:
    """Return width and height of ``346x260``."""
    match = re.fullmatch(r"(\d{1,6})\s*[xX×]\s*(\d{1,6})", text.strip())
    if match is None or int(match[1]) < 1 or int(match[2]) < 1:
        raise InputError(f"--resolution must be WIDTHxHEIGHT in pixels, each at least 1, got {text!r}")
    return int(match[1]), int(match[2])


def threshold(text: str) -> tuple[float, float]:
    """Return the ON and OFF thresholds of ``0.2`` or ``0.2,0.25``."""
    values = [_number(part) for part in text.split(",")]
    if len(values) not in (1, 2) or any(value is None or not 0 < value < float("inf") for value in values):
        raise InputError(f"--threshold must be one or two positive numbers such as 0.2 or 0.2,0.25, got {text!r}")
    numbers = [value for value in values if value is not None]
    return numbers[0], numbers[-1]


def numbers(text: str, option: str) -> tuple[float, ...]:
    """Return the positive numbers of ``0.5,2,10``."""
    found = [_number(part) for part in text.split(",")]
    if any(each is None or not 0 < each < float("inf") for each in found):
        raise InputError(f"{option} must be positive numbers such as 0.5,2,10, got {text!r}")
    return tuple(each for each in found if each is not None)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def names(text: str) -> tuple[str, ...]:
    """Return the names of ``depth,flow``."""
    return tuple(part.strip() for part in text.split(",") if part.strip())
