"""In float64, last stage: levels become events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.fit import Pixels
from clsim.detect.float64.observation import F64, Mask
from clsim.events import EVENT_DTYPE, EventBatch

MAX_EVENTS_PER_STEP = 1000
"""More events than this of one pixel in one step are not written: the frame rate is far too low for the threshold."""
MANY_CROSSINGS = 3
"""A pixel with more crossings in one step is counted: linear brightness between frames is a poor guess there."""


@dataclass(slots=True)
class Step:
    """One time step of n pixels, before and after.

    Attributes:
        start_us: time of the last processed frame.
        end_us: time of this frame.
        before: ``[n]``, level at ``start_us``.
        after: ``[n]``, level at ``end_us``.
        ref: ``[n]``, level at which the last event fired.
    """

    start_us: int
    end_us: int
    before: F64
    after: F64
    ref: F64


@dataclass(slots=True)
class Outcome:
    """What a rule makes of a step.

    Attributes:
        events: sorted by t, then (y, x).
        ref: ``[n]``, the new reference levels.
        fired: ``[n]``, whether the pixel had an event.
        many: number of pixels with more than `MANY_CROSSINGS` crossings.
        most: largest number of crossings of a pixel.
        capped: number of events left out by `MAX_EVENTS_PER_STEP`.
        margin: ``[n]``, distance of the level to the nearest threshold.
    """

    events: EventBatch
    ref: F64
    fired: Mask
    many: int
    most: int
    capped: int
    margin: F64


def apply_rule(step: Step, pixels: Pixels, width: int, config: DetectorConfig) -> Outcome:
    """Turn the step of ``pixels`` (flat indices of an image ``width`` wide) into events by ``config.event_rule``."""
    return (_frame_rule if config.event_rule == "frame" else _interpolated_rule)(step, pixels, width, config)


def _frame_rule(step: Step, pixels: Pixels, width: int, config: DetectorConfig) -> Outcome:
    """At most one event a frame, at the frame's time; the reference jumps to the level (Tsuji et al., ICIP 2023)."""
    change = step.after - step.ref
    on = change >= config.threshold_on
    fired = on | (change <= -config.threshold_off)
    events = _batch(np.full(int(fired.sum()), step.end_us), pixels[fired], width, on[fired])
    margin = np.minimum(np.abs(change - config.threshold_on), np.abs(change + config.threshold_off))
    return Outcome(events, np.where(fired, step.after, step.ref), fired, 0, int(fired.any()), 0, margin)


def _interpolated_rule(step: Step, pixels: Pixels, width: int, config: DetectorConfig) -> Outcome:
    """One event per threshold crossed, brightness or light being linear in time; the reference steps by C."""
    change = step.after - step.ref
    on = change > 0
    size = np.where(on, config.threshold_on, config.threshold_off)
    crossings = np.floor(np.abs(change) / size)
    stride = np.where(on, size, -size)
    ref = step.ref + crossings * stride
    written = np.minimum(crossings, MAX_EVENTS_PER_STEP).astype(np.int64)
    source = np.repeat(np.arange(len(pixels)), written)
    nth = np.arange(len(source)) - np.repeat(np.cumsum(written) - written, written) + 1
    before = np.clip(step.before, step.ref - config.threshold_off, step.ref + config.threshold_on)[source]
    rise = step.after[source] - before
    crossed = step.ref[source] + nth * stride[source] - before
    if config.event_rule == "linear-light":
        rise, crossed = np.expm1(rise), np.expm1(crossed)
    share = crossed / np.where(rise == 0, 1.0, rise)
    t = np.ceil(share * (step.end_us - step.start_us)).astype(np.int64) + step.start_us
    t = np.clip(t, step.start_us + 1, step.end_us)
    nearest = np.maximum(np.round(np.abs(change) / size), 1.0) * size
    other = np.where(on, config.threshold_off, config.threshold_on) + np.abs(change)
    margin = np.minimum(np.abs(np.abs(change) - nearest), other)
    many = int((crossings > MANY_CROSSINGS).sum())
    most = int(crossings.max(initial=0))
    capped = int((crossings - written).sum())
    return Outcome(_batch(t, pixels[source], width, on[source]), ref, crossings > 0, many, most, capped, margin)


def _batch(t: Pixels, pixels: Pixels, width: int, on: Mask) -> EventBatch:
    batch = np.empty(len(t), dtype=EVENT_DTYPE)
    order = np.lexsort((pixels, t))
    batch["t"] = t[order]
    batch["x"] = (pixels % width)[order]
    batch["y"] = (pixels // width)[order]
    batch["on"] = on[order]
    return batch
