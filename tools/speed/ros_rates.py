"""How many events a second go into bags of ROS and come back: a table for docs/ros.md.

python tools/speed/ros_rates.py [--events 8000000] [--rounds 3]

Events are random, 12 million a simulated second on 640×480 pixels. Processor time of this process, the best of all
rounds, which go round all rows in turn.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from clsim.events import EVENT_DTYPE, EventBatch
from clsim.events.files import open_sink, open_source

_WIDTH, _HEIGHT, _STEP_US, _PER_US = 640, 480, 4167, 12
_ROWS = tuple((ending, message) for message in ("mono", "evt3", "array") for ending in (".mcap", ".db3", ".bag"))


def random_events(count: int) -> EventBatch:
    rng = np.random.default_rng(0)
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, count // _PER_US, count))
    events["x"], events["y"] = rng.integers(0, _WIDTH, count), rng.integers(0, _HEIGHT, count)
    events["on"] = rng.random(count) < 0.5
    return events[np.lexsort((events["x"], events["y"], events["t"]))]


def write(path: Path, message: str, batches: list[EventBatch]) -> None:
    sink = open_sink(path, _WIDTH, _HEIGHT, ros_events=message)
    for k, batch in enumerate(batches):
        sink.write(batch, (k + 1) * _STEP_US)
    sink.close()


def cpu_s(work: Callable[[], object]) -> float:
    begun_s = time.process_time()
    work()
    return time.process_time() - begun_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--events", type=int, default=8_000_000)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    events = random_events(given.events)
    ends = np.arange(_STEP_US, int(events["t"][-1]) + 1 + _STEP_US, _STEP_US)
    batches = np.split(events, np.searchsorted(events["t"], ends[:-1]))
    best: dict[tuple[str, str], tuple[float, float, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(given.rounds):
            for ending, message in _ROWS:
                path = Path(folder) / f"a{ending}"
                into = cpu_s(lambda path=path, message=message: write(path, message, batches))
                back = cpu_s(lambda path=path: sum(len(batch) for batch in open_source(path)))
                old = best.get((ending, message), (np.inf, np.inf, 0.0))
                best[ending, message] = min(into, old[0]), min(back, old[1]), path.stat().st_size / given.events
    print("| message | bag | written [Mev/s] | read [Mev/s] | bytes an event |\n|---|---|---|---|---|")
    for (ending, message), (*times, size) in sorted(best.items()):
        written, read = (f"{given.events / each / 1e6:.0f}" for each in times)
        print(f"| `{message}` | `{ending}` | {written} | {read} | {size:.1f} |")


if __name__ == "__main__":
    main()
