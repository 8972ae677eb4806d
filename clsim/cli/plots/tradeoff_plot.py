"""The trade drawn: processor time against F1 and against strict F1."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np

from clsim.bench.tradeoff.settings import named_points
from clsim.cli.plots.figure import new_figure
from clsim.cli.plots.label_places import place_labels
from clsim.errors import InputError

_COLOURS = {"common": "#0072B2", "independent": "#D55E00"}
"""Blue and vermilion of Okabe and Ito, which colour-blind people tell apart; fillings tell them apart in grey."""
_ADAPTIVE = "#CC79A7"
"""Theirs too, instead of blue: adaptive sampling is always with common random numbers."""
_MARKERS = {"esim": "o", "wlr-esim": "s", "delta-r": "^", "radiance": "D", "irradiance": "v"}
_SHORT_NAMES = {"esim": "ESIM", "wlr-esim": "WLR", "delta-r": "delta-r", "radiance": "", "irradiance": ""}
_CEILING_STYLES: dict[str, Any] = {"interpolated": "--", "linear-light": "-.", "frame": ":"}
_PANELS = (("f1", "F1 (published metric)"), ("strict_f1", "strict F1 (same pixel, ±1 frame)"))
_CAMERAS = ((0.021, "2.1 %, DVS128"), (0.03, "3 %"))
"""Mismatches of thresholds that cameras have, drawn as lines."""
_MANY = 40
"""With more settings than this, those off the front are drawn faintly."""
_APART = 1.2
"""Points of the front whose costs differ by less than this factor share a label, unless they have a name."""


def plot_tradeoff(results: dict[str, Any], file: str | Path) -> None:
    """Draw all settings, both Pareto fronts, the ceilings and the ICIP 2023 setting into a PNG.

    A third panel has the equivalent mismatch of the settings that have one.

    Raises:
        InputError: matplotlib is not installed, or the file cannot be written.
    """
    figure = new_figure("the trade", 16, 5.6)
    *panels, last = figure.subplots(1, 3, sharex=True)
    panels[1].sharey(panels[0])
    _limits(panels[0], results)
    for panel, (value, title) in zip(panels, _PANELS, strict=True):
        _draw_panel(panel, results, value)
        panel.set_title(title, fontsize=11)
    panels[0].set_ylabel("agreement with the reference")
    _draw_mismatch(last, results)
    figure.suptitle(
        f"{results['scene']}, {results['width']}×{results['height']}, {results['frames']} frames, "
        f"reference of {results['reference']['spp']} spp",
        fontsize=12,
    )
    figure.legend(handles=_legend(results), loc="outside lower center", ncols=5, fontsize=9, frameon=False)
    figure.canvas.draw()  # places the panels, so that labels can be kept apart
    for panel, (value, _) in zip(panels, _PANELS, strict=True):
        _label_points(panel, results, value)
    try:
        figure.savefig(file, format="png", dpi=110)
    except OSError as error:
        raise InputError(f"cannot write {file}: {error.strerror}") from None


def _cost_axis(panel: Any) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda seconds, _: f"{seconds:g}"))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.set_xlabel("CPU time of rendering and detection [s]")
    panel.grid(alpha=0.25, which="both", linewidth=0.5)


def _draw_mismatch(panel: Any, results: dict[str, Any]) -> None:
    """Draw cost against equivalent mismatch, less being better, with the mismatch of cameras as lines."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    panel.set_yscale("log")
    _cost_axis(panel)
    panel.set_title("equivalent mismatch (F1 within 1 ms)", fontsize=11)
    panel.yaxis.set_major_formatter(FuncFormatter(lambda spread, _: f"{100 * spread:g} %"))
    panel.yaxis.set_minor_formatter(NullFormatter())
    largest = results["mismatch_scale"]["spread"][-1]
    panel.set_yticks([0.01, 0.05, 0.1, 0.2, largest])
    panel.set_ylim(1.2 * largest, 0.005)
    for spread, label in _CAMERAS:
        panel.axhline(spread, color="0.25", linewidth=1.0, linestyle="--", zorder=1)
        panel.annotate(label, (0.01, spread), xycoords=("axes fraction", "data"), xytext=(0, 2),
                       textcoords="offset points", fontsize=8.5)  # fmt: skip
    known = [row for row in results["settings"] if row["equivalent_mismatch"]]
    for row in known:
        _mark(panel, row, "equivalent_mismatch", faint=len(known) > _MANY)
    named = [(row, _quality(row)) for row in known if _quality(row)]
    panel.figure.canvas.draw()  # places the panel, so that labels can be kept apart
    places = [(row["cpu_s"], row["equivalent_mismatch"]) for row, _ in named]
    seen = [(row["cpu_s"], row["equivalent_mismatch"]) for row in known]
    place_labels(panel, places, [name for _, name in named], seen)


def _draw_panel(panel: Any, results: dict[str, Any], value: str) -> None:
    rows = results["settings"]
    _cost_axis(panel)
    for rule, scores in results["ceiling"].items():
        if rule in _rules(results):
            panel.axhline(scores[value], color="0.25", linestyle=_CEILING_STYLES[rule], linewidth=1.2, zorder=1)
    front = [row for row in rows if row[f"front_{value}"]]
    panel.step([row["cpu_s"] for row in front], [row[value] for row in front], where="post", color="0.55", zorder=1.5)
    for row in rows:
        faint = len(rows) > _MANY and not (row[f"front_{value}"] or row["icip_2023"])
        _mark(panel, row, value, faint)
        if row["icip_2023"]:
            panel.plot(row["cpu_s"], row[value], "o", markersize=14, markerfacecolor="none", color="black", zorder=4)


