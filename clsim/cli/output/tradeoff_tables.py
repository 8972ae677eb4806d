"""The sweep's results as CSV and as Markdown."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

from clsim.bench.tradeoff.summary import turned_knobs

FRONT_HEAD = (
    "Setting", "CPU s", "of it detection", "to start", "CPU µs per pixel and simulated s", "million paths", "F1",
    "strict F1", "F1 within 1 ms", "equivalent mismatch", "precision", "recall", "median Δt", "front",
)  # fmt: skip
_KNOB_HEAD = ("Knob", "from", "to", "CPU time", "detection's CPU time", "F1", "strict F1")


def csv_text(results: dict[str, Any]) -> str:
    """Return all points as CSV, one line each, with the ceiling's F1 and strict F1 of their event rule."""
    out = io.StringIO()
    ceiling = results["ceiling"]
    rows = [
        {"scene": results["scene"]}
        | point
        | {f"ceiling_{name}": ceiling[point["event_rule"]][name] for name in ("f1", "strict_f1")}
        for point in results["points"]
    ]
    columns = list(dict.fromkeys(name for row in rows for name in row))
    writer = csv.DictWriter(out, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


def markdown_text(results: dict[str, Any]) -> str:
    """Return the Pareto front with the ceiling, and what each knob costs, as Markdown."""
    parts = [_about(results), table(*front_table(results))]
    knobs = turned_knobs(results["settings"])
    if knobs:
        parts.append(f"One knob turned, from {knobs[0][1]['label']}:")
        parts.append(table(_KNOB_HEAD, [_knob_row(*pair) for pair in knobs]))
    return "\n\n".join(parts) + "\n"


def front_table(results: dict[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return head and rows: both fronts, cheapest first, the ICIP 2023 settings, and the ceilings last."""
    shown = [row for row in results["settings"] if row["front_f1"] or row["front_strict_f1"] or row["icip_2023"]]
    rows = [front_row(row) for row in shown]
    used = {row["event_rule"] for row in results["settings"]}
    for rule, scores in results["ceiling"].items():
        if rule in used:
            rows.append((f"ceiling, rule {rule}", "", "", "", "", "", *_scores(scores), ""))
    return FRONT_HEAD, rows


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; all columns but the first are aligned right."""
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, rule, *rows))


def _about(results: dict[str, Any]) -> str:
    events = results["reference"]["events"]
    return (
        f"{results['scene']}, {results['width']}×{results['height']}, {results['frames']} frames at "
        f"{results['fps']:g} fps, C = {results['threshold_on']:g}; {results['machine']['cores']} cores; "
        f"{events['interpolated']:,} events in the reference ({events['frame']:,} by frame). {reference_text(results)}"
    )


def reference_text(results: dict[str, Any]) -> str:
    """Tell how fine the reference is, whether that is fine enough, and what another seed's scores against it."""
    reference, ceiling = results["reference"], results["ceiling"]["interpolated"]["f1_within_1ms"]
    moved, budget = reference["f1_within_1ms_moved"], f"the budget of {reference['budget_s']:g} s"
    if moved is None:
        how = f"{budget} left no time to tell whether it has converged"
    else:
        how = "converged" if reference["converged"] else f"not converged, {budget} is spent"
        how += f" (F1 within 1 ms moved by {moved:.3f} when samples and frame rate were last doubled)"
    made = f"{reference['spp']} Sobol points a pixel, the same in each frame, at {reference['fps']:g} fps"
    return f"Reference: {made}; {how}. Another seed's F1 within 1 ms is {ceiling:.3f}."


def front_row(row: dict[str, Any]) -> tuple[str, ...]:
    """Return the cells of one row of the front's table."""
    fronts = [name for name, value in (("F1", "f1"), ("strict", "strict_f1")) if row.get(f"front_{value}")]
    label = row["label"] + (" (ICIP 2023)" if row.get("icip_2023") else "")
    each = row.get("cpu_us_per_pixel_second")
    return (
        label,
        _spread(row, "cpu_s", ".3g"),
        f"{row['detect_cpu_s']:.3g}",
        f"{row['startup_cpu_s']:.3g}" if "startup_cpu_s" in row else "–",
        "–" if each is None else f"{each:,.0f}",
        f"{row['paths'] / 1e6:.3g}",
        *_scores(row),
        " and ".join(fronts) or "–",
    )


def _scores(row: dict[str, Any]) -> tuple[str, ...]:
    dt_us, mismatch = row["dt_median_us"], row.get("equivalent_mismatch")
    values = [_spread(row, name) for name in ("f1", "strict_f1", "f1_within_1ms", "precision", "recall")]
    values.insert(3, "–" if mismatch is None else f"{100 * mismatch:.1f} %")
    return (*values, "–" if dt_us is None else f"{dt_us / 1e3:.2f} ms")


def _spread(row: dict[str, Any], name: str, form: str = ".3f") -> str:
    sd = row.get(f"{name}_sd")
    return f"{row[name]:{form}}" + ("" if sd is None else f" ± {sd:{'.1g' if form == '.3g' else form}}")


def _knob_row(knob: str, base: dict[str, Any], row: dict[str, Any]) -> tuple[str, ...]:
    def name(of: dict[str, Any]) -> str:
        return str(of["gate"] or of["method"]) if knob == "method" else str(of[knob])

    return (
        "gate" if knob == "method" else knob.replace("_", " "),
        name(base),
        name(row),
        f"× {row['cpu_s'] / base['cpu_s']:.2f}",
        f"× {row['detect_cpu_s'] / base['detect_cpu_s']:.2f}",
        f"{row['f1'] - base['f1']:+.3f}",
        f"{row['strict_f1'] - base['strict_f1']:+.3f}",
    )
