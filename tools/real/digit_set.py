"""Simulated recordings of digits, made by `clsim dataset digits`: a hundred on each screen, so that few frames do."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from importlib import resources
from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image

import clsim
from clsim.events import EventBatch
from tools.real.digits import BLACK, DIGIT, SIDE, FloatArray

ALONG = 10
"""Digits along the side of a screen."""
BEGIN_US = 40_000
"""When the saccades' clock begins, in the specification `digits`."""


def make_screens(folder: Path, images: FloatArray) -> None:
    """Write screens of digits ``[N, 28, 28]`` from 0 to 1, in their order."""
    (folder / "screens").mkdir(parents=True, exist_ok=True)
    many = ALONG * ALONG
    for number in range(len(images) // many):
        sheet = np.zeros((ALONG, SIDE, ALONG, SIDE))
        part = images[number * many : (number + 1) * many].reshape(ALONG, ALONG, DIGIT, DIGIT)
        sheet[:, :DIGIT, :, :DIGIT] = part.transpose(0, 2, 1, 3)
        light = BLACK + (1 - BLACK) * sheet.reshape(ALONG * SIDE, ALONG * SIDE)
        stored = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)  # sRGB
        Image.fromarray(np.rint(255 * stored).astype(np.uint8)).convert("RGB").save(
            folder / "screens" / f"{number:03d}.png"
        )


def recorded(folder: Path, count: int, sensor: str | None) -> Iterator[tuple[EventBatch, int]]:
    """Yield the events of each digit of so many screens, and its number; what was made before is not made again.

    Args:
        folder: with the screens, for the data sets.
        count: how many screens.
        sensor: of the camera; None is the ideal one.
    """
    bundled = resources.files("clsim.datasets.specs").joinpath("digits.toml").read_text(encoding="utf-8")
    name, spec = sensor or "ideal", "digits"
    if sensor != "atis":
        line = f'sensor = "{sensor}"\n' if sensor else ""
        (folder / f"{name}.toml").write_text(bundled.replace('sensor = "atis"\n', line), encoding="utf-8")
        spec = f"{name}.toml"
    words = ("dataset", spec, "--count", str(count), "--out", name)
    subprocess.run([sys.executable, "-m", "clsim", *words], cwd=folder, check=True, stdout=sys.stderr)
    for number in range(count):
        sequence = folder / name / "sequences" / f"{number:06d}"
        shown = re.search(r"screens/(\d+)\.png", (sequence / "scene.toml").read_text(encoding="utf-8"))
        assert shown is not None, "each shows a screen"
        first = int(shown[1]) * ALONG * ALONG
        yield from zip(cut(clsim.open(sequence / "events.h5").read()), range(first, first + ALONG**2), strict=True)


def cut(events: EventBatch) -> Iterator[EventBatch]:
    """Yield the events of each digit of a screen, in a picture and by a clock of its own."""
    events = events[events["t"] >= BEGIN_US]
    which = events["y"] // SIDE * ALONG + events["x"] // SIDE
    order = np.argsort(which, kind="stable")
    for first, last in pairwise(np.searchsorted(which[order], np.arange(ALONG * ALONG + 1))):
        own = events[order[first:last]].copy()
        own["t"] -= BEGIN_US
        own["x"] %= SIDE
        own["y"] %= SIDE
        yield own
