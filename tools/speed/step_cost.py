"""What a step of a driven simulator costs, and where it goes; and whether its memory grows.

python tools/speed/step_cost.py [--steps 300] [--resolution 173x130] [--quality draft] [--every 0]

Two boxes as bundled, one of which turns, before a camera that moves; a step is 1 ms of the caller's clock. Times are
the process's CPU time and the wall clock's, medians of ten parts. With --every N, resident memory is printed each N
steps.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import clsim

STAGES = ("rendering", "detecting", "steering", "poses, and all else")


class Watch:
    """Sums up the time that functions take."""

    def __init__(self) -> None:
        self.spent = {stage: np.zeros(2) for stage in STAGES}

    def timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def measured(*arguments: Any) -> Any:
            start = now()
            try:
                return function(*arguments)
            finally:
                self.spent[stage] += now() - start

        return measured


def now() -> np.ndarray:
    return np.array((time.process_time(), time.perf_counter()))


def watch(simulator: Any) -> Watch:
    """Time the stages of a simulator that has made a step."""
    found = Watch()
    simulator._camera_pipeline.view.fill_at = found.timed("rendering", simulator._camera_pipeline.view.fill_at)
    simulator._camera_pipeline.detector.step = found.timed("detecting", simulator._camera_pipeline.detector.step)
    simulator._camera_pipeline.detector.interest = found.timed("steering", simulator._camera_pipeline.detector.interest)
    return found


def drive(simulator: clsim.Simulator, k: int) -> int:
    """Set where things are at millisecond k, make the step, and return the number of events."""
    turn = 0.02 * k
    simulator.set_pose("red box", ((-0.6, 0.55, -0.3), (0.0, math.sin(turn / 2), 0.0, math.cos(turn / 2))))
    simulator.set_camera(((-1.8 + 2e-4 * (k % 5000), 1.7, 3.4), (-0.16, -0.21, 0.04, 0.963)))
    return len(simulator.step(1_000 * k))


def resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--resolution", default="173x130")
    parser.add_argument("--quality", default="draft")
    parser.add_argument("--every", type=int, default=0)
    options = parser.parse_args()
    width, height = map(int, options.resolution.split("x"))
    with clsim.Simulator("two-boxes", resolution=(width, height), clock="caller", quality=options.quality) as simulator:
        for k in range(20):
            drive(simulator, k)
        found, parts, events = watch(simulator), [], 0
        for part in range(10):
            before, start = {stage: spent.copy() for stage, spent in found.spent.items()}, now()
            count = options.steps // 10
            for k in range(count):
                step = 20 + part * count + k
                events += drive(simulator, step)
                if options.every and step % options.every == 0:
                    print(f"{step} steps: {resident_mb():.1f} MB", flush=True)
            whole = now() - start
            own = {stage: found.spent[stage] - before[stage] for stage in STAGES[:-1]}
            own[STAGES[-1]] = whole - sum(own.values())
            parts.append([own[stage] / count for stage in STAGES])
    cpu_ms, wall_ms = 1e3 * np.median(parts, axis=0).T
    print(f"{events} events in {options.steps} steps of 1 ms, {width}x{height}, {options.quality}")
    for stage, cpu, wall in zip(STAGES, cpu_ms, wall_ms, strict=True):
        print(f"{stage:22s} {cpu:6.2f} ms CPU ({cpu / cpu_ms.sum():5.1%}) {wall:6.2f} ms ({wall / wall_ms.sum():5.1%})")
    print(f"{'a step':22s} {cpu_ms.sum():6.2f} ms CPU          {wall_ms.sum():6.2f} ms")


if __name__ == "__main__":
    main()
