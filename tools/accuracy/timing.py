"""Measure when events happen: frames alone, at several rates, against pixels traced between frames.

python -m tools.accuracy.timing --markdown timing.md --picture docs/images/timing.png
"""

from __future__ import annotations

import argparse
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
from tools.accuracy.fast_scenes import fan, worlds

REFERENCE_FPS = 15_360.0
RUNS: tuple[tuple[str, float | None, float | None], ...] = (
    *((f"{fps} frames a second", float(fps), None) for fps in (30, 120, 480, 1920)),
    ("adaptive, 100 µs", None, 100.0),
    ("adaptive, 10 µs", None, 10.0),
)


@dataclass(frozen=True)
class Row:
    """How well a run tells when events happen.

    Attributes:
        name: of the run.
        events: how many it has.
        f1: F1 of one-to-one matches within 1 ms.
        recall: share of the reference's events with such a match.
        median_us, p95_us: |Δt| of these matches.
        cpu_s: processor time, once kernels are built.
        requests: pixels traced between frames, for an event.
    """

    name: str
    events: int
    f1: float
    recall: float
    median_us: float
    p95_us: float
    cpu_s: float
    requests: float


def run(
    world: World, fps: float | None, tolerance_us: float | None, duration_s: float, **options: Any
) -> tuple[Any, ...]:
    """Return the events of a run, the processor time that it took, and how many pixels were traced between frames.

    Without ``fps`` frames are as many as a run has by itself.
    """
    more: dict[str, Any] = {"time": "fixed"}
    if tolerance_us is not None:
        more = {"time": "adaptive", "time_tolerance_us": tolerance_us}
    with clsim.Simulator(world, fps=fps, **options, **more) as simulator:
        # Kernels are built by the first steps.
        simulator.step(round(2e6 / simulator.fps))
        simulator.reset()
        begun = time.process_time()
        events = simulator.step(round(duration_s * 1e6))
        cpu_s = time.process_time() - begun
        refiner = simulator._camera_pipeline.detector.between
        return events, cpu_s, 0 if refiner is None else refiner.stats.requests


def compare(name: str, found: tuple[Any, ...], reference: EventBatch, world: World) -> Row:
    """Return the row of a run."""
    events, cpu_s, requests = found
    sampling = Sampling(world.camera.width, world.camera.height, 30.0)
    apart = np.abs(one_to_one(events, reference, sampling, 1000))
    total = max(1, len(events) + len(reference))
    median, p95 = (float(np.quantile(apart, q)) if len(apart) else float("nan") for q in (0.5, 0.95))
    recall = len(apart) / max(1, len(reference))
    return Row(name, len(events), 2 * len(apart) / total, recall, median, p95, cpu_s, requests / max(1, len(events)))


def rows(world: World, duration_s: float, **options: Any) -> Iterator[Row]:
    """Yield the rows of a world against frames at `REFERENCE_FPS` of the same seed, that run first."""
    reference = run(world, REFERENCE_FPS, None, duration_s, **options)
    yield compare(f"{REFERENCE_FPS:g} frames a second", reference, reference[0], world)
    for name, fps, tolerance_us in RUNS:
        yield compare(name, run(world, fps, tolerance_us, duration_s, **options), reference[0], world)


def table(found: list[Row]) -> str:
    """Return a table of Markdown."""
    titles = ("run", "events", "F1, 1 ms", "recall", "median µs", "p95 µs", "CPU s", "traced an event")
    head = f"| {' | '.join(titles)} |\n{'|---' * len(titles)}|"
    lines = [
        f"| {row.name} | {row.events:,} | {row.f1:.3f} | {row.recall:.3f} | {row.median_us:.0f} | {row.p95_us:.0f} | "
        f"{row.cpu_s:.2f} | {row.requests:.1f} |"
        for row in found
    ]
    return "\n".join([head, *lines])


def draw(path: Path, size: tuple[int, int] = (96, 72), duration_s: float = 1 / 15) -> None:
    """Draw the fan's events over x, y and time: at 120 frames a second, and traced between 30."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    world = fan(size)
    figure = pyplot.figure(figsize=(12, 5.4), dpi=110)
    for k, (title, fps, tolerance_us) in enumerate((("--fps 120", 120.0, None), ("--time adaptive", None, 20.0))):
        events, cpu_s, _ = run(world, fps, tolerance_us, duration_s, quality="exact", spp=32)
        events = events[(events["t"] > 20_000) & (events["t"] < 45_000)]
        axes: Any = figure.add_subplot(1, 2, k + 1, projection="3d")
        colours = np.where(events["on"], "#d1495b", "#30638e")
        axes.scatter(events["t"] / 1e3, events["x"], size[1] - events["y"], c=colours, s=0.8, linewidths=0, alpha=0.7)
        axes.set(xlabel="time [ms]", ylabel="x [px]", zlabel="y [px]")
        axes.set_title(f"{title}: {len(events):,} events, {cpu_s:.1f} s of CPU", fontsize=10)
        axes.view_init(elev=18, azim=-62)
        axes.set_box_aspect((2.2, 1.2, 0.9))
    figure.tight_layout()
    figure.savefig(path)


def main() -> None:
    """Measure and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--markdown", type=Path, help="where the tables go")
    parser.add_argument("--picture", type=Path, help="where the picture goes")
    parser.add_argument("--spp", type=int, default=64)
    # A frame's time at 30 a second: at each of the rates a frame is at its end.
    parser.add_argument("--duration-ms", type=float, default=33.334)
    parser.add_argument("--only", help="part of a world's name")
    arguments = parser.parse_args()
    parts = []
    for name, world in worlds().items() if arguments.markdown else ():
        if arguments.only is None or arguments.only in name:
            found = list(rows(world, arguments.duration_ms * 1e-3, quality="exact", spp=arguments.spp))
            parts.append(f"### {name}\n\n{table(found)}\n")
            print(parts[-1], flush=True)
    if arguments.markdown:
        arguments.markdown.write_text("\n".join(parts), encoding="utf-8")
    if arguments.picture:
        draw(arguments.picture)


if __name__ == "__main__":
    main()
