"""Figures of a run in words that need no explanation."""

from __future__ import annotations

from typing import Any


def count_text(value: float) -> str:
    """Return ``2.7 M`` for 2,700,000; numbers below a thousand in full."""
    for limit, unit in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= limit:
            return f"{value / limit:.1f} {unit}"
    return f"{value:.0f}"


def events_text(count: int, short: bool = False) -> str:
    """Return ``1 event`` or ``2,700 events``; in ``short``, ``2.7 k events``."""
    return f"{count_text(count) if short else f'{count:,}'} event{'' if count == 1 else 's'}"


def percent_text(share: float) -> str:
    """Return ``18 %``; less than one in two digits, so that what is not nothing is not shown as nothing."""
    return f"{100 * share:.2g} %" if share < 0.01 else f"{100 * share:,.0f} %"


def size_text(size_bytes: int) -> str:
    """Return ``1.3 MB``, in powers of a thousand."""
    for limit, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size_bytes >= limit:
            return f"{size_bytes / limit:.1f} {unit}"
    return f"{size_bytes} bytes"


def real_time_share(summary: dict[str, Any]) -> float | None:
    """Return simulated seconds a second since the first frame; None before there is any to tell of."""
    running_s = summary["wall_s"] - (summary["startup_s"] or 0.0)
    return summary["simulated_s"] / running_s if summary["simulated_s"] > 0 and running_s > 0 else None


def dropped_text(events: int) -> str:
    """Return the sentence about events of a source that were left out."""
    are = "was left out, for it lies" if events == 1 else "were left out, for they lie"
    have = "has no time or one" if events == 1 else "have no time or one"
    return f"{events_text(events)} {are} outside the sensor, or {have} far out of order"


def moved_text(events: int) -> str:
    """Return the sentence about events of a source that were put in their place."""
    came = "came after a later one and was" if events == 1 else "came after later ones and were"
    return f"{events_text(events)} {came} put in order"