def _mark(panel: Any, row: dict[str, Any], value: str, faint: bool) -> None:
    colour = _ADAPTIVE if row["sampling"] == "adaptive" else _COLOURS[row["noise"]]
    panel.errorbar(
        row["cpu_s"],
        row[value],
        yerr=row.get(f"{value}_sd"),
        fmt=_MARKERS[row["gate"] or row["method"]],
        markersize=4 if faint else 6.5,
        color=colour,
        markerfacecolor=colour if row["noise"] == "common" else "white",
        alpha=0.3 if faint else 1.0,
        zorder=2 if faint else 3,
    )


def _rules(results: dict[str, Any]) -> set[str]:
    return {row["event_rule"] for row in results["settings"]}


def _label_points(panel: Any, results: dict[str, Any], value: str) -> None:
    """Name points of the front, and the paper's; colour tells the noise, so names leave it out."""
    rows = results["settings"]
    labelled: list[dict[str, Any]] = []
    names: list[str] = []
    cost = 0.0
    for row in sorted(rows, key=lambda row: row["cpu_s"]):
        name = "ICIP 2023" if row["icip_2023"] else _quality(row)
        if name or (row[f"front_{value}"] and row["cpu_s"] > _APART * cost):
            labelled.append(row)
            names.append(f"{name}\n{_short(row)}" if name else _short(row))
            cost = row["cpu_s"]
    seen = rows if len(rows) <= _MANY else labelled
    place_labels(
        panel,
        [(row["cpu_s"], row[value]) for row in labelled],
        names,
        [(row["cpu_s"], row[value]) for row in seen] + _along_lines(panel, results, value),
    )


def _quality(row: dict[str, Any]) -> str:
    """Return what ``clsim live --quality`` calls a setting, or nothing."""
    for name, point in named_points(0).items():
        if all(row[key] == value for key, value in point.as_dict().items() if key != "seed"):
            return name
    return ""


def _along_lines(panel: Any, results: dict[str, Any], value: str) -> list[tuple[float, float]]:
    """Return places along the front and the ceilings, which labels should not cover."""
    left, right = panel.get_xlim()
    places = [(x, scores[value]) for scores in results["ceiling"].values() for x in np.geomspace(left, right, 60)]
    front = [(row["cpu_s"], row[value]) for row in results["settings"] if row[f"front_{value}"]]
    for (cost, score), (next_cost, next_score) in itertools.pairwise(front):
        places += [(x, score) for x in np.geomspace(cost, next_cost, 20)]
        places += [(next_cost, y) for y in np.linspace(score, next_score, 20)]
    return places


def _short(row: dict[str, Any]) -> str:
    parts = [f"{row['spp']} spp" if row["probe_spp"] is None else f"{row['probe_spp']}–{row['spp']} spp"]
    if row["probe_every"] > 1:
        parts.append(f"each {row['probe_every']}")
    if row["sampler"] != "pcg":
        parts.append(row["sampler"])
    if row["first_hit_rays"]:
        parts.append(f"+ {row['first_hit_rays']} rays")
    parts.append(_SHORT_NAMES[row["gate"] or row["method"]])
    if row["window"] is not None and row["method"] != "irradiance":
        parts.append(f"K{row['window']}")
    if row["history"] is not None and row["history"] > 1:
        parts.append(f"T{row['history']}")
    if row["stride"] is not None and row["stride"] > 1:
        parts.append(f"/{row['stride']}")
    if row["arithmetic"] != "float32":
        parts.append("f64")
    return " ".join(part for part in parts if part)


def _limits(panel: Any, results: dict[str, Any]) -> None:
    """Leave room on both sides for labels, and show all scores and ceilings; both panels have the same axes."""
    panel.set_xscale("log")
    rows = results["settings"]
    costs = [row["cpu_s"] for row in rows]
    scores = [row[value] for row in rows for value, _ in _PANELS]
    panel.set_xlim(min(costs) / 1.6, max(costs) * 1.9)
    panel.set_ylim(max(-0.04, min(scores) - 0.05), 1.03)


def _legend(results: dict[str, Any]) -> list[Any]:
    from matplotlib.lines import Line2D

    rows = results["settings"]

    def marker(label: str, shape: str, colour: str, filling: str, size: float = 7) -> Line2D:
        return Line2D([], [], linestyle="", marker=shape, color=colour, markerfacecolor=filling, label=label, ms=size)

    names = {"esim": "ESIM", "wlr-esim": "WLR everywhere", "delta-r": "gate delta-r", "radiance": "gate radiance",
             "irradiance": "irradiance smoothed"}  # fmt: skip
    ways = {row["gate"] or row["method"] for row in rows}
    noises = {row["noise"] for row in rows}
    handles = [marker(names[way], shape, "0.4", "0.4") for way, shape in _MARKERS.items() if way in ways]
    handles += [
        marker(f"{noise} random numbers", "o", colour, colour if noise == "common" else "white")
        for noise, colour in _COLOURS.items()
        if noise in noises
    ]
    if any(row["sampling"] == "adaptive" for row in rows):
        handles.append(marker("adaptive sampling", "v", _ADAPTIVE, _ADAPTIVE))
    handles.append(Line2D([], [], color="0.55", label="Pareto front"))
    for rule, style in _CEILING_STYLES.items():
        if rule in _rules(results):
            handles.append(Line2D([], [], color="0.25", linestyle=style, label=f"ceiling, rule {rule}"))
    if any(row["icip_2023"] for row in rows):
        handles.append(marker("ICIP 2023 setting (rule frame)", "o", "black", "none", 12))
    return handles
