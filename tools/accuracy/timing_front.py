"""Plot what the times of events cost: frames alone, whole pictures at ESIM's pace, and chosen pixels.

python -m tools.accuracy.timing_front --only two-boxes --picture docs/images/timing-front.png --markdown front.md
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import clsim
from clsim.events import EventBatch
from clsim.scene import World
from clsim.score.matching import Sampling, one_to_one
from tools.accuracy.fast_scenes import SIZE, ball, ten_times_faster

STEP_US = 33_334
"""Simulated time: a frame's at 30 a second."""
REFERENCE_PX = 0.04
"""Way between the pictures of the reference, which are of the same seed, samples and light."""
KINDS: dict[str, tuple[dict[str, Any], ...]] = {
    "frames alone": tuple({"fps": float(fps)} for fps in (30, 120, 480, 1920)),
    "whole pictures (--time lambda)": tuple({"time": f"lambda={way_px}"} for way_px in (4, 2, 1, 0.5, 0.25)),
    "chosen pixels (--time adaptive)": tuple(
        {"time": "adaptive", "time_tolerance_us": tolerance_us} for tolerance_us in (1000.0, 300.0, 100.0, 30.0, 10.0)
    ),
}


@dataclass(frozen=True)
class Point:
    """How a run does.

    Attributes:
        kind: what sort of run it is.
        settings: of it.
        cpu_s: processor time [s].
        f1: of one-to-one matches within 1 ms.
        median_us, p95_us: |Δt| of these.
        evaluations: pixels traced between frames, for an event.
    """

    kind: str
    settings: str
    cpu_s: float
    f1: float
    median_us: float
    p95_us: float
    evaluations: float


def cases() -> dict[str, tuple[World, dict[str, Any]]]:
    """Return worlds and options by title: all moves, and little does."""
    return {
        "two-boxes ten times faster": (ten_times_faster("two-boxes"), {"quality": "balanced"}),
        "a ball at 3000 px/s": (ball(), {"quality": "exact", "spp": 16}),
    }


def run(world: World, options: dict[str, Any]) -> tuple[EventBatch, float, int]:
    """Return events, processor time once kernels are built, and how many pixels were traced between frames."""
    with clsim.Simulator(world, **({"fps": 30.0, "time": "fixed"} | options)) as simulator:
        simulator.step(round(2e6 / simulator.fps))
        simulator.reset()
        begun = time.process_time()
        events = simulator.step(STEP_US)
        cpu_s = time.process_time() - begun
        between = simulator._camera_pipeline.detector.between
        return events, cpu_s, 0 if between is None else between.stats.requests


def points(world: World, options: dict[str, Any]) -> Iterator[Point]:
    """Yield a point for each setting."""
    reference, *_ = run(world, options | {"time": f"lambda={REFERENCE_PX}"})
    for kind, settings in KINDS.items():
        for given in settings:
            # Other processes make a run slower, and none makes it quicker.
            events, cpu_s, requests = min((run(world, options | given) for _ in range(3)), key=lambda each: each[1])
            apart = np.abs(one_to_one(events, reference, Sampling(*SIZE, 30.0), 1000))
            median, p95 = (float(np.quantile(apart, q)) if len(apart) else math.nan for q in (0.5, 0.95))
            f1 = 2 * len(apart) / max(1, len(events) + len(reference))
            name = ", ".join(f"{value:g}" if isinstance(value, float) else value for value in given.values())
            yield Point(kind, name, cpu_s, f1, median, p95, requests / max(1, len(events)))


def table(found: list[Point]) -> str:
    """Return a table of Markdown."""
    head = "| run | setting | CPU s | F1, 1 ms | median µs | p95 µs | traced an event |\n|---|---|---|---|---|---|---|"
    rows = [
        f"| {p.kind} | {p.settings} | {p.cpu_s:.2f} | {p.f1:.3f} | {p.median_us:.0f} | {p.p95_us:.0f} | "
        f"{p.evaluations:.1f} |"
        for p in found
    ]
    return "\n".join([head, *rows])


def draw(path: Path, found: dict[str, list[Point]]) -> None:
    """Draw the median error, and the share that has no match, over the processor time."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot, ticker

    figure, axes = pyplot.subplots(2, len(found), figsize=(5.4 * len(found), 7.2), dpi=110, squeeze=False, sharex="col")
    for column, (title, all_points) in enumerate(found.items()):
        for kind, colour, mark in zip(KINDS, ("#8d99ae", "#d1495b", "#30638e"), "os^", strict=True):
            mine = [p for p in all_points if p.kind == kind]
            cpu_s = [p.cpu_s for p in mine]
            axes[0, column].plot(cpu_s, [p.median_us for p in mine], marker=mark, color=colour, label=kind)
            axes[1, column].plot(cpu_s, [max(1 - p.f1, 1e-3) for p in mine], marker=mark, color=colour, label=kind)
        axes[0, column].set_title(title)
        axes[1, column].set_xlabel("CPU s for 1/30 s")
        for row, text in enumerate(("median error of an event's time [µs]", "1 − F1 within 1 ms")):
            axes[row, column].set(xscale="log", yscale="log", ylabel=text)
            axes[row, column].grid(alpha=0.3, which="both")
            axes[row, column].xaxis.set_major_locator(ticker.LogLocator(subs=(1, 3)))
            axes[row, column].xaxis.set_major_formatter(ticker.FormatStrFormatter("%g"))
            axes[row, column].xaxis.set_minor_formatter(ticker.NullFormatter())
    axes[0, 0].legend()
    figure.tight_layout()
    figure.savefig(path)


def main() -> None:
    """Measure and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--picture", type=Path, required=True, help="where the picture goes")
    parser.add_argument("--markdown", type=Path, help="where the tables go")
    parser.add_argument("--only", default="", help="part of a title")
    arguments = parser.parse_args()
    found = {}
    for title, (world, options) in cases().items():
        if arguments.only not in title:
            continue
        found[title] = list(points(world, options))
        print(f"### {title}\n\n{table(found[title])}\n", flush=True)
    if arguments.markdown:
        parts = [f"### {title}\n\n{table(mine)}\n" for title, mine in found.items()]
        arguments.markdown.write_text("\n".join(parts), encoding="utf-8")
    draw(arguments.picture, found)


if __name__ == "__main__":
    main()
