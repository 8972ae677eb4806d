"""What a sequence holds, and whether it is kept."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from clsim.datasets.spec import Limits
from clsim.live.outputs.summary import Summary
from clsim.live.settings import OutputSettings

_MOVING_PX = 0.1


@dataclass(frozen=True)
class Figures:
    """What a sequence holds.

    Attributes:
        width, height: of the sensor [pixels].
        frames: that were rendered.
        duration_s: simulated.
        events, on_events: how many, and how many of them are ON.
        events_per_pixel_s: event rate of a pixel.
        flow_p95_px: 95th percentile of flow from one frame of truth to the next; None without flow.
        moving_share: share of pixels whose flow is above a tenth of a pixel; None without flow.
        nearest_m: least depth; None without depth.
    """

    width: int
    height: int
    frames: int
    duration_s: float
    events: int
    on_events: int
    events_per_pixel_s: float
    flow_p95_px: float | None = None
    moving_share: float | None = None
    nearest_m: float | None = None


def measure(folder: Path, summary: Summary, options: OutputSettings) -> Figures:
    """Return the figures of a run whose outputs lie in ``folder``; those of truth are read from ``events.h5``."""
    pixel_s = summary.width * summary.height * max(summary.simulated_s, 1e-9)
    truth = _of_truth(folder / "events.h5") if options.truth else {}
    return Figures(
        summary.width,
        summary.height,
        summary.frames,
        summary.simulated_s,
        summary.events,
        summary.on_events,
        summary.events / pixel_s,
        **truth,
    )


def _of_truth(path: Path) -> dict[str, Any]:
    import h5py

    told: dict[str, Any] = {}
    if not path.is_file():
        return told
    with h5py.File(path, "r") as file:
        frames = file.get("frames", {})
        if "flow" in frames and frames["flow"].shape[0]:
            speeds = [
                np.hypot(*frames["flow"][k][frames["flow_valid"][k] > 0].T) for k in range(frames["flow"].shape[0])
            ]
            speed = np.concatenate(speeds)
            if speed.size:
                told["flow_p95_px"] = float(np.percentile(speed, 95))
                told["moving_share"] = float((speed > _MOVING_PX).mean())
        if "depth" in frames and frames["depth"].shape[0]:
            told["nearest_m"] = min(float(frames["depth"][k].min()) for k in range(frames["depth"].shape[0]))
    return told


def reasons(figures: Figures, limits: Limits) -> list[str]:
    """Return why a sequence is not kept; nothing where it is."""
    found = []
    for name in ("events_per_pixel_s", "flow_p95_px", "moving_share"):
        value, wanted = getattr(figures, name), getattr(limits, name)
        if wanted is not None and (value is None or not wanted[0] <= value <= wanted[1]):
            told = "unknown" if value is None else f"{value:.4g}"
            found.append(f"{name} is {told}, expected {wanted[0]:g} to {wanted[1]:g}")
    if limits.nearest_m is not None and (figures.nearest_m is None or figures.nearest_m < limits.nearest_m):
        told = "unknown" if figures.nearest_m is None else f"{figures.nearest_m:.4g}"
        found.append(f"nearest_m is {told}, expected at least {limits.nearest_m:g}")
    return found
