"""Measure ideas that may improve regressed brightness, each on the same noisy frames (docs/research/experiments.md).

Scenes are rendered small, and kept in a folder. Every row (see tradeoff_prototypes.py) is scored against ESIM on clean
frames whose common random numbers have another seed, as is the ceiling, ESIM on clean frames of a third seed.

python -m tools.tradeoff_experiments --cache FOLDER --out tables.md
python -m tools.tradeoff_experiments --cache FOLDER --groups windows,shares --scenes moving-light --spp 8
"""

from __future__ import annotations

import argparse
import json
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from clsim.cli.options.parse import resolution as parse_resolution
from clsim.events import EventBatch
from clsim.scene import load_world
from clsim.score import Score, score
from tools.tradeoff_prototypes import (
    Case,
    Row,
    Studio,
    Take,
    chosen,
    fixed_share,
    gated,
    log_shrunk,
    offset,
    other,
    paired_share,
    plain,
    reprojected,
    split_albedo,
    visibility,
    wlr,
)

CEILING_SEED = 202
LINEAR: dict[str, Any] = {"regress": "linear", "bandwidth_h": 0.5}
BEST: dict[str, Any] = {**LINEAR, "window": 9, "shrink": 1.5}
CLOSE: dict[str, Any] = {"box": 3, "gate_scale": 0.7}
GROUPS: dict[str, tuple[str, dict[str, Row]]] = {
    "windows": ("Log or luminance, window and bandwidth", {
        "esim": plain,
        **{f"log K{k}": wlr(window=k) for k in (3, 5, 7, 13)},
        **{f"log K{k} h.5": wlr(window=k, bandwidth_h=0.5) for k in (7, 9, 13)},
        "ln(Y + .3 median) K9 h.5": offset(0.3, window=9, bandwidth_h=0.5),
        "linear K7 h1": wlr(window=7, regress="linear"),
        "linear K13 h1": wlr(window=13, regress="linear"),
        **{f"linear K{k} h.5": wlr(window=k, **LINEAR) for k in (7, 9, 13)},
    }),
    "shares": ("How much the pixel's own value counts", {
        "linear K9 h.5": wlr(window=9, **LINEAR),
        **{f"… {share:g} of the pixel": fixed_share(share, window=9, **LINEAR) for share in (0.25, 0.5)},
        **{f"… shrink {c:g}": wlr(window=9, shrink=c, **LINEAR) for c in (1.0, 1.5, 2.0)},
        **{f"K{k}, shrink 1.5": wlr(window=k, shrink=1.5, **LINEAR) for k in (7, 13)},
        "K9, share by paired halves": paired_share(window=9, **LINEAR),
        "K13, but K7 where the residual is more than noise": chosen(
            {**LINEAR, "window": 13}, {**BEST, "window": 7}, 1.5),
        "h .5, but .25 where the residual is more than noise": chosen(
            {**LINEAR, "window": 9}, {**LINEAR, "window": 9, "bandwidth_h": 0.25}, 1.5),
        "log, shrink 1.5": log_shrunk(0, **BEST),
        "ln(Y + .3 median), shrink 1.5": log_shrunk(0.3, **BEST),
    }),
    "gates": ("Behind the radiance gate", {
        "esim": plain,
        "log K13 h1, box 5, s 1 (the first default)": gated(),
        "log K13 h1, box 3, s .7": gated(**CLOSE),
        **{f"linear K9 h.5, shrink 1.5, box {b}, s {s:g}": gated(box=b, gate_scale=s, **BEST)
           for b in (1, 3, 5) for s in (1.0, 0.7)},
        "linear K13 h.5, shrink 1.5, box 3, s .7": gated(**{**BEST, "window": 13}, **CLOSE),
        "no gate: linear K9 h.5, shrink 1.5": wlr(**BEST),
    }),
    "summary": ("What a user can choose", {
        "esim": plain,
        "first default: radiance log K13": gated(),
        "radiance linear K9": gated(**BEST, **CLOSE),
        "radiance linear K13": gated(**{**BEST, "window": 13}, **CLOSE),
        "irradiance K7": wlr(method="irradiance", window=7),
    }),
    "albedo": ("Albedo split out", {
        "log K13": wlr(window=13),
        "log K13, split": split_albedo(window=13),
        "linear K9 h.5, shrink 1.5": wlr(**BEST),
        "linear K9 h.5, shrink 1.5, split": split_albedo(**BEST),
    }),
    "visibility": ("Light straight from lamps as a feature", {
        "linear K9 h.5": wlr(window=9, **LINEAR),
        **{f"… and box {b} of direct light": visibility(b, window=9, **LINEAR) for b in (3, 5)},
        "linear K9 h.5, shrink 1.5": wlr(**BEST),
    }),
    "history": ("History", {
        "linear K9 h.5, shrink 1.5": wlr(**BEST),
        "… T = 3": wlr(history=3, **BEST),
        "… reprojected, half": reprojected(0.5, window=9, **LINEAR),
        "esim reprojected, half": reprojected(0.5),
    }),
    "noise": ("Random numbers", {
        **{f"independent: {name}": other(row, noise="independent") for name, row in {
            "esim": plain,
            **{f"log K13 h1, T = {t}": wlr(window=13, history=t) for t in (1, 3)},
            **{f"linear K13 h1, T = {t}": wlr(window=13, history=t, regress="linear") for t in (1, 3)},
            "linear K9 h.5, T = 3": wlr(window=9, history=3, **LINEAR),
            "linear K9 h.5, reprojected, .8": reprojected(0.8, window=9, **LINEAR),
        }.items()},
        **{f"{label}: {name}": other(row, sampler=sampler)
           for label, sampler in {"common": "pcg", "common Sobol": "sobol"}.items()
           for name, row in {
               "esim": plain,
               "log K13 h1": wlr(window=13),
               "linear K9 h.5, shrink 1.5": wlr(**BEST),
           }.items()},
    }),
}  # fmt: skip
"""Tables: a title, and rows by their name."""


