"""Light of a glTF that its animations change: KHR_animation_pointer on lamps and on what materials emit."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from clsim.scene.gltf.animation import Channel, Property
from clsim.scene.modulation import Keyframed, Modulation
from clsim.scene.world import Vec3

Place = tuple[Property, int]
F64 = npt.NDArray[np.float64]
_PARTS = 64
"""Lines that stand for a curve from keyframe to keyframe; fewer where there are more than `_MOST_POINTS` in all."""
_MOST_POINTS = 1 << 17
_BEFORE = 1e-6
"""Share of the way from key to key that is left where a value jumps at the next."""


class LightTracks:
    """What the animations that play change of the light."""

    def __init__(self, channels: Iterable[Channel], duration_s: float, *, repeat: bool) -> None:
        """Take the channels that play; with ``repeat``, all start anew after the longest animation [s]."""
        self._channels = {(c.path, c.node): c for c in channels if c.path not in ("translation", "rotation", "scale")}
        self._period_s = duration_s if repeat else None

    def lamp(self, index: int, color: Vec3, intensity: float) -> tuple[Vec3, Modulation | None]:
        """Return the light of a lamp, colour times intensity, when it is brightest, and how it changes."""
        return self._product(("lamp color", index), ("lamp intensity", index), color, intensity)

    def surface(self, index: int, factor: Vec3, strength: float) -> tuple[Vec3, Modulation | None]:
        """Return what a material emits, factor times strength, when it is brightest, and how it changes."""
        return self._product(("emissive factor", index), ("emissive strength", index), factor, strength)

    def _product(
        self, of_color: Place, of_strength: Place, color: Vec3, strength: float
    ) -> tuple[Vec3, Modulation | None]:
        found = [self._channels.get(key) for key in (of_color, of_strength)]
        tracks = [track for track in found if track is not None]
        if not tracks:
            return (color[0] * strength, color[1] * strength, color[2] * strength), None
        step = all(track.interpolation == "STEP" for track in tracks)
        exact = step or (len(tracks) == 1 and tracks[0].interpolation == "LINEAR")
        keys_s = np.unique(np.concatenate([track.times_s for track in tracks]))
        times_s = keys_s if exact else _between(keys_s)
        hues, strengths = (
            np.array([rest if track is None else track.at(t) for t in times_s], np.float64)
            for track, rest in zip(found, (color, strength), strict=True)
        )
        values = np.maximum(hues * strengths.reshape(-1, 1), 0.0)  # a spline may lead below
        if self._period_s is not None and self._period_s > times_s[-1]:
            times_s, values = np.append(times_s, self._period_s), np.append(values, values[-1:], axis=0)
        peak = values.max(axis=0)
        factors = values / np.where(peak > 0, peak, 1.0)
        finest_s = float(np.diff(keys_s).min()) if len(keys_s) > 1 else 0.0
        change = Keyframed(
            tuple(times_s.tolist()),
            tuple((r, g, b) for r, g, b in factors.tolist()),
            step,
            self._period_s is not None,
            0.0 if exact else finest_s,
        )
        return (float(peak[0]), float(peak[1]), float(peak[2])), change if (values != values[0]).any() else None


def _between(keys_s: F64) -> F64:
    """Return the times of keys and of points between them, one just before each."""
    parts = max(1, min(_PARTS, _MOST_POINTS // len(keys_s)))
    shares = np.append(np.arange(parts) / parts, 1.0 - _BEFORE)
    inside = keys_s[:-1, None] + np.diff(keys_s)[:, None] * shares
    return np.append(inside.ravel(), keys_s[-1])
