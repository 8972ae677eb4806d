"""Steps a second of `clsim.batch` for several numbers of copies: the table of docs/robots.md.

python tools/speed/batch_rate.py [COPIES …]     # 1 8 64; prints a table
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import clsim

SIZE = (64, 48)
STEP_US = 1_000
STEPS = 512
"""Of all copies together; at least 8 of each."""


def resident_mb() -> float:
    """Return how much memory the process holds."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def measure(copies: int, quality: str) -> tuple[float, float, float]:
    """Return steps a second, seconds to start, and MB that are held."""
    began = time.perf_counter()
    with clsim.batch("two-boxes", copies, resolution=SIZE, clock="caller", quality=quality) as simulators:
        pose = simulators[0].pose("red box")

        def step(number: int) -> None:
            for k, simulator in enumerate(simulators):
                moved = pose.copy()
                moved[0, 3] += 0.01 * (k % 8) + 0.002 * number
                simulator.set_pose("red box", moved)
            simulators.step(STEP_US * number)

        step(0)
        ready = time.perf_counter()
        steps = max(8, STEPS // copies)
        for number in range(1, steps + 1):
            step(number)
        return copies * steps / (time.perf_counter() - ready), ready - began, resident_mb()


def main() -> None:
    counts = [int(text) for text in sys.argv[1:]] or [1, 8, 64]
    measure(1, "draft"), measure(1, "balanced")  # kernels are compiled
    print("| copies | `draft`: steps/s | `balanced`: steps/s | to start [s] | held [MB] |\n|---|---|---|---|---|")
    for copies in counts:
        draft, start_s, held = measure(copies, "draft")
        balanced, _, _ = measure(copies, "balanced")
        print(f"| {copies} | {draft:.0f} | {balanced:.0f} | {start_s:.1f} | {held:.0f} |", flush=True)


if __name__ == "__main__":
    main()
