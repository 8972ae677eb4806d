"""What comes out where a run must keep up with the clock: what is given up, how many frames are late, and F1.

python -m tools.speed.pace [SCENE ...] [--fps 30,120] [--resolution 346x260] [--seconds 10]

Each scene runs with ``--pace real`` on the cores that are free: let nothing else run. Its first second is compared with
that of `accurate` without a clock, at the scene's own rate; so is `balanced`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

COMPARED_US = 1_000_000


def live(scene: str, resolution: str, out: Path, *more: str) -> dict[str, Any]:
    """Record a run and return its summary."""
    command = [sys.executable, "-m", "clsim", "live", scene, "--resolution", resolution, "--json", *more]
    done = subprocess.run([*command, "--out", str(out)], capture_output=True, check=True, text=True)
    summary: dict[str, Any] = json.loads(done.stdout)
    return summary


def first_second(file: Path) -> Any:
    """Return the events of a file's first second."""
    from clsim.events.batch import gather
    from clsim.events.files import open_source

    events = gather(open_source(str(file)))
    return events[events["t"] < COMPARED_US]


def main() -> None:
    """Measure, and print a row for each run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["two-boxes"])
    parser.add_argument("--fps", default="30,120")
    parser.add_argument("--resolution", default="346x260")
    parser.add_argument("--seconds", type=float, default=10.0)
    given = parser.parse_args()
    from clsim.score import score

    size = [int(side) for side in given.resolution.split("x")]
    print("| scene | frames a second | given up | frames, late | events | F1 in 1 ms | in 25 ms |")
    print("|---|---:|---|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as folder:
        for scene in given.scenes:
            reference, run = Path(folder) / "reference.npz", Path(folder) / "run.evt3.raw"
            live(scene, given.resolution, reference, "--duration", "1s", "--quality", "accurate")
            runs = [("balanced", ["--duration", "1s"])]
            paced = ["--pace", "real", "--loop", "--duration", f"{given.seconds}s"]
            runs += [(fps, [*paced, "--fps", fps]) for fps in given.fps.split(",")]
            for name, options in runs:
                told = live(scene, given.resolution, run, *options)
                events, true = first_second(run), first_second(reference)
                agree = score(events, true, *size, 120.0, within_us=(1_000, 25_000)).within
                governor = told["governor"] or {"given_up": "no clock"}
                cells = [Path(scene).stem, name, governor["given_up"] or "nothing"]
                cells += [f"{told['frames']}, {told['late_frames']}", f"{len(events):,}"]
                cells += [f"{agree[1_000].f1:.2f}", f"{agree[25_000].f1:.2f}"]
                print("|", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
