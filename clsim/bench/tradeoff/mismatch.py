"""The equivalent mismatch: a run's error told as the spread of thresholds that a real camera would have.

The pixels of a camera do not share one contrast threshold: it varies from pixel to pixel, by 2.1 % in the DVS128
(Lichtsteiner et al., 2008). Here such a spread is put on the reference's own brightness, and the events are scored as a
run's are. The spread that scores as a run does is the run's equivalent mismatch: below 3 % a run is as good as another
specimen of the same camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from clsim.events import EVENT_DTYPE, EventBatch, empty_batch
from clsim.scene import Sensor
from clsim.score import score

SPREADS = (0.005, 0.01, 0.021, 0.03, 0.05, 0.08, 0.12, 0.2, 0.4)
"""Relative standard deviations of thresholds that are tried."""
DRAWS = 3
"""Cameras drawn for each."""
_SMALLEST = 0.01
"""No threshold is drawn below this share of the nominal one."""

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Levels:
    """The log brightness of a sequence: ``values [T, H, W]`` at ``times_us [T]``, linear in between."""

    values: npt.NDArray[np.float32]
    times_us: npt.NDArray[np.int64]


@dataclass(frozen=True)
class MismatchScale:
    """Mean F1 within a window of time of cameras whose thresholds differ, by the standard deviation; F1 descends."""

    spread: tuple[float, ...]
    f1: tuple[float, ...]

    def equivalent(self, f1: float) -> float | None:
        """Return the spread that scores as ``f1`` does; None where even the largest one scores better."""
        if f1 < self.f1[-1]:
            return None
        return float(np.interp(f1, self.f1[::-1], self.spread[::-1]))


def mismatch_scale(levels: Levels, sensor: Sensor, fps: float, within_us: int, seed: int = 0) -> MismatchScale:
    """Score cameras of each of ``SPREADS`` against the camera without any; both see ``levels``."""
    height, width = levels.values.shape[1:]
    truth = fire(levels, np.full((2, height, width), [[[sensor.threshold_on]], [[sensor.threshold_off]]]))
    found = [1.0]
    for spread in SPREADS:
        draws = [
            score(fire(levels, thresholds), truth, width, height, fps, within_us=(within_us,)).within[within_us].f1
            for thresholds in _cameras(sensor, (height, width), spread, seed)
        ]
        found.append(float(np.mean(draws)))
    return MismatchScale((0.0, *SPREADS), tuple(np.minimum.accumulate(found).tolist()))


def _cameras(sensor: Sensor, shape: tuple[int, int], spread: float, seed: int) -> Sequence[F64]:
    """Draw thresholds ``[2, H, W]``, ON and OFF on their own; the same numbers for all spreads."""
    nominal = np.array([sensor.threshold_on, sensor.threshold_off])[:, None, None]
    drawn = [np.random.default_rng([seed, draw]).standard_normal((2, *shape)) for draw in range(DRAWS)]
    return [nominal * np.maximum(1 + spread * each, _SMALLEST) for each in drawn]


def fire(levels: Levels, thresholds: F64) -> EventBatch:
    """Return the events of pixels with thresholds ``[2, H, W]``, ON and OFF: one for each crossing.

    It is the detector's rule ``interpolated``: brightness is linear between frames, and the level of reference moves on
    by the threshold with each event. Events are in order of time.
    """
    values = levels.values.reshape(len(levels.values), -1).astype(np.float64)
    on_size, off_size = thresholds.reshape(2, -1)
    width = levels.values.shape[2]
    reference = values[0].copy()
    batches = [empty_batch()]
    for before, after, start_us, end_us in zip(values, values[1:], levels.times_us, levels.times_us[1:], strict=False):
        change = after - reference
        on = change > 0
        step = np.where(on, on_size, -off_size)
        count = np.floor(change / step).astype(np.int64)
        pixel = np.repeat(np.arange(len(change)), count)
        nth = np.arange(len(pixel)) - np.repeat(np.cumsum(count) - count, count) + 1
        origin = before[pixel]
        share = (reference[pixel] + nth * step[pixel] - origin) / (after[pixel] - origin)
        t = start_us + np.ceil(share * (end_us - start_us)).astype(np.int64)
        batches.append(_batch(np.clip(t, start_us + 1, end_us), pixel, on[pixel], width))
        reference += count * step
    return np.concatenate(batches)


def _batch(t: npt.NDArray[np.int64], pixel: npt.NDArray[np.int64], on: npt.NDArray[np.bool_], width: int) -> EventBatch:
    order = np.lexsort((pixel, t))
    batch = np.empty(len(t), EVENT_DTYPE)
    batch["t"], batch["on"] = t[order], on[order]
    batch["y"], batch["x"] = np.divmod(pixel[order], width)
    return batch
