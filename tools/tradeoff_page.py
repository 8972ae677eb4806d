"""Measure the tables and plots of docs/tradeoff.md: what sampling by interest saves, over scenes and seeds.

    python tools/tradeoff_page.py --cache FOLDER --out FOLDER SCENE WIDTHxHEIGHT FRAMES REFERENCE_SPP

Writes NAME.md, NAME.json and NAME.png into the folder; points that the cache holds are not measured again.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from clsim.bench.tradeoff import TradeoffOptions, run_tradeoff
from clsim.bench.tradeoff_plot import plot_tradeoff
from clsim.bench.tradeoff_settings import BASE, ESIM, IRRADIANCE, Point, Rendering, named_points
from clsim.bench.tradeoff_tables import table

SEEDS = (0, 1, 2)
_HEAD = (
    "Setting (looks: first-hit rays)",
    "paths",
    "first-hit rays",
    "CPU µs",
    "F1",
    "strict F1",
    "of its paths",
    "of its CPU time",
)


def points() -> list[Point]:
    """Return the settings: plain ones, uniform ones with first-hit rays, adaptive ones, and those that have a name."""
    chosen: list[Point] = []
    for seed in SEEDS:
        chosen += [Point(Rendering(spp, "independent", seed), ESIM) for spp in (32, 512)]
        chosen += [Point(Rendering(spp, "common", seed), ESIM) for spp in (2, 8, 32, 128)]
        chosen += [Point(Rendering(spp, "common", seed), BASE) for spp in (8, 32)]
        chosen += [
            Point(Rendering(spp, "common", seed, "sobol", first_hit_rays=rays), ESIM)
            for spp, rays in ((64, 64), (128, 64))
        ]
        chosen += [
            Point(Rendering(spp, "common", seed, "sobol", first_hit_rays=rays), IRRADIANCE)
            for spp, rays in ((1, 4), (1, 16), (2, 16), (4, 16), (8, 16), (8, 64), (16, 64), (32, 64))
        ]
        chosen += [
            Point(Rendering(spp, "common", seed, "sobol", "adaptive", probe, rays), IRRADIANCE)
            for probe, spp, rays in (
                (1, 4, 16), (1, 8, 16), (1, 16, 16), (1, 8, 32), (1, 16, 32), (1, 8, 64), (1, 16, 64), (1, 32, 64),
                (2, 16, 64), (4, 32, 64), (4, 64, 64)
            )
        ]  # fmt: skip
        chosen += named_points(seed).values()
    return list(dict.fromkeys(chosen))


def page(results: dict[str, Any]) -> str:
    """Return the table of all settings against ESIM with 512 independent samples, as Markdown."""
    pixels = results["width"] * results["height"] * results["frames"]
    base = next(row for row in results["settings"] if row["noise"] == "independent" and row["spp"] == 512)
    rows = [_row(row, base, pixels) for row in sorted(results["settings"], key=lambda row: row["cpu_s"])]
    ceiling = results["ceiling"]["interpolated"]
    rows.append(("ceiling", "", "", "", f"{ceiling['f1']:.3f}", f"{ceiling['strict_f1']:.3f}", "", ""))
    about = (
        f"{results['scene']}, {results['width']}×{results['height']}, {results['frames']} frames at "
        f"{results['fps']:g} fps, C = {results['threshold_on']:g}, reference {results['reference']['spp']} spp, "
        f"{results['reference']['events']['interpolated']:,} events; {len(SEEDS)} seeds"
    )
    return f"{about}\n\n{table(_HEAD, rows)}\n\n{_dominated(results['settings'])}\n"


def _dominated(settings: list[dict[str, Any]]) -> str:
    """Return a sentence on which adaptive settings are beaten by a uniform one, in a cost and in both scores."""
    beaten = {
        unit: [
            _short(row["label"]) for row in settings if row["sampling"] == "adaptive" and _beaten(row, settings, cost)
        ]
        for cost, unit in (("paths", "for as few paths"), ("cpu_s", "in as little CPU time"))
    }
    found = [f"{unit} those of {'; '.join(labels)}" for unit, labels in beaten.items() if labels]
    if not found:
        return "No uniform setting reaches both scores of an adaptive one for as few paths, or in as little CPU time."
    return f"Uniform settings reach both scores of some adaptive ones: {', and '.join(found)}."


def _beaten(row: dict[str, Any], settings: list[dict[str, Any]], cost: str) -> bool:
    """Tell whether a uniform setting costs no more than ``row`` and has both its scores."""
    return any(
        other[cost] <= row[cost] and all(other[name] >= row[name] for name in ("f1", "strict_f1"))
        for other in settings
        if other["sampling"] == "uniform"
    )


def _row(row: dict[str, Any], base: dict[str, Any], pixels: int) -> tuple[str, ...]:
    scores = [f"{row[name]:.3f} ± {row[f'{name}_sd']:.3f}" for name in ("f1", "strict_f1")]
    as_good = all(row[name] >= base[name] for name in ("f1", "strict_f1"))
    saved = [f"1/{base[name] / row[name]:.3g}" if as_good and row is not base else "" for name in ("paths", "cpu_s")]
    counts = [f"{row['paths'] / pixels:.3g}", f"{row['first_hit_rays_traced'] / pixels:.3g}"]
    return (_short(row["label"]), *counts, f"{1e6 * row['cpu_s'] / pixels:.3g}", *scores, *saved)


def _short(label: str) -> str:
    """Return a label without what nearly all settings share."""
    for long, short in ((" common", ""), (" first hits", " looks"), ("irradiance K7", "irradiance")):
        label = label.replace(long, short)
    return label


def _report(what: str, done: float, total: float) -> None:
    print(f"\r{100 * done / max(total, 1):3.0f} % {what:60s}", end="", flush=True)


def main() -> None:
    """Measure one scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("scene")
    parser.add_argument("size")
    parser.add_argument("frames", type=int)
    parser.add_argument("reference_spp", type=int)
    given = parser.parse_args()
    width, height = (int(side) for side in given.size.split("x"))
    results = run_tradeoff(
        TradeoffOptions(
            given.scene,
            given.cache,
            reference_spp=given.reference_spp,
            resolution=(width, height),
            frames=given.frames,
            seeds=SEEDS,
            points=tuple(points()),
        ),
        _report,
    )
    given.out.mkdir(parents=True, exist_ok=True)
    # A Mitsuba scene is called scene.xml, in a folder that tells which.
    name = Path(given.scene).parent.name if given.scene.endswith(".xml") else Path(given.scene).stem
    results["scene"] = name
    (given.out / f"{name}.md").write_text(page(results))
    (given.out / f"{name}.json").write_text(json.dumps(results))
    plot_tradeoff(results, given.out / f"tradeoff-{name}.png")
    print(f"\n{page(results)}")


if __name__ == "__main__":
    main()
