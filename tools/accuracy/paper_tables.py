"""Make the tables of Tsuji et al., ICIP 2023, for any recorded frames or any scene: methods × sequences × thresholds.

Every sequence of noisy frames is turned into events by every method, and those are scored against ESIM on clean
frames. The row `ceiling` is ESIM on other clean frames: no score can be trusted above it.

python -m tools.accuracy.paper_tables recorded FOLDER --reference common-1024spp --ceiling 1024spp \
    --fps 60 --threshold 0.14
python -m tools.accuracy.paper_tables rendered two-boxes --resolution 96x72 --frames 24 --spp 8,32 --reference-spp 256
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from clsim.cli.options.parse import resolution as parse_resolution
from clsim.detect.config import DetectorConfig
from clsim.detector import recorded_detector
from clsim.events import EventBatch
from clsim.frames import BASE_PLANES, Frame, page_aligned
from clsim.frames.exr import ExrSequence
from clsim.score import Curves, Sampling, Score, curves, plot_curves, score

METHODS: dict[str, dict[str, Any]] = {
    "esim": {"method": "esim"},
    "wlr-esim": {"method": "wlr-esim"},
    "delta-r": {"gate": "delta-r"},
    "published": {"gate": "published"},
    "radiance": {"gate": "radiance"},
    "radiance K9 T3": {"gate": "radiance", "window": 9, "history": 3},
    "radiance K13 T3": {"gate": "radiance", "history": 3},
    "delta-r exact": {"gate": "delta-r-exact"},
    "delta-r tsvd": {"gate": "delta-r", "bandwidth": "tsvd"},
    "delta-r optimised": {"gate": "delta-r", "bandwidth": "optimised"},
}
"""Rows by name; the last three are for checks and must be asked for."""
USUAL = list(METHODS)[:7]
CEILING = "ceiling (esim)"


@dataclass(frozen=True)
class Result:
    """One row of a table for one sequence."""

    score: Score
    solved_share: float | None
    cpu_s: float
    curves: Curves


Frames = Callable[[str], list[Frame]]


def main() -> None:
    """Read the command line, make the tables."""
    arguments = parse_arguments()
    if arguments.source == "recorded":
        sequences, frames = arguments.sequences.split(","), recorded_frames(arguments)
        fps = arguments.fps
    else:
        sequences, frames, fps = rendered_frames(arguments)
    text = []
    for threshold in map(float, arguments.threshold.split(",")):
        config = {
            "event_rule": arguments.rule,
            "threshold_on": threshold,
            "threshold_off": threshold,
            "ridge": arguments.ridge,
        }
        results = measure(arguments.methods.split(","), sequences, frames, config, fps)
        text.append(f"### C = {threshold:g}, rule `{arguments.rule}`\n\n{summary(results)}\n{details(results)}")
        if arguments.plots is not None:
            for sequence in sequences:
                shown = {method: row[sequence].curves for method, row in results.items()}
                plot_curves(shown, f"{arguments.plots}-{sequence}-{arguments.rule}-{threshold:g}.png")
    output = "\n".join(text)
    if arguments.out is None:
        print(output)
    else:
        arguments.out.write_text(output)


def parse_arguments() -> argparse.Namespace:
    """Return the command line's options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    sources = parser.add_subparsers(dest="source", required=True)
    recorded = sources.add_parser("recorded", help="a folder whose folders are sequences of EXR frames")
    recorded.add_argument("folder", type=Path)
    recorded.add_argument("--sequences", default="8spp,32spp,common-8spp", help="noisy ones, comma-separated")
    recorded.add_argument("--reference", default="common-1024spp", help="the clean one")
    recorded.add_argument("--ceiling", default="1024spp", help="another clean one")
    recorded.add_argument("--fps", type=float, default=60.0)
    rendered = sources.add_parser("rendered", help="a scene that clsim renders")
    rendered.add_argument("scene")
    rendered.add_argument("--resolution", default="96x72")
    rendered.add_argument("--frames", type=int, default=24)
    rendered.add_argument("--fps", type=float, help="default: the scene's")
    rendered.add_argument("--spp", default="8,32", help="of the noisy sequences, comma-separated")
    rendered.add_argument("--noise", default="independent,common")
    rendered.add_argument("--reference-spp", type=int, default=256)
    for each in (recorded, rendered):
        each.add_argument("--threshold", default="0.14", help="C, comma-separated")
        each.add_argument("--rule", choices=("frame", "interpolated"), default="frame")
        each.add_argument("--ridge", type=float, default=1e-5)
        each.add_argument("--methods", default=",".join(USUAL), help="rows: " + ", ".join(METHODS))
        each.add_argument("--out", type=Path, help="Markdown file; default: standard output")
        each.add_argument("--plots", help="start of the PNG files' names, for curves over τ")
    return parser.parse_args()


def recorded_frames(arguments: argparse.Namespace) -> Frames:
    """Return a function that reads a sequence by its name, or `reference` or `ceiling`."""
    special = {"reference": arguments.reference, "ceiling": arguments.ceiling}

    @cache
    def read(sequence: str) -> list[Frame]:
        return list(ExrSequence(arguments.folder / special.get(sequence, sequence), arguments.fps))

    return read


