"""Truth out of frames, by the names under which it is asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from clsim.frames import RADIANCE, TRUTH_PLANES, Frame, plane_of

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
_KEYS = {"Id.object": "object", "Id.material": "material"}
_KEYS |= {"Label.object": "label-object", "Label.flow": "label-flow"}


def channels_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return the channels that frames have for those of the names that are planes of truth."""
    planes = [plane_of(plane) for name in names for plane in TRUTH_PLANES.get(name, ())]
    return tuple(channel for plane in planes for channel in plane.channels)


def cut(frame: Frame, names: Sequence[str]) -> dict[str, npt.NDArray[np.float32]]:
    """Return views of a frame's planes of truth, and its luminance as ``intensity``.

    ``intensity``, ``depth``, ``distance`` ``[H, W]``, ``normal``, ``albedo`` ``[H, W, 3]``, ``flow``, ``backward-flow``
    ``[H, W, 4]`` (x, y, valid, covisible); ``ids`` gives ``object`` and ``material`` ``[H, W]``. Other names give
    nothing.
    """
    found: dict[str, npt.NDArray[np.float32]] = {}
    if "intensity" in names:
        first = frame.names.index(RADIANCE[0])
        found["intensity"] = np.tensordot(_LUMINANCE, frame.planes[first : first + 3], 1)
    for name in names:
        for plane in map(plane_of, TRUTH_PLANES.get(name, ())):
            first = frame.names.index(plane.channels[0])
            values = frame.planes[first : first + plane.width]
            key = _KEYS.get(plane.name, name)
            found[key] = values[0] if plane.width == 1 else np.moveaxis(values, 0, 2)
    return found
