"""What truth costs beside events: the table of docs/truth-figures.md.

python tools/speed/truth_cost.py [two-boxes] [--resolution 346x260] [--duration 0.5] [--rounds 3]

Runs of `clsim live` at 120 frames per second, in turn: events alone into .h5; with truth 30 times a second (intensity,
depth, flow, ids), poses at 200 Hz and inertial samples at 1 kHz into .h5; and into .h5 and .dsec. What is compared is
the processor time of whole processes, start included; medians of the rounds. The first round warms caches.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

TRUTH = ("--truth", "intensity,depth,flow,ids,poses,imu", "--frame-rate", "30")
KINDS = {"events alone": ((), (".h5",)), "into .h5": (TRUTH, (".h5",)), "into .h5 and .dsec": (TRUTH, (".h5", ".dsec"))}


def cost_s(command: list[str]) -> float:
    """Return the processor time of a process."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(command)} ended with status {os.waitstatus_to_exitcode(status)}")
    return used.ru_utime + used.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="two-boxes")
    parser.add_argument("--resolution", default="346x260")
    parser.add_argument("--duration", default="0.5")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    costs: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for number in range(options.rounds + 1):
        for kind, (truth, endings) in KINDS.items():
            with tempfile.TemporaryDirectory() as folder:
                command = [sys.executable, "-m", "clsim", "live", options.scene, "--fps", "120"]
                command += ["--resolution", options.resolution, "--duration", options.duration, *truth]
                for ending in endings:
                    command += ["--out", str(Path(folder) / f"run{ending}")]
                spent = cost_s(command)
            if number:
                costs[kind].append(spent)
    alone = float(np.median(costs["events alone"]))
    for kind, each in costs.items():
        median = float(np.median(each))
        print(f"{kind:20s} {median:7.2f} s CPU  {median / alone - 1:+6.1%}  ({min(each):.2f} to {max(each):.2f})")


if __name__ == "__main__":
    main()
