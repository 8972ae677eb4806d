"""What may be asked for as truth."""

from __future__ import annotations

from collections.abc import Sequence

from clsim.errors import InputError
from clsim.frames import TRUTH_PLANES

TRUTH_NAMES: dict[str, str] = {
    "intensity": "linear luminance",
    "image": "8-bit sRGB grey",
    "depth": "along the optical axis",
    "distance": "along the ray",
    "normal": "shading normals",
    "albedo": "reflectance",
    "ids": "objects and materials",
    "flow": "to the next frame of truth",
    "backward-flow": "to the last one",
    "labels": "cause, object and image velocity of each event",
    "poses": "of camera and objects",
    "imu": "of the camera",
}
"""All of it, with what each is in few words; those in `TRUTH_PLANES` are planes that the renderer fills."""


def truth_names(given: Sequence[str]) -> tuple[str, ...]:
    """Return what is asked for, each once, in the order of `TRUTH_NAMES`; ``all`` is everything, ``none`` nothing.

    Raises:
        InputError: a name is unknown, or stands beside none.
    """
    if "none" in given and len(given) > 1:
        raise InputError(f"`truth` none is nothing else, got {', '.join(given)}")
    if "none" in given:
        return ()
    for name in given:
        if name != "all" and name not in TRUTH_NAMES:
            raise InputError(f"`truth` {name!r} is unknown; expected all, none, or of {', '.join(TRUTH_NAMES)}")
    return tuple(name for name in TRUTH_NAMES if name in given or "all" in given)


def plane_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return those of the names that are planes."""
    return tuple(name for name in names if name in TRUTH_PLANES)
