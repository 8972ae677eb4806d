"""Clips for the tests, written without loss, and the light in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import numpy.typing as npt

from clsim.events import EventBatch, empty_batch

Array = npt.NDArray[Any]
WIDTH, HEIGHT = 48, 8
"""Of all clips: kernels are built once."""
CONTRAST = 0.85
"""Amplitude of log light: half a period crosses 8 thresholds of 0.2."""
PERIOD_PX, SPEED_PX_PER_S = 24.0, 40.0
_SHIFT = 0.131
"""No threshold lies within 0.007 of an extreme, which frames may miss by 0.0003."""


def phase(time_s: Array | float, x: Array) -> Array:
    return 2 * np.pi * (x - SPEED_PX_PER_S * np.asarray(time_s)) / PERIOD_PX + _SHIFT


def grating(time_s: float, mean: float = 0.18) -> Array:
    """Return a sine grating of log light that moves to the right ``[H, W]``."""
    row = mean * np.exp(CONTRAST * np.sin(phase(time_s, np.arange(WIDTH))))
    return np.tile(row, (HEIGHT, 1))


def grating_events(end_s: float, threshold: float = 0.2) -> EventBatch:
    """Return the events of one row of the grating from 0 on, by the times when its log crosses thresholds (arcsine)."""
    rate = 2 * np.pi * SPEED_PX_PER_S / PERIOD_PX
    found = []
    for x in range(WIDTH):
        start = float(phase(0.0, np.array(float(x))))
        reference = CONTRAST * math.sin(start)
        # The phase falls with time. Extremes of the sine lie at π/2 + mπ.
        extreme = math.floor(start / np.pi - 0.5)
        while (start - np.pi * (extreme + 1.5)) / rate < end_s:
            # Ends at extreme number `extreme`: even ones are maxima, which falling phase reaches while light rises.
            on = extreme % 2 == 0
            sign = 1 if on else -1
            while sign * (reference + sign * threshold) < CONTRAST:
                level = reference + sign * threshold
                # In this half period the sine is sign·cos(distance to the extreme), and the phase comes from above.
                ahead = math.acos(sign * level / CONTRAST)
                time_s = (start - (np.pi * (extreme + 0.5) + ahead)) / rate
                if time_s > end_s:
                    break
                assert time_s >= 0
                reference = level
                found.append((round(time_s * 1e6), x, 0, on))
            extreme -= 1
    events = empty_batch(len(found))
    events[:] = sorted(found)
    return events


def encode(light: Array, transfer: str) -> Array:
    """Return stored values 0…1 of light, by the forward equations of the standards in float64."""
    y = np.asarray(light, np.float64)
    if transfer == "srgb":
        return np.where(y <= 0.0031308, 12.92 * y, 1.055 * y ** (1 / 2.4) - 0.055)
    if transfer == "bt709":
        return np.where(y < 0.018, 4.5 * y, 1.099 * y**0.45 - 0.099)
    if transfer == "pq":
        power = (y * 203 / 10000) ** 0.1593017578125
        return ((0.8359375 + 18.8515625 * power) / (1 + 18.6875 * power)) ** 78.84375
    if transfer == "hlg":
        return np.where(
            y <= 1 / 12, np.sqrt(3 * y), 0.17883277 * np.log(np.maximum(12 * y - 0.28466892, 1e-9)) + 0.55991073
        )
    return y


def write_clip(
    path: Path, planes: Sequence[Array], times: Sequence[int], *, pixels: str, codec: str = "ffv1",
    time_base: Fraction = Fraction(1, 1000), limited: bool | None = None, trc: int = 2, matrix: int = 2,
    primaries: int = 2,
) -> Path:  # fmt: skip
    """Write frames of stored values as they are: grey or RGB arrays, or lists of planes of luma and chroma."""
    first = planes[0]
    height, width = first[0].shape if isinstance(first, tuple) else first.shape[:2]
    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, rate=30)
        stream.width, stream.height, stream.pix_fmt = width, height, pixels
        stream.time_base = stream.codec_context.time_base = time_base
        context = stream.codec_context
        context.color_trc, context.colorspace, context.color_primaries = trc, matrix, primaries
        if limited is not None:
            context.color_range = 1 if limited else 2
        for values, time in zip(planes, times, strict=True):
            frame = frame_of(values, pixels, width, height)
            frame.pts, frame.time_base = time, time_base
            frame.color_range = 0 if limited is None else 1 if limited else 2
            frame.color_trc, frame.colorspace, frame.color_primaries = trc, matrix, primaries
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


def frame_of(values: Any, pixels: str, width: int, height: int) -> Any:
    if not isinstance(values, tuple):
        return av.VideoFrame.from_ndarray(values, format=pixels)
    frame = av.VideoFrame(width, height, pixels)
    for plane, samples in zip(frame.planes, values, strict=True):
        rows = np.zeros((plane.height, plane.line_size // samples.itemsize), samples.dtype)
        rows[:, : samples.shape[1]] = samples
        plane.update(rows.tobytes())
    return frame