def main() -> None:
    """Read the command line, make the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="folder of rendered frames")
    parser.add_argument("--scenes", default="two-boxes,moving-light,cornell")
    parser.add_argument("--spp", default="2,8,32")
    parser.add_argument("--groups", default=",".join(GROUPS))
    parser.add_argument("--resolution", default="96x72")
    parser.add_argument("--frames", type=int, default=48)
    parser.add_argument("--threshold", type=float, default=0.2)
    parser.add_argument("--reference-spp", type=int, default=1024)
    parser.add_argument("--out", type=Path, help="Markdown file; default: standard output")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--plot", type=Path, help="PNG file: strict F1 of the first group's rows over samples a pixel")
    arguments = parser.parse_args()
    arguments.cache.mkdir(parents=True, exist_ok=True)
    size = parse_resolution(arguments.resolution)
    studio = Studio(arguments.cache, size, arguments.frames, arguments.threshold, arguments.reference_spp)
    scenes, spps = arguments.scenes.split(","), [int(n) for n in arguments.spp.split(",")]
    results = {name: measure(studio, name, scenes, spps) for name in arguments.groups.split(",")}
    ceiling = {scene: judge(studio, scene, studio.clean(scene, CEILING_SEED)) for scene in scenes}
    text = "\n".join(table(GROUPS[name][0], rows, scenes, spps, ceiling) for name, rows in results.items())
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(results, indent=1))
    if arguments.plot is not None:
        plot(arguments.plot, next(iter(results.values())), scenes, spps, ceiling)
    if arguments.out is None:
        print(text)
    else:
        arguments.out.write_text(text)


Figures = dict[str, float]


def measure(studio: Studio, group: str, scenes: list[str], spps: list[int]) -> dict[str, dict[str, Figures]]:
    """Return the scores of each row, by "scene spp"."""
    rows: dict[str, dict[str, Figures]] = {label: {} for label in GROUPS[group][1]}
    for scene in scenes:
        for spp in spps:
            case = Case(studio, Take(scene, spp))
            for label, row in GROUPS[group][1].items():
                made = row(case)
                events = made if made.dtype.names else studio.fire(made, case.frames.times)
                rows[label][f"{scene} {spp}"] = judge(studio, scene, events)
                print(f"{group}: {scene} {spp} spp, {label}: {rows[label][f'{scene} {spp}']}", file=sys.stderr)
    return rows


def judge(studio: Studio, scene: str, events: EventBatch) -> Figures:
    """Return F1, strict F1 and events per reference event."""
    found: Score = score(events, studio.reference(scene), *studio.size, fps_of(scene))
    return {"f1": found.f1, "strict": found.strict_f1, "events": found.events / found.reference_events}


@cache
def fps_of(scene: str) -> float:
    """Return a scene's frame rate."""
    return load_world(scene).fps


def table(
    title: str, rows: dict[str, dict[str, Figures]], scenes: list[str], spps: list[int], ceiling: dict[str, Figures]
) -> str:
    """Return a Markdown table."""
    columns = [f"{scene} {spp}" for scene in scenes for spp in spps]
    lines = [f"### {title}\n", "| F1 (strict F1) | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for label, figures in rows.items():
        lines.append(f"| {label} | " + " | ".join(cell(figures[column]) for column in columns) + " |")
    lines.append("| ceiling | " + " | ".join(cell(ceiling[scene]) for scene in scenes for _ in spps) + " |")
    return "\n".join(lines) + "\n"


def plot(
    path: Path, rows: dict[str, dict[str, Figures]], scenes: list[str], spps: list[int], ceiling: dict[str, Figures]
) -> None:
    """Draw strict F1 over samples a pixel, a panel for each scene."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4 * len(scenes), 3.6), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(scenes), sharey=True))
    for axes, scene in zip(panels, scenes, strict=True):
        for label, figures in rows.items():
            axes.plot(spps, [figures[f"{scene} {spp}"]["strict"] for spp in spps], marker="o", label=label)
        axes.axhline(ceiling[scene]["strict"], color="0.6", linestyle="--", label="ceiling")
        axes.set_xscale("log", base=2)
        axes.set_xticks(spps, [str(spp) for spp in spps])
        axes.set(title=scene, xlabel="samples a pixel, common random numbers")
        axes.grid(color="0.9")
    panels[0].set_ylabel("strict F1")
    panels[-1].legend(fontsize=8, loc="lower right")
    figure.savefig(path, dpi=110)


def cell(figures: Figures) -> str:
    """Return F1 and strict F1, without leading zeros."""
    return f"{figures['f1']:.3f} ({figures['strict']:.3f})".replace("0.", ".")


if __name__ == "__main__":
    main()
