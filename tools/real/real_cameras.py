"""docs/real-cameras.md: real recordings beside simulated streams of the same rate.

python -m tools.real.real_cameras ../shared/real docs/real-cameras.md
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from clsim.events import EventBatch, empty_batch
from clsim.events.files import open_source
from clsim.sensor import SensorSettings, load_sensor
from clsim.sensor.statistics import Statistics, distances, statistics
from tools.real.page import Compared, page
from tools.real.scene import Look, Texture
from tools.real.streams import Taken, at_rate, camera, v2e
from tools.real.two_samples import OF_CAMERAS, FloatArray, accuracy, features


@dataclass(frozen=True)
class Case:
    """A recording, the preset that is held against it, the scene, and a first guess of its speed [pixels/s].

    Attributes:
        column_us: of a scan, where the camera has other columns than the preset.
    """

    file: str
    camera: str
    preset: str
    size: tuple[int, int]
    look: Look
    speed: float
    column_us: float | None = None


CASES = (
    Case("gen3-640x480.raw", "Prophesee Gen3", "gen3.1", (640, 480), Look(0.16, 1.5, 40.0, -0.2), 1500.0),
    Case("gen3b-640x480.raw", "Prophesee Gen3", "gen3.1", (640, 480), Look(0.085, 1.5, 12.0), 1500.0),
    Case("gen4.1-1280x720.raw", "Prophesee Gen4.1", "gen4.1", (1280, 720), Look(0.4, 1.0, 6.0), 700.0),
    Case("sample-320x240.aedat4", "DVXplorer", "dvxplorer", (320, 240), Look(0.3, 0.6, 6.0), 80.0, 0.61),
)


def compare(case: Case, folder: Path) -> Compared:
    """Return what a recording and its simulated streams are like."""
    with open_source(folder / case.file) as source:
        real = np.concatenate([empty_batch(0), *(batch.copy() for batch in source)])
    real = real[np.lexsort((real["x"], real["y"], real["t"]))]
    size, seconds = case.size, float(real["t"][-1] - real["t"][0]) * 1e-6
    texture = Texture(case.look, *size)
    preset = load_sensor(case.preset)
    if case.column_us is not None:
        preset = replace(preset, readout=replace(preset.readout, column_us=case.column_us))
    runs = {
        "ideal pixel": camera(SensorSettings(), texture, size, seconds),
        "preset": camera(preset, texture, size, seconds),
        "v2e": v2e(texture, size, seconds),
    }
    of_real = features(real)
    found: dict[str, tuple[Taken, Statistics, dict[str, object], tuple[float, float]]] = {}
    speed = case.speed
    for name, run in runs.items():
        begun = time.monotonic()
        taken = at_rate(run, len(real), speed)
        if name != "v2e":
            speed = taken.speed
        own = statistics(taken.events, *size)
        told = both(features(taken.events), of_real)
        found[name] = taken, own, distances(own, statistics(real, *size)), told
        took = time.monotonic() - begun
        print(f"{case.file} {name}: {len(taken.events)} of {len(real)} events, {took:.0f} s", file=sys.stderr)
    return Compared(
        case.file, case.camera, case.preset, case.look, statistics(real, *size), halves(real), len(of_real), found
    )


def both(one: FloatArray, other: FloatArray) -> tuple[float, float]:
    """Return how well the line tells two sets of patches apart: by all features, and by those of cameras alone."""
    return accuracy(one, other), accuracy(one[:, -len(OF_CAMERAS) :], other[:, -len(OF_CAMERAS) :])


def halves(events: EventBatch) -> tuple[float, float]:
    """Return how well the line tells a recording's first half from its second: what it can tell of nothing."""
    middle = events["t"][0] + (events["t"][-1] - events["t"][0]) // 2
    return both(features(events[events["t"] < middle]), features(events[events["t"] >= middle]))


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path, help="folder of the real recordings")
    parser.add_argument("page", type=Path)
    parser.add_argument("--only", help="a file's name, for a try")
    arguments = parser.parse_args()
    cases = [case for case in CASES if arguments.only in (None, case.file)]
    begun = time.monotonic()
    compared = [compare(case, arguments.recordings) for case in cases]
    minutes = (time.monotonic() - begun) / 60
    arguments.page.write_text(page(compared, minutes), encoding="utf-8")


if __name__ == "__main__":
    main()