def rendered_frames(arguments: argparse.Namespace) -> tuple[list[str], Frames, float]:
    """Return the names of sequences, a function that renders one, and the frame rate.

    Noisy ones have seed 1, the reference has seed 2 and the ceiling seed 3, both with common random numbers.
    """
    from clsim.render import PathTracer, RenderOptions
    from clsim.scene import load_world

    world = load_world(arguments.scene, resolution=parse_resolution(arguments.resolution))
    choices = {"reference": ("common", arguments.reference_spp, 2), "ceiling": ("common", arguments.reference_spp, 3)}
    noisy = {f"{n} {s} spp": (n, int(s), 1) for n in arguments.noise.split(",") for s in arguments.spp.split(",")}
    variances = any(METHODS[name].get("bandwidth") for name in arguments.methods.split(","))

    @cache
    def render(sequence: str) -> list[Frame]:
        noise, spp, seed = (noisy | choices)[sequence]
        tracer = PathTracer(world, RenderOptions(spp=spp, fps=arguments.fps, seed=seed, noise=noise,
                                                 variances=variances))  # fmt: skip
        frames = []
        for k in range(arguments.frames):
            names = tracer.names if variances else BASE_PLANES
            frame = Frame(page_aligned((len(names), tracer.height, tracer.width)), names)
            tracer.fill(k, frame)
            frames.append(frame)
        return frames

    return list(noisy), render, arguments.fps or world.fps


def measure(
    methods: list[str], sequences: list[str], frames: Frames, config: Mapping[str, Any], fps: float
) -> dict[str, dict[str, Result]]:
    """Return the result of each row and sequence; the last row is the ceiling."""
    reference, _, _ = detect(frames("reference"), {**config, "method": "esim"})
    results: dict[str, dict[str, Result]] = {}
    for method in methods:
        results[method] = {}
        for sequence in sequences:
            found = detect(frames(sequence), {**config, **METHODS[method]})
            results[method][sequence] = judge(found, reference, frames(sequence)[0], fps)
            one = results[method][sequence]
            print(f"{method:<18} {sequence:<20} F1 {one.score.f1:.3f}, {one.cpu_s:.1f} CPU-s", flush=True)
    found = detect(frames("ceiling"), {**config, "method": "esim"})
    ceiling = judge(found, reference, frames("ceiling")[0], fps)
    results[CEILING] = dict.fromkeys(sequences, ceiling)
    return results


def detect(frames: list[Frame], options: Mapping[str, Any]) -> tuple[EventBatch, float | None, float]:
    """Return the events of a sequence, the share of pixels that were solved, and the processor time [s]."""
    config = DetectorConfig(**options)
    first = frames[0]
    detector = recorded_detector(config, first.width, first.height, first.names)
    detector.step(first)  # builds the kernels, which is not to be timed
    detector.reset()
    detector.close()
    detector = recorded_detector(config, first.width, first.height, first.names)
    start = time.process_time()
    events = np.concatenate([detector.step(frame) for frame in frames])
    cpu_s = time.process_time() - start
    solved = detector.stats.solved_share if config.facts.regresses else None
    detector.close()
    return events, solved, cpu_s


def judge(found: tuple[EventBatch, float | None, float], reference: EventBatch, frame: Frame, fps: float) -> Result:
    """Score events."""
    events, solved, cpu_s = found
    sampling = Sampling(frame.width, frame.height, fps)
    scores = score(events, reference, frame.width, frame.height, fps)
    return Result(scores, solved, cpu_s, curves(events, reference, sampling))


def summary(results: Mapping[str, Mapping[str, Result]]) -> str:
    """Return F1, strict F1 and the solved share, a row a method, a column a sequence."""
    sequences = list(next(iter(results.values())))
    lines = [f"| F1 (strict F1), share solved | {' | '.join(sequences)} |", "|---" * (len(sequences) + 1) + "|"]
    for method, row in results.items():
        cells = []
        for one in row.values():
            solved = "" if one.solved_share is None else f", {number(one.solved_share, 2)}"
            cells.append(f"{number(one.score.f1)} ({number(one.score.strict_f1, 2)}){solved}")
        lines.append(f"| {method} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def details(results: Mapping[str, Mapping[str, Result]]) -> str:
    """Return all that is known of each row and sequence; the paper's "P" is recall here, its "R" precision."""
    head = ("method", "sequence", "precision", "recall", "F1", "chamfer", "strict P", "strict R",
            "Δt median [ms]", "Δt p95 [ms]", "events / reference", "solved")  # fmt: skip
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for method, row in results.items():
        for sequence, one in (row if method != CEILING else {"–": next(iter(row.values()))}).items():
            s = one.score
            cells = (method, sequence, number(s.precision), number(s.recall), number(s.f1), f"{s.chamfer:.2e}",
                     number(s.strict_precision), number(s.strict_recall), milliseconds(s.dt_median_us),
                     milliseconds(s.dt_p95_us), f"{s.events} / {s.reference_events}",
                     "–" if one.solved_share is None else number(one.solved_share))  # fmt: skip
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def number(value: float, digits: int = 3) -> str:
    """Write a share as the paper does: .913."""
    return f"{value:.{digits}f}".removeprefix("0")


def milliseconds(value_us: float | None) -> str:
    """Write a time error."""
    return "–" if value_us is None else f"{value_us / 1000:.2f}"


if __name__ == "__main__":
    main()
