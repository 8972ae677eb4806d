"""From measured points to settings: means over seeds, the Pareto fronts, and what each knob costs."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import asdict, fields
from typing import Any

from clsim.bench.tradeoff.pareto import pareto_front
from clsim.bench.tradeoff.settings import BASE, ICIP_2023, DetectorSetting, Point, Rendering

VALUES = ("f1", "strict_f1")
_RENDERING = tuple(field.name for field in fields(Rendering) if field.name != "seed")
_DETECTOR = tuple(field.name for field in fields(DetectorSetting))
AXES = _RENDERING + _DETECTOR
_TOGETHER = (("method", "gate"), ("sampling", "probe_spp"))
"""Axes that are turned together count as one knob."""
_KNOBS = _TOGETHER + tuple((name,) for name in AXES if all(name not in knob for knob in _TOGETHER))


def summarise(points: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return one row for each setting: means over seeds, cheapest first.

    Besides the figures of a point, a row has ``label``, ``seeds``, ``<figure>_sd`` (standard deviation over seeds,
    None for one seed), ``front_f1`` and ``front_strict_f1`` (whether it is on that front of mean CPU time and mean
    score), and ``icip_2023`` (whether it is that paper's setting).
    """
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for point in points:
        groups.setdefault(tuple(point[axis] for axis in AXES), []).append(point)
    rows = sorted((_mean(group) for group in groups.values()), key=lambda row: row["cpu_s"])
    for value in VALUES:
        front = set(pareto_front([row["cpu_s"] for row in rows], [row[value] for row in rows]))
        for i, row in enumerate(rows):
            row[f"front_{value}"] = i in front
    return rows


def _mean(group: list[dict[str, Any]]) -> dict[str, Any]:
    first = group[0]
    detector = DetectorSetting(**{name: first[name] for name in _DETECTOR})
    rendering = Rendering(seed=first["seed"], **{name: first[name] for name in _RENDERING})
    row: dict[str, Any] = {name: first[name] for name in AXES}
    row["label"] = Point(rendering, detector).label
    row["seeds"] = [point["seed"] for point in group]
    row["icip_2023"] = first["noise"] == "independent" and detector == ICIP_2023
    return row | averages(group, (*AXES, "seed"))


def averages(group: list[dict[str, Any]], but: Sequence[str]) -> dict[str, Any]:
    """Return means and standard deviations of all figures but some."""
    found: dict[str, Any] = {}
    for name in group[0]:
        if name not in but:
            known = [point[name] for point in group if point[name] is not None]
            found[name] = statistics.fmean(known) if known else None
            found[f"{name}_sd"] = statistics.stdev(known) if len(known) > 1 else None
    return found


def turned_knobs(rows: list[dict[str, Any]]) -> list[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Return the pairs (knob, base, other) where ``other`` differs from a base row in one knob alone.

    A base row has the detector of ``clsim live``, common noise, the plain sampler and as many samples everywhere, at
    the median spp that was measured so. An axis that one of the two has no use for does not count as a difference.
    """
    live = asdict(BASE) | {"noise": "common", "sampler": "pcg", "sampling": "uniform", "first_hit_rays": 0}
    bases = [row for row in rows if all(row[name] == live[name] for name in live)]
    if not bases:
        return []
    bases.sort(key=lambda row: row["spp"])
    base = bases[(len(bases) - 1) // 2]
    pairs = []
    for row in rows:
        turned = [knob for knob in _KNOBS if any(_differs(base, row, name) for name in knob)]
        if len(turned) == 1:
            pairs.append((turned[0][0], base, row))
    order = [knob[0] for knob in _KNOBS]
    return sorted(pairs, key=lambda pair: (order.index(pair[0]), pair[2]["cpu_s"]))


def _differs(base: dict[str, Any], row: dict[str, Any], name: str) -> bool:
    if name in ("method", "gate"):
        return bool(base[name] != row[name])
    return base[name] is not None and row[name] is not None and base[name] != row[name]
