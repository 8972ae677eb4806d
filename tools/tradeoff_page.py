"""Measure the tables and plots of docs/research/tradeoff.md: what sampling by interest saves, over scenes and seeds.

    python -m tools.tradeoff_page --cache FOLDER --out FOLDER SCENE WIDTHxHEIGHT FRAMES REFERENCE_SPP

Writes NAME.md, NAME.json and NAME.png into the folder; points that the cache holds are not measured again.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from clsim.bench.tradeoff.sweep import TradeoffOptions, run_tradeoff
from clsim.cli.output.tradeoff_tables import table
from clsim.cli.plots.tradeoff_plot import plot_tradeoff

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
